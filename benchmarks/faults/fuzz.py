"""Decoders fed with damaged bytes: codecs, the camera's frames, the journal's reader, YAML and bundles.

Each may refuse (a ValueError), and nothing else. Where atheris is installed, `python -m benchmarks.faults.fuzz TARGET`
lets it look for inputs by coverage; the campaign itself mutates sound inputs, seeded.
"""

from __future__ import annotations

import itertools
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from benchmarks.faults.inputs import BUNDLE, PROTOCOL, STATION, Samples
from benchmarks.faults.mutate import spoil_journal, spoiled
from benchmarks.faults.table import Campaign, Row

#: Executions in the full campaign by kind of target: codecs are quick, a journal is a file, YAML takes 10 ms in Python
#: alone. They grow with the cube of the share: a tenth makes ten thousand of the first kind.
FULL = {"codec": 10_000_000, "journal": 1_000_000, "YAML": 300_000}


def targets(folder: Path) -> dict[str, tuple[Callable[[bytes], object], list[bytes]]]:
    """Name -> what decodes, and sound inputs."""
    from acquire.recording import read_journal
    from acquire.recording.bundle_schema import Bundle
    from acquire.station import Station
    from drivers import messages as msg
    from drivers.aspiration.framelink import FrameDecoder, Picture, encode
    from drivers.aspiration.pressure import PressureCodec
    from drivers.cutometer.codec import CutometerCodec
    from drivers.microrobot.codec import MicrorobotCodec
    from protocols.schema import Protocol
    from protocols.source import read
    from protocols.text import validate

    journal = folder / "fuzzed.journal"

    def journals(data: bytes) -> object:
        journal.write_bytes(data)
        return read_journal(journal)

    def yaml(model: type) -> Callable[[bytes], object]:
        def load(data: bytes) -> object:
            found, source = read(data.decode("utf-8", "replace") + "\n")
            return validate(model, found, source)

        return load

    found: dict[str, tuple[Callable[[bytes], object], list[bytes]]] = {}
    bodies = [msg.Beat(7), msg.Request(1, msg.Identify()), msg.Request(2, msg.Stream(True)), msg.Request(3, msg.Safe())]
    for name, codec in (("cutometer", CutometerCodec), ("pressure", PressureCodec), ("robot", MicrorobotCodec)):
        sound = [codec().encode(body) for body in bodies]
        # One decoder for all: what it keeps of one input must not harm it in the next.
        found[f"codec: {name}"] = (codec().decode, [*sound, b"".join(sound)])
    picture = encode(Picture(np.zeros((4, 5), np.uint8), 1, 0.5))
    found["codec: frames"] = (FrameDecoder().feed, [picture, picture + picture])
    found["journal"] = (journals, [Samples(folder).journal])
    found["YAML: protocol"] = (yaml(Protocol), [PROTOCOL.encode()])
    found["YAML: station"] = (yaml(Station), [STATION.encode()])
    found["YAML: bundle"] = (yaml(Bundle), [BUNDLE.encode()])
    return found


def rows(campaign: Campaign) -> Iterator[Row]:
    """A row a target."""
    with tempfile.TemporaryDirectory(prefix="faults-") as name:
        for target, (decode, seeds) in targets(Path(name)).items():
            random = campaign.random(target)
            spoil = spoil_journal if target == "journal" else spoiled
            row = Row(f"fuzzing, {target}", "takes it, or refuses it with a ValueError")
            began = time.monotonic()
            for number in range(max(200, round(FULL[target.split(":")[0]] * campaign.share**3))):
                data = spoil(seeds[number % len(seeds)], random)
                row.trial(problem=_problem(decode, data))
            row.must += f" ({row.trials / (time.monotonic() - began):.0f} executions/s)"
            yield row


def _problem(decode: Callable[[bytes], object], data: bytes) -> str:
    try:
        decode(data)
    except ValueError:
        pass
    except Exception as error:  # whatever it is, it would be a traceback
        return f"{type(error).__name__}: {error} for {data[:60]!r}"
    return ""


def main(arguments: list[str]) -> None:
    """Fuzz one target by coverage until it is stopped. Raises ImportError without atheris."""
    import atheris

    with tempfile.TemporaryDirectory(prefix="faults-") as name:
        with atheris.instrument_imports(include=["acquire", "drivers", "protocols"]):
            known = targets(Path(name))
        decode, seeds = known[arguments[1]]
        corpus = Path(name) / "corpus"
        corpus.mkdir()
        for number, seed in zip(itertools.count(), seeds, strict=False):
            (corpus / str(number)).write_bytes(seed)

        def once(data: bytes) -> None:
            problem = _problem(decode, data)
            if problem:
                raise AssertionError(problem)

        atheris.Setup([arguments[0], *arguments[2:], str(corpus)], once)
        atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv)
