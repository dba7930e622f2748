"""A case's hidden rig as plain data, so that it can be measured on again later; and the answer to an experiment.

An answer is recorded after everything before it, answers included, when the experiment's rest is over: skin goes on
recovering meanwhile. An experiment that the rig cannot do is refused.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from . import robot
from .bundle import write_recording
from .laboratory import Laboratory, Noise
from .lock import seal, unseal
from .session import JUMP, REST_STEP, STEP, Recording, Session, grid
from .signals import Array
from .specimens import appended, specimens_of, start_after, usual
from .strength import SCATTER, Subject
from .suction import Channels

REFERENCES: Sequence[str] = ("some", "none", "standard")
"""Reference recordings of a case: of some kinds in two of five, none, or the laboratory's standard set."""
MOST = {"cutometer": 500e2, "aspiration": 700e2, "microrobot": 1.5e-3}
"""Pa of suction or m of travel that a rig reaches."""
LONGEST = 600.0
"""s that a recording lasts at most."""


class Refused(ValueError):
    """An experiment that cannot be read, or that the rig cannot do; the message says why."""


def as_plain(subject: Subject, knobs: Mapping[str, float], person: str, site: str) -> dict[str, Any]:
    """Everything that the recordings of a case follow from, for JSON."""
    s = subject.session
    return {
        "instrument": s.instrument, "recordings": [asdict(r) for r in s.recordings], "lab": asdict(s.lab),
        "before": list(s.before), "span": s.span, "law": subject.law, "tissue": dict(subject.tissue),
        "scatter": subject.scatter.tolist(), "tolerance": dict(subject.tolerance), "seed": subject.seed,
        "knobs": dict(knobs), "person": person, "site": site,
    }  # fmt: skip


def _tuples(x: Any) -> Any:
    return tuple(_tuples(v) for v in x) if isinstance(x, list | tuple) else x


def from_plain(plain: Mapping[str, Any]) -> Subject:
    """The rig with the session as it was recorded."""
    recordings = tuple(Recording(**{k: _tuples(v) for k, v in r.items()}) for r in plain["recordings"])
    noise = {k: Noise(**v) for k, v in plain["lab"]["noise"].items()}
    lab = Laboratory(**{**plain["lab"], "noise": noise})
    steps = (5e-3, 5e-3) if plain["instrument"] == "microrobot" else (REST_STEP, STEP)
    before = _tuples(plain["before"])
    session = Session(plain["instrument"], recordings, lab, *grid(recordings, *steps), before, plain["span"])
    return Subject(
        session, plain["law"], plain["tissue"], np.array(plain["scatter"]), plain["tolerance"], plain["seed"]
    )


@dataclass(frozen=True)
class Asked:
    """An experiment as its files ask for it."""

    id: str
    specimen: str
    rest: float
    properties: tuple[tuple[str, tuple[tuple[float, ...], float, str]], ...]
    t: Array
    values: Array  # (n, 1) Pa of suction, or (n, 3) m


def read(folder: Path, instrument: str) -> Asked:
    """The experiment in ``folder``, for an instrument. Raises Refused."""
    path, table_path = folder / "experiment.yaml", folder / "setpoints.csv"
    try:
        said = yaml.safe_load(path.read_text(encoding="utf-8"))
        if isinstance(said, dict) and said.get("stop"):
            why = f": {said['reason']}" if said.get("reason") else ""
            raise Refused(f"{folder} says to stop: there is nothing to measure{why}")
        with table_path.open(encoding="utf-8", newline="") as file:
            header, *rows = [row for row in csv.reader(file) if row]
        table = np.array([[float(x) for x in row] for row in rows])
    except Refused:
        raise
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise Refused(f"{folder}: is no experiment: {error}") from None
    specimen, rest = _described(path, said, instrument)
    t, values = _setpoints(table_path, header, table, instrument)
    return Asked(str(said["id"]), specimen, rest, tuple(usual(specimen, instrument).items()), t, values)


