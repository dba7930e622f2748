"""An experiment that a diagnosis asks for, as files: schema ``gap-experiment/1``.

A folder of it holds ``experiment.yaml``, ``protocol.yaml`` (for `acquire run`) and ``setpoints.csv`` (``t`` in s from
its start; ``pressure`` in Pa, or ``x,y,z`` in m; straight lines between the rows).
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from acquire.files import write_text
from acquire.recording.model import Recording
from gap.design.simulated import Leg
from sim_devices.chain import FloatArray

SCHEMA = "gap-experiment/1"
EXPERIMENT, PROTOCOL, SETPOINTS = "experiment.yaml", "protocol.yaml", "setpoints.csv"
COLUMNS = {"pressure": "pressure", "probe_x": "x", "probe_y": "y", "probe_z": "z"}
"""Column of each commanded quantity in ``setpoints.csv``."""
SAME = 0.05
"""Difference of set-points (rms, in parts of their range) from which a recording is no answer."""
LONGER = 0.5
"""Share of its duration by which an answer may be cut short."""


class ExperimentError(ValueError):
    """An experiment that cannot be read, or that this instrument cannot do; the message names file and reason."""


@dataclass(frozen=True)
class Experiment:
    """An experiment to do next. ``steps`` are those of its protocol, ``leg`` its compiled set-points.

    ``rest_before`` s is how long skin (or whatever stands there) is left alone before; ``minutes`` are of bench time,
    handling included. ``separates`` are the effects between which it decides, ``right_before`` and ``right_after`` the
    probability that the most probable cause is the right one, ``information`` bits.
    """

    instrument: str
    specimen: str
    waveform: str
    steps: tuple[Mapping[str, Any], ...]
    leg: Leg = field(repr=False)
    specimen_properties: Mapping[str, Any] = field(default_factory=dict)
    repeats: int = 1
    rest_before: float = 60.0
    minutes: float = 0.0
    separates: tuple[str, ...] = ()
    right_before: float = 0.0
    right_after: float = 0.0
    information: float = 0.0
    seed: int = 1

    @property
    def id(self) -> str:
        """Tells the experiment by itself, so that an answer can be checked without these files: `fault_by_id`."""
        said = "_".join([self.instrument, *self.specimen.split()])
        asked = [self.waveform, list(self.steps), dict(self.specimen_properties), self.repeats, self.seed]
        of = _digest(json.dumps(asked, sort_keys=True))
        said += f"-{peak(self.leg.quantity_tables):.6g}-{self.leg.duration:.4g}-{of}"
        return f"{said}-{_digest(said)}"

    def valued(self, information: float, before: float, after: float, separates: tuple[str, ...]) -> Experiment:
        """The same with the information expected of it."""
        return replace(self, information=information, right_before=before, right_after=after, separates=separates)

    def as_dict(self) -> dict[str, Any]:
        """The contents of ``experiment.yaml``."""
        return {
            "schema": SCHEMA,
            "id": self.id,
            "stop": False,
            "instrument": self.instrument,
            "specimen": self.specimen,
            "specimen_properties": dict(self.specimen_properties),
            "waveform": self.waveform,
            "repeats": self.repeats,
            "rest_before": round(self.rest_before, 1),
            "minutes": round(self.minutes, 2),
            "separates": list(self.separates),
            "probability_right": round(self.right_after, 3),
            "probability_right_before": round(self.right_before, 3),
            "information": round(self.information, 3),
            "cost": {
                "bench_minutes": round(self.minutes, 2),
                "bits_per_minute": round(self.information / max(self.minutes, 1e-9), 3),
            },
            "seed": self.seed,
        }


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:6]


def peak(quantities: Mapping[str, tuple[FloatArray, FloatArray]]) -> float:
    """The largest value that is commanded, Pa or m."""
    return max((float(np.max(np.abs(v), initial=0.0)) for _, v in quantities.values()), default=0.0)


def stopped(instrument: str, reason: str, probability: float = 0.0) -> dict[str, Any]:
    """The contents of ``experiment.yaml`` where nothing is asked for, for ``reason``."""
    return {
        "schema": SCHEMA, "id": "", "stop": True, "reason": reason, "instrument": instrument, "specimen": "",
        "repeats": 0, "rest_before": 0.0, "minutes": 0.0, "separates": [],
        "probability_right": round(probability, 3), "cost": {"bench_minutes": 0.0},
    }  # fmt: skip


def protocol_of(instrument: str, name: str, title: str, steps: tuple[Mapping[str, Any], ...]) -> dict[str, Any]:
    """A ``protocol/1`` of some steps."""
    return {
        "schema": "protocol/1",
        "name": name,
        "title": title,
        "instrument": instrument,
        "steps": [dict(s) for s in steps],
    }


def write(experiment: Experiment, folder: Path) -> None:
    """The three files of an experiment. Raises CannotWrite."""
    title = f"{experiment.specimen}: {experiment.waveform}"
    protocol = protocol_of(experiment.instrument, f"gap-{experiment.id}", title, experiment.steps)
    write_text(folder / PROTOCOL, yaml.safe_dump(protocol, sort_keys=False))
    write_text(folder / SETPOINTS, _csv(experiment.leg))
    write_text(folder / EXPERIMENT, yaml.safe_dump(experiment.as_dict(), sort_keys=False))


def _csv(leg: Leg) -> str:
    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow(["t", *(COLUMNS[q] for q in leg.quantity_tables)])
    tables = list(leg.quantity_tables.values())
    for k, t in enumerate(tables[0][0]):
        rows.writerow([f"{t:.6g}", *(f"{v[k] + 0.0:.9g}" for _, v in tables)])
    return out.getvalue()


@dataclass(frozen=True)
class Asked:
    """The request in an experiment's files: all that tells whether a recording answers it."""

    id: str
    instrument: str
    specimen: str
    quantities: Mapping[str, tuple[FloatArray, FloatArray]]
    where: str


