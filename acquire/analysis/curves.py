"""The parameters that Cutometer users read off a curve: R0-R9, Q0-Q3 and Ue, Uv, Uf, Ur, Ua.

R and U parameters follow the definitions in the literature on the instrument. Those of the areas Q0-Q3 are partly
unpublished: the values computed here are this project's reading of them, and labelled so in `DEFINITIONS`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from acquire.analysis.cycles import Cycle, suction_cycles
from acquire.recording.model import FloatArray, Recording

IMMEDIATE = 0.1  # s after a step at which the immediate response is read
SLACK = 0.1  # s before the end of a phase from which on a last sample shows it whole: some pictures of a camera
STEP = 0.2  # s: a slower rise or fall is no step, and has no immediate response


@dataclass(frozen=True)
class Definition:
    """Unit (SI), meaning, and who defined a parameter: ``published`` or ``this project's reading``."""

    unit: str
    text: str
    source: str = "published"


_READING = "this project's reading"
DEFINITIONS: Mapping[str, Definition] = {
    "Ue": Definition("m", "immediate deformation, 0.1 s after suction began"),
    "Uv": Definition("m", "delayed deformation, Uf - Ue"),
    "Uf": Definition("m", "final deformation, the maximum of the first curve"),
    "Ur": Definition("m", "immediate retraction, 0.1 s after the release"),
    "Ua": Definition("m", "total recovery at the end of the first curve"),
    "R0": Definition("m", "Uf"),
    "R1": Definition("m", "residual deformation at the end of the first curve"),
    "R2": Definition("1", "gross elasticity, Ua/Uf"),
    "R3": Definition("m", "maximum of the last curve"),
    "R4": Definition("m", "residual deformation at the end of the last curve"),
    "R5": Definition("1", "net elasticity, Ur/Ue"),
    "R6": Definition("1", "viscous over elastic deformation, Uv/Ue"),
    "R7": Definition("1", "biological elasticity, Ur/Uf"),
    "R8": Definition("m", "Ua"),
    "R9": Definition("m", "fatigue over the curves, R3 - R0"),
    "Q0": Definition("m*s", "area of full recovery: Uf times the time of relaxation", _READING),
    "Q1": Definition("1", "overall elasticity: recovered area over Q0", _READING),
    "Q2": Definition("1", "elastic part of Q1: Ur held over the time of relaxation", _READING),
    "Q3": Definition("1", "viscous part of Q1: recovery beyond Ur", _READING),
}


def recording_parameters(recording: Recording) -> dict[str, float]:
    """`curve_parameters` of a suction recording; empty where there is no ``apex_height`` or no suction."""
    cycles = suction_cycles(recording)
    if "apex_height" not in recording.streams or not cycles:
        return {}
    height = recording.streams["apex_height"]
    return curve_parameters(height.time, height.value, cycles)


def curve_parameters(time: FloatArray, height: FloatArray, cycles: Sequence[Cycle]) -> dict[str, float]:
    """Every parameter of `DEFINITIONS` of curves ``height`` (n,) m over ``time`` (n,) s.

    Heights count from the one at the first onset, as the instrument zeroes itself there. A parameter that the curve
    cannot give is NaN: the immediate response of anything but a step, and whatever lies beyond the last sample. Only
    the recovery of the last curve may end earlier than commanded.
    """
    final = cycles[-1]
    cycles = (*cycles[:-1], replace(final, end=min(final.end, float(time[-1]))))
    first, last = cycles[0], cycles[-1]
    zero = _at(time, height, first.onset)
    top = _maximum(time, height, first) - zero
    residual = _end(time, height, first) - zero
    u: dict[str, float] = {"Ue": math.nan, "Ur": math.nan}
    if first.rise <= STEP and time[-1] >= first.onset + IMMEDIATE:
        u["Ue"] = _at(time, height, first.onset + IMMEDIATE) - zero
    if first.fall <= STEP and min(first.end, time[-1]) - first.release > IMMEDIATE:
        u["Ur"] = _at(time, height, first.release) - _at(time, height, first.release + IMMEDIATE)
    u |= {"Uf": top, "Uv": top - u["Ue"], "Ua": top - residual}
    r = relative_parameters(u["Ue"], u["Uf"], u["Ur"], residual)
    r |= {"R3": _maximum(time, height, last) - zero, "R4": _end(time, height, last) - zero}
    r["R9"] = r["R3"] - r["R0"]
    return {name: (u | r | _areas(time, height - zero, first, top, u["Ur"]))[name] for name in DEFINITIONS}