def _described(path: Path, said: Any, instrument: str) -> tuple[str, float]:
    """The specimen, and the rest (s) before it, that the description of an experiment asks for."""
    if not isinstance(said, dict) or said.get("schema") != "gap-experiment/1" or not said.get("id"):
        raise Refused(f"{path}: is no experiment of schema gap-experiment/1 that asks for something")
    if said.get("instrument", instrument) != instrument:
        raise Refused(f"{path}: is for the {said['instrument']}, and this is a {instrument}")
    specimen = str(said.get("specimen", ""))
    if specimen not in ("skin", *specimens_of(instrument)):
        raise Refused(f"{path}: this rig has no {specimen!r}; it has skin, {', '.join(specimens_of(instrument))}")
    rest = float(said.get("rest_before") or 0.0)
    if not 0 <= rest <= 3600:
        raise Refused(f"{path}: rest_before is {rest:g} s; this rig waits up to an hour")
    return specimen, rest


def _setpoints(path: Path, header: list[str], table: Array, instrument: str) -> tuple[Array, Array]:
    """Times from 0 on (n,) s and set-points (n, 1) Pa of suction or (n, 3) m of a table that the rig can follow."""
    robotic = instrument == "microrobot"
    columns = ["t", "x", "y", "z"] if robotic else ["t", "pressure"]
    if header != columns or table.ndim != 2 or len(table) < 2 or not np.isfinite(table).all():
        raise Refused(f"{path}: needs the columns {', '.join(columns)}, and numbers in two rows")
    t, values = table[:, 0] - table[0, 0], table[:, 1:] * (1.0 if robotic else -1.0)
    if np.any(np.diff(t) < 0) or not 0 < t[-1] <= LONGEST:
        raise Refused(f"{path}: times must not fall, and the last be at most {LONGEST:g} s")
    largest = float(np.max(np.linalg.norm(values, axis=1)))
    if largest > MOST[instrument] * (1 + 1e-9) or (not robotic and float(values.min()) < 0):
        raise Refused(f"{path}: {largest:g} is beyond {MOST[instrument]:g}, which this rig reaches")
    return t, values


def _pieces(asked: Asked, start: float, robotic: bool) -> list[Recording]:
    """The experiment as recordings one after the other, each along a line through the centre."""
    cuts = _turns(asked) if robotic else [0, len(asked.t) - 1]
    made = []
    for a, b in pairwise(cuts):
        t, v = asked.t[a : b + 1] - asked.t[a], asked.values[a : b + 1]
        size = np.linalg.norm(v, axis=1)
        tip = v[int(np.argmax(size))]
        way = tip / max(float(np.linalg.norm(tip)), 1e-12) if robotic else np.zeros(3)
        if robotic and float(np.max(np.abs(v - np.outer(v @ way, way)))) > 1e-6:
            raise Refused("set-points: this rig moves along straight lines through the centre, one after the other")
        scalar = v @ way if robotic else v[:, 0]
        later = t + JUMP * np.concatenate([[0.0], np.cumsum(np.diff(t) < JUMP)])  # a step is a short ramp
        # The sum of several short ramps must not reach into the next piece, which begins where this one ends.
        later = np.minimum(later, t[-1])
        corners = tuple(zip(later.tolist(), scalar.tolist(), strict=True))
        moving = np.flatnonzero(size > 0.01 * max(float(size.max()), 1e-12)) if size.max() > 0 else np.zeros(0, int)
        onset = float(t[max(moving[0] - 1, 0)]) if len(moving) else 0.0
        made.append(
            Recording(
                round(start + float(asked.t[a]), 4), float(t[-1]), corners, onset, "ramp answer", 1, asked.specimen,
                (float(way[0]), float(way[1]), float(way[2])), properties=asked.properties, experiment=asked.id,
            )
        )  # fmt: skip
    return made


def _turns(asked: Asked) -> list[int]:
    """Rows between which the tip moves along one line."""
    cuts, way = [0], None
    for k, v in enumerate(asked.values):
        length = float(np.linalg.norm(v))
        if length < 1e-9:
            continue
        here = v / length
        if way is not None and abs(abs(float(here @ way)) - 1.0) > 1e-6:
            cuts.append(k - 1)
        way = here
    return [*cuts, len(asked.t) - 1]