def read(folder: Path) -> Asked:
    """The experiment in ``folder`` (or whose ``experiment.yaml`` is given). Raises ExperimentError that names the file
    and what is wrong."""
    path = folder if folder.is_file() else folder / EXPERIMENT
    try:
        said = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise ExperimentError(f"{path}: cannot be read: {error}") from None
    except yaml.YAMLError as error:
        raise ExperimentError(f"{path}: is not YAML: {error}") from None
    if not isinstance(said, dict) or said.get("schema") != SCHEMA:
        raise ExperimentError(f"{path}: is not of schema {SCHEMA}")
    if said.get("stop"):
        raise ExperimentError(f"{path}: asks for nothing: {said.get('reason', 'stop')}")
    for key in ("id", "instrument", "specimen"):
        if not isinstance(said.get(key), str) or not said[key]:
            raise ExperimentError(f"{path}: {key} is missing")
    return Asked(said["id"], said["instrument"], said["specimen"], _table(path.with_name(SETPOINTS)), str(path))


def _table(path: Path) -> dict[str, tuple[FloatArray, FloatArray]]:
    try:
        with path.open(encoding="utf-8", newline="") as file:
            header, *rows = list(csv.reader(file))
        values = np.array([[float(x) for x in row] for row in rows if row])
    except (OSError, ValueError, UnicodeDecodeError) as error:
        raise ExperimentError(f"{path}: is no table of set-points: {error}") from None
    names = {column: quantity for quantity, column in COLUMNS.items()}
    if values.ndim != 2 or len(values) < 2 or header[:1] != ["t"] or not set(header[1:]) <= names.keys():
        raise ExperimentError(f"{path}: needs columns t and pressure, or t, x, y and z, and two rows at least")
    if not np.isfinite(values).all() or np.any(np.diff(values[:, 0]) < 0):
        raise ExperimentError(f"{path}: times must not fall, and every value must be a number")
    return {names[c]: (values[:, 0], values[:, 1 + k]) for k, c in enumerate(header[1:])}


_ID = re.compile(
    r"(?P<said>(?P<on>[a-z]+(_[a-z]+)+)-(?P<peak>\d+(\.\d+)?)-(?P<duration>\d+(\.\d+)?)-[0-9a-f]{6})-(?P<seal>[0-9a-f]{6})"
)


def fault_by_id(recording: Recording) -> str:
    """The same by an experiment's id alone, which says specimen, largest set-point and duration."""
    found = _ID.fullmatch(recording.info.experiment)
    if found is None or _digest(found["said"]) != found["seal"]:
        return "no experiment of that id is known"
    instrument, *specimen = found["on"].split("_")
    series = recording.setpoints.values()
    done = {str(k): (np.asarray(s.time, float), np.asarray(s.value, float)) for k, s in enumerate(series)}
    wanted = Asked("", instrument, " ".join(specimen), {}, "")
    if other := fault(recording, wanted):
        return other
    size, asked = peak(done), float(found["peak"])
    if abs(size - asked) > SAME * max(asked, 1e-12):
        return f"its largest set-point is {size:.4g}, and {asked:.4g} was asked for"
    length = max((float(t[-1] - t[0]) for t, _ in done.values() if len(t)), default=0.0)
    if length < LONGER * float(found["duration"]):
        return f"it lasts {length:.3g} s, and {found['duration']} s were asked for"
    return ""


def fault(recording: Recording, asked: Asked) -> str:
    """In which respect a recording is no answer to an experiment, in words; '' where it is one."""
    if recording.info.instrument != asked.instrument:
        return f"it is of the {recording.info.instrument}, not of the {asked.instrument}"
    if recording.info.specimen != asked.specimen:
        return f"it is of {recording.info.specimen!r}, and {asked.specimen!r} was asked for"
    for quantity, (time, value) in asked.quantities.items():
        done = recording.setpoints.get(quantity)
        if done is None or not len(done.time):
            return f"it has no set-points of {quantity}"
        if (off := _off(np.asarray(done.time, float), np.asarray(done.value, float), time, value)) > SAME:
            return f"its set-points of {quantity} are {100 * off:.0f} % of their range off the experiment's"
    return ""


def _off(time: FloatArray, value: FloatArray, asked_time: FloatArray, asked: FloatArray) -> float:
    """rms difference of a command from the experiment's, in parts of its range, at the best shift of its start.

    Where rest was asked for, any set-point but nought is wholly off.
    """
    size = float(np.max(np.abs(asked)))
    if size == 0:
        return float(np.any(value))
    begun = int(np.argmax(np.abs(value) > 0.01 * size))
    if abs(value[begun]) <= 0.01 * size:  # it never began
        return 1.0
    grid = np.arange(asked_time[0], asked_time[-1], 0.02)
    wanted = np.interp(grid, asked_time, asked)
    around = slice(max(begun - 1, 0), begun + 1)
    first = float(np.interp(0.01 * size, np.abs(value[around]), time[around]))
    onset = grid[int(np.argmax(np.abs(wanted) > 0.01 * size))]
    shifts = first - onset + np.linspace(-0.3, 0.3, 31)
    return min(float(np.sqrt(np.mean(np.square(np.interp(grid + s, time, value) - wanted)))) for s in shifts) / size
