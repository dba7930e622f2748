"""Sound inputs of every kind that the commands read, and how each is spoiled and read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.faults.mutate import TOKENS, spoil_hdf5, spoil_journal, spoil_workbook, spoiled

BUNDLE = """schema: recording-bundle/1
instrument: cutometer
protocol: protocol.yaml
subject: P07
site: forehead
repeat: 1
channels:
  pressure: {file: data.csv, column: p, unit: mbar, time: {column: t, unit: s}}
  apex_height: {file: data.xlsx, column: h, unit: mm, time: {rate: 10 Hz, start: 0 s}}
  temperature: {file: data.csv, column: T, unit: degC, time: {column: t, unit: s}, range: [0, 100]}
frames: {files: 'img_*.png', rate: 25 Hz}
events:
- {time: 0.5, level: info, code: start, text: began}
"""
MAP = """schema: column-map/1
instrument: cutometer
time: {column: t, unit: s}
channels:
  apex_height: {column: 'h*', unit: mm}
  pressure: {column: p, unit: mbar, suction: positive}
subject: P07
"""
PROTOCOL = """schema: protocol/1
name: step
instrument: cutometer
limits: {pressure: {low: -500 mbar, high: 0 mbar}}
setup: {opening: 2 mm}
steps:
- {type: hold, pressure: -300 mbar, duration: 2 s}
- {type: ramp, pressure: 0 mbar, rate: 50 mbar/s}
- {type: hold, pressure: -100 mbar, duration: 1 s, repeat: 2}
"""
STATION = """schema: station/1
name: bench
instruments:
  cutometer:
    simulated: {tissue: cheek, seed: 1}
    limits: {pressure: {low: -450 mbar, high: 0 mbar}}
    watchdog: 0.5 s
    interlock: {stale: 1 s, margin: 0.1}
    calibration:
      opening: {value: 2 mm, provenance: assumed}
subjects:
  P07: {pressure: {low: -300 mbar, high: 0 mbar}}
"""
SPEC = """model: elastic
parameters: {E: {start: 40 kPa, bounds: [1 kPa, 1 MPa]}}
samples: 100
evaluations: 5
"""
MODEL = """class Model:
    name = 'm'
    channels = ('pressure',)
    stages = {'pressure': 'sensor'}
    parameters = ()

    def simulate(self, time, data, parameters, tap):
        return {'pressure': tap('pressure', 0 * time)}