def answer(subject: Subject, knobs: Mapping[str, float], asked: Asked, out: Path, person: str, site: str) -> Subject:
    """Carry out the experiment on the rig and write the recording as a bundle into ``out``; the rig afterwards."""
    before = subject.session
    pieces = _pieces(asked, start_after(before, asked.rest), before.instrument == "microrobot")
    after = appended(before, *pieces)
    first = len(before.recordings)
    rng = np.random.default_rng((subject.seed, first))
    own = np.exp((SCATTER["ramp"] if asked.specimen == "skin" else 0.0) * rng.normal())
    scatter = np.concatenate([subject.scatter, np.full(len(pieces), own)])
    done = replace(subject, session=after, scatter=scatter)
    channels = done.record(knobs, noisy=True)
    whole, merged = _merged(after, channels, first)
    write_recording(out, whole, first, merged, person, site)
    return done


def _merged(s: Session, channels: Channels, first: int) -> tuple[Session, Channels]:
    """The pieces from ``first`` on as one recording."""
    pieces = s.recordings[first:]
    joined = {c: [*xs[:first], np.concatenate(xs[first:])] for c, xs in channels.items()}
    end = pieces[-1].start + pieces[-1].duration
    whole = replace(pieces[0], duration=end - pieces[0].start)
    if len(pieces) == 1:
        return s, joined
    stamps = np.concatenate([s.stamps(k) for k in range(first, len(s.recordings))])
    return _Joined(**{**vars(s), "recordings": (*s.recordings[:first], whole), "at": stamps, "pieces": pieces}), joined


@dataclass(frozen=True)
class _Joined(Session):
    """A session whose last recording is made of pieces in several directions."""

    at: Array | None = None
    pieces: tuple[Recording, ...] = ()

    def stamps(self, k: int) -> Array:
        return super().stamps(k) if k < len(self.recordings) - 1 or self.at is None else self.at

    def commanded(self, k: int) -> tuple[Array, dict[str, Array]]:
        if k < len(self.recordings) - 1:
            return super().commanded(k)
        parts = [
            (r.start + np.array(r.corners)[:, 0], np.outer(np.array(r.corners)[:, 1], r.direction)) for r in self.pieces
        ]
        t, v = np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
        return t, dict(zip(robot.PROBE, v.T, strict=True))


def perform(case: Path, experiment: Path, out: Path, passphrase: str = "", history: Path | None = None) -> Path:
    """The answer of a blind ``case`` (a folder made by `make`) to an ``experiment`` (a folder of its files), as a
    bundle in the new folder ``out``. Earlier answers of the case are part of its ``history``, a sealed file that is
    beside the key unless another is named.

    Raises Refused, FileNotFoundError without the key, FileExistsError if ``out`` exists.
    """
    if out.exists():
        raise FileExistsError(f"{out} exists")
    keys = case.resolve().parent.with_name(case.resolve().parent.name + "-key")
    path, now = keys / "key.bin", history or keys / f"{case.name}.bin"
    if not path.exists():
        raise FileNotFoundError(f"{path}: the key of {case} is not there")
    if now.exists():
        plain = json.loads(unseal(now.read_bytes(), passphrase))
    else:
        cases = json.loads(unseal(path.read_bytes(), passphrase))["cases"]
        plain = next((c.get("rig") for c in cases if c["case"] == case.name), None)
        if not plain:
            raise Refused(f"{path}: holds no rig of {case.name}: it was made by an earlier version, or by tier T0")
    subject = from_plain(plain)
    asked = read(experiment, subject.session.instrument)
    done = answer(subject, plain["knobs"], asked, out, plain["person"], plain["site"])
    later = as_plain(done, plain["knobs"], plain["person"], plain["site"])
    now.parent.mkdir(parents=True, exist_ok=True)
    now.write_bytes(seal(json.dumps(later).encode(), passphrase))
    for name in ("experiment.yaml", "setpoints.csv"):
        (out / name).write_bytes((experiment / name).read_bytes())
    return out
