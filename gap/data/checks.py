"""Whether recordings can be diagnosed together, and their weak points."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence

import numpy as np
import yaml

from acquire.recording.model import Recording, Series
from acquire.recording.possible import impossible
from gap.data.session import REST, SKIN, Session
from protocols import units
from sim_devices.stages.suction import OPENING


class DiagnosisError(ValueError):
    """The recordings cannot be diagnosed at all: the message names the recording and the channel."""


def in_order(recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings by their session clock. Raises DiagnosisError for none, or for several instruments."""
    if not recordings:
        raise DiagnosisError("no recording to diagnose")
    instruments = {r.info.instrument for r in recordings}
    if len(instruments) > 1:
        raise DiagnosisError(
            f"recordings of several instruments ({', '.join(sorted(instruments))}): diagnose each apart"
        )
    for r in recordings:
        if not r.streams:
            raise DiagnosisError(f"recording {r.info.id} has no measured channel")
    return sorted(recordings, key=lambda r: (r.info.start_time, _first_time(r)))


def of_one_skin(recordings: Sequence[Recording]) -> tuple[list[Recording], list[str]]:
    """Recordings in order, without those on skin of another subject or site than most of them have (as many: than the
    first has), and a remark for each such skin: it is another tissue, and would be told a change of this one. An empty
    subject or site is that of the others."""
    whose = [(r.info.subject, r.info.site) for r in recordings if r.info.specimen == SKIN]
    own = max(dict.fromkeys(whose), key=whose.count, default=("", ""))
    others = [w for w in dict.fromkeys(whose) if any(a and b and a != b for a, b in zip(w, own, strict=True))]
    kept = [r for r in recordings if r.info.specimen != SKIN or (r.info.subject, r.info.site) not in others]
    told = [
        f"skin of {', '.join(filter(None, w))} is left out ({whose.count(w)} of {len(whose)} recordings on skin):"
        " diagnose it apart"
        for w in others
    ]
    return kept, told


def refuse_impossible(recordings: Sequence[Recording]) -> None:
    """Refuse values that no probe or pump can give, and sensors that stand still while skin is moved.

    For the built-in instruments. Raises DiagnosisError that names the recording and the channel.
    """
    for r in recordings:
        for name, series in r.streams.items():
            worst, reason = impossible(name, series.value)
            if reason:
                reached = f"{series.value[worst]:.3g} {series.unit}"
                raise DiagnosisError(f"{r.info.id}: channel {name} reaches {reached}: {reason}; a wrong unit?")
    moved = [r for r in recordings if r.info.specimen == "skin" and any(map(_moves, r.setpoints.values()))]
    for channels in _responses(moved):
        if not any(_moves(r.streams[name]) for r in moved for name in channels & r.streams.keys()):
            names = ", ".join(sorted(channels))
            raise DiagnosisError(
                f"{names} never changes in {len(moved)} recordings whose set-points do: not connected?"
            )


def _responses(recordings: Sequence[Recording]) -> list[set[str]]:
    """Channels of which one at least must move where a set-point does: the actuator's own; the sensors' together."""
    streams = [(name, s.stage, r) for r in recordings for name, s in r.streams.items()]
    commanded = [{name} for name in {n for n, stage, r in streams if stage == "actuator" and n in r.setpoints}]
    sensors = {name for name, stage, _ in streams if stage == "sensor"}
    return [*commanded, sensors] if sensors else commanded


def _moves(series: Series) -> bool:
    value = series.value[np.isfinite(series.value)]
    return bool(value.size) and float(np.ptp(value)) > 0


def _first_time(recording: Recording) -> float:
    return min((float(s.time[0]) for s in recording.streams.values() if len(s.time)), default=0.0)


def remarks(recordings: Sequence[Recording], one_clock: bool) -> list[str]:
    """Weaknesses of the data, in plain words; ``one_clock`` is whether rests between recordings matter."""
    out = []
    for r in recordings:
        for name, s in r.streams.items():
            bad = int(np.sum(~np.isfinite(s.value)))
            if bad:
                out.append(
                    f"{r.info.id}: channel {name} has {bad} of {len(s.value)} samples that are not numbers; left out"
                )
            if len(s.time) > 1 and np.any(np.diff(s.time) <= 0):
                out.append(f"{r.info.id}: time stamps of {name} do not always increase")
    out += _openings(recordings)
    if one_clock and Session(recordings).rests_assumed:
        apart = "recordings' clocks begin anew, and their start times do not say how far apart"
        out.append(f"{apart}: rests of {REST:.0f} s between them are assumed")
    if len(recordings) == 1:
        out.append(
            "one recording only: no repeat to take the noise from, and shrinkage on unused data cannot be tested"
        )
    return out


def stated_opening(recording: Recording) -> float:
    """Diameter in m of the probe's opening, as the recording's calibration or its protocol states it; NaN if neither.

    A recording of ours has in its calibration what the protocol or the station states; a bundle may write either.
    """
    known = recording.info.calibration.get("opening", {})
    with contextlib.suppress(ValueError, TypeError, KeyError):
        unit, factor, _ = units.to_si(str(known["unit"]))
        if unit == "m":
            return factor * float(known["value"])
    with contextlib.suppress(ValueError, yaml.YAMLError):  # in words of another's protocol
        protocol = yaml.safe_load(recording.info.protocol or "")
        said = protocol if isinstance(protocol, dict) else {}
        setup = said.get("setup", said)
        return units.parse(setup["opening"], "length") if isinstance(setup, dict) and "opening" in setup else math.nan
    return math.nan


def _openings(recordings: Sequence[Recording]) -> list[str]:
    """A remark on each opening that is stated and is not the assumed one."""
    stated: dict[str, list[str]] = {}
    for r in recordings:
        assumed, opening = OPENING.get(r.info.instrument, math.nan), stated_opening(r)
        if abs(opening - assumed) > 0.01 * assumed:  # False for NaN
            told = f"an opening of {1e3 * opening:g} mm is stated, but {1e3 * assumed:g} mm is assumed"
            stated.setdefault(told, []).append(r.info.id)
    reason = "thresholds of some tissue effects are scaled by it"
    return [f"{', '.join(ids)}: {told}: {reason}" for told, ids in stated.items()]