"""
TABLE = "t,p,h,h2,T\n" + "".join(f"{k / 10},{-10 * k},{k / 100},{k / 50},{20 + k / 7}\n" for k in range(40))


@dataclass(frozen=True)
class Kind:
    """One kind of input: ``make`` writes the spoiled input into a folder and returns the arguments that read it."""

    name: str
    make: Callable[[Path, np.random.Generator], list[str]]


class Samples:
    """Sound files, made once and kept as bytes."""

    def __init__(self, folder: Path) -> None:
        import cv2
        import openpyxl

        from acquire.recording import read_bundle, write_recording
        from acquire.recording.journal import JournalWriter
        from drivers.signals import Block, Channel, Frame

        book = openpyxl.Workbook()
        for row in TABLE.splitlines():
            book.active.append([cell if cell[0].isalpha() else float(cell) for cell in row.split(",")])
        book.save(folder / "data.xlsx")
        self.workbook = (folder / "data.xlsx").read_bytes()
        self.image = cv2.imencode(".png", np.arange(1200, dtype=np.uint8).reshape(30, 40))[1].tobytes()
        bundle = folder / "bundle"
        self.bundle(bundle)
        recording = read_bundle(bundle)
        self.hdf5 = write_recording(recording, folder / "run.h5").read_bytes()
        channels = [Channel("pressure", "Pa", "actuator"), Channel("apex_height", "m", "sensor")]
        with JournalWriter(folder / "run.journal", recording.info, channels) as journal:
            for k in range(20):
                time_axis = 0.1 * k + np.arange(10) / 100
                values = {"pressure": -100.0 * time_axis, "apex_height": 1e-4 * time_axis}
                journal.block(Block(values, np.arange(10) + 10 * k, time_axis, time_axis + 9))
                journal.frame(Frame(np.full((6, 8), k, np.uint8), k, 0.1 * k, 9 + 0.1 * k))
        self.journal = (folder / "run.journal").read_bytes()

    def bundle(self, folder: Path, **changed: bytes) -> Path:
        """The sound bundle, some of its files replaced."""
        folder.mkdir(parents=True)
        files = {
            "recording.yaml": BUNDLE.encode(),
            "data.csv": TABLE.encode(),
            "data.xlsx": self.workbook,
            "img_1.png": self.image,
            "img_2.png": self.image,
            "protocol.yaml": PROTOCOL.encode(),
        }
        for name, content in (files | changed).items():
            (folder / name).write_bytes(content)
        return folder


def kinds(samples: Samples) -> dict[str, Kind]:
    """All kinds of input by name."""

    def single(name: str, content: bytes, *arguments: str) -> Callable[[Path, np.random.Generator], list[str]]:
        def make(folder: Path, random: np.random.Generator) -> list[str]:
            (folder / name).write_bytes(spoiled(content, random))
            return [str(folder / name) if word == "FILE" else word for word in arguments]

        return make

    def bundled(name: str, spoil: Callable[[bytes, np.random.Generator], bytes] = spoiled) -> Callable[..., list[str]]:
        def make(folder: Path, random: np.random.Generator) -> list[str]:
            bundle = samples.bundle(folder / "bundle")
            (bundle / name).write_bytes(spoil((bundle / name).read_bytes(), random))
            return ["import", str(bundle), "-o", str(folder / "out")]

        return make

    def curves(folder: Path, random: np.random.Generator) -> list[str]:
        which = random.random() < 0.6
        (folder / "map.yaml").write_bytes(spoiled(MAP.encode(), random) if which else MAP.encode())
        (folder / "a.csv").write_bytes(TABLE.encode() if which else spoiled(TABLE.encode(), random))
        return ["import", str(folder / "a.csv"), "--map", str(folder / "map.yaml"), "-o", str(folder / "out")]

    def recording(folder: Path, random: np.random.Generator) -> list[str]:
        path = folder / "run.h5"
        path.write_bytes(spoil_hdf5(samples.hdf5, random, folder))
        options = [["show"], ["show", "--json"], ["export", "-o", str(folder / "out" / "b")], ["ls", "-d"]][
            random.integers(4)
        ]
        return [*options, str(folder) if "ls" in options else str(path)]

    def journal(folder: Path, random: np.random.Generator) -> list[str]:
        content = spoil_journal(samples.journal, random)
        if random.random() < 0.5:
            (folder / "run.journal").write_bytes(content)
            return ["show", str(folder / "run.journal")]
        out = folder / "out"  # a recovery puts the journal by, beside its recording
        out.mkdir()
        (out / "run.journal").write_bytes(content)
        return ["recover", str(out / "run.journal"), "-o", str(out / "r.h5")]

    def model(folder: Path, random: np.random.Generator) -> list[str]:
        text = spoiled(MODEL.encode(), random)
        # Cut before anything could run for long; a model is code of the user's own, not data of a stranger's.
        (folder / "model.py").write_bytes(text[: int(random.integers(len(MODEL) - 40))] + b"\n")
        (folder / "run.h5").write_bytes(samples.hdf5)
        name = ["Model", "Nothing", "", "__builtins__", "Model.name"][random.integers(5)]
        out = ["-o", str(folder / "out")]
        return ["gap", "diagnose", str(folder / "run.h5"), "--model", f"{folder / 'model.py'}:{name}", *out]

    def spec(folder: Path, random: np.random.Generator) -> list[str]:
        (folder / "spec.yaml").write_bytes(spoiled(SPEC.encode(), random))
        return ["<spec>", str(folder / "spec.yaml")]

    def names(folder: Path, random: np.random.Generator) -> list[str]:
        """Arguments that are no names of files, or numbers in other notations."""
        token = TOKENS[random.integers(len(TOKENS))].decode("utf-8", "surrogateescape").replace("\0", "")
        (folder / "circle").symlink_to(folder / "circle")
        places = [token, f"{folder}/{token}", f"{folder}/circle", f"{folder}/circle/run.h5", str(folder), "/dev/zero"]
        bad = places[random.integers(len(places))] or "x"
        out = ["-o", str(folder / "out")]
        run = ["run", "demo-cutometer", "--sim", *out]
        # None of them is a sound number: that would start a run.
        number = ["-3_0", "1e308", "nan", "inf", "0x1F", "1_0", "9" * 400, "\N{ARABIC-INDIC DIGIT THREE}"][
            random.integers(8)
        ]
        chosen = [
            *(["check", bad], ["show", bad], ["import", bad, *out], ["recover", bad], ["export", bad, *out]),
            *(
                ["report", bad, "-o", f"{folder}/out.html"],
                ["check", "demo-cutometer", "--station", bad],
                ["ls", "-d", bad],
            ),
            *(
                ["gap", "diagnose", bad, *out],
                ["gap", "plan", bad],
                [*run, "--speed", number],
                [*run, "--repeat", number],
            ),
            *([*run, "--effect", f"leak:conductance={number}_"], ["ls", f"{bad}=1", "-d", str(folder)]),
        ]
        return chosen[random.integers(len(chosen))]

    found = [
        Kind("protocol", single("p.yaml", PROTOCOL.encode(), "check", "FILE")),
        Kind("station", single("s.yaml", STATION.encode(), "check", "demo-cutometer", "--station", "FILE")),
        Kind("bundle", bundled("recording.yaml")),
        Kind("bundle's protocol", bundled("protocol.yaml")),
        Kind("CSV", bundled("data.csv")),
        Kind("XLSX", bundled("data.xlsx", spoil_workbook)),
        Kind("picture", bundled("img_2.png")),
        Kind("column map", curves),
        Kind("HDF5", recording),
        Kind("journal", journal),
        Kind("fit specification", spec),
        Kind("model file", model),
        Kind("argument", names),
    ]
    return {kind.name: kind for kind in found}