def relative_parameters(ue: float, uf: float, ur: float, residual: float) -> dict[str, float]:
    """R0, R1, R2, R5, R6, R7, R8 from the deformations of one curve (any unit of length)."""
    ua = uf - residual
    return {
        "R0": uf,
        "R1": residual,
        "R2": _ratio(ua, uf),
        "R5": _ratio(ur, ue),
        "R6": _ratio(uf - ue, ue),
        "R7": _ratio(ur, uf),
        "R8": ua,
    }


def identity_errors(parameters: Mapping[str, float]) -> dict[str, float]:
    """How far parameters (one's own, or published ones) are from the identities between them: each should be 0."""
    p = parameters
    errors = {
        "R2 = 1 - R1/R0": p["R2"] - (1 - _ratio(p["R1"], p["R0"])),
        "R7 = R5/(1 + R6)": p["R7"] - p["R5"] / (1 + p["R6"]),
        "R8 = R0 - R1": p["R8"] - (p["R0"] - p["R1"]),
        "R9 = R3 - R0": p["R9"] - (p["R3"] - p["R0"]),
    }
    if "Q1" in p:
        errors["Q1 = Q2 + Q3"] = p["Q1"] - (p["Q2"] + p["Q3"])
    return errors


def _areas(time: FloatArray, height: FloatArray, cycle: Cycle, top: float, retraction: float) -> dict[str, float]:
    """Areas of the recovery from the release to the end of the curve."""
    duration = cycle.end - cycle.release
    inside = (time > cycle.release) & (time < cycle.end)
    if duration <= IMMEDIATE or np.count_nonzero(inside) < 3 or not _recorded(time, cycle.end):
        return dict.fromkeys(("Q0", "Q1", "Q2", "Q3"), math.nan)
    t = np.concatenate([[cycle.release], time[inside], [cycle.end]])
    recovered = _at(time, height, cycle.release) - np.interp(t, time, height)
    full, total = top * duration, float(np.trapezoid(recovered, t))
    elastic = retraction * duration
    return {
        "Q0": full,
        "Q1": _ratio(total, full),
        "Q2": _ratio(elastic, full),
        "Q3": _ratio(total - elastic, full),
    }


def _at(time: FloatArray, height: FloatArray, moment: float) -> float:
    return float(np.interp(moment, time, height))


def _recorded(time: FloatArray, moment: float) -> bool:
    """Whether the samples go on until ``moment``, or just before it."""
    return bool(time[-1] >= moment - SLACK)


def _maximum(time: FloatArray, height: FloatArray, cycle: Cycle) -> float:
    """Greatest height of a curve whose suction was recorded to its end."""
    inside = (time >= cycle.onset) & (time <= cycle.release + max(cycle.fall, IMMEDIATE))
    return float(height[inside].max()) if inside.any() and _recorded(time, cycle.release) else math.nan


def _end(time: FloatArray, height: FloatArray, cycle: Cycle) -> float:
    """Height at the end of a curve: the median of its last 50 ms, at least of its last sample."""
    if cycle.end <= cycle.release + cycle.fall or not _recorded(time, cycle.end):
        return math.nan
    last = (time >= cycle.end - 0.05) & (time <= cycle.end)
    return float(np.median(height[last])) if last.any() else _at(time, height, cycle.end)


def _ratio(a: float, b: float) -> float:
    return a / b if b else math.nan
