"""The diagnosis as JSON (`gap-report/1`) and in three sentences."""

from __future__ import annotations

from typing import Any

import numpy as np

from gap.data.labels import LABELS
from gap.data.signatures import HUM
from gap.decision.transfer import shrink
from gap.decision.verdict import Cause, Verdict, unknown
from gap.diagnosis import Diagnosis
from gap.inference.hypothesis import Candidate, from_unit

SCHEMA = "gap-report/1"
UNKNOWN_NEXT = "What acts is not known: the pictures show where to look, and an effect of your own can be added."


def as_json(d: Diagnosis) -> dict[str, Any]:
    """The report as plain JSON types; the contract of gap-report/1."""
    v = d.verdict
    return {
        "schema": SCHEMA,
        "verdict": v.verdict,
        "sentences": sentences(d),
        "gap": {
            "before": _round(d.gap_before),
            "after": _round(d.gap_after),
            "noise_floor": 1.0,
            "by": breakdown(d),
        },
        "where": [{"stage": s, "probability": _round(p)} for s, p in v.stages.items()],
        "causes": [_cause(d, c, k) for k, c in enumerate(v.causes[: len(d.shrinks)])],
        "none_probability": _round(v.probability_none),
        "unknown_probability": _round(unknown_probability(v)),
        "unexplained": _round(v.unexplained),
        "indistinguishable": [list(g) for g in d.confusable],
        "undetectable_below": {k: _round(b) for k, b in d.bounds.items() if np.isfinite(b)},
        "signatures": [{"effect": s.effect, "channel": s.channel, "text": s.text} for s in d.signatures],
        "next_experiment": dict(d.next_experiment),
        "remarks": list(d.remarks),
        "recordings": [r.info.id for r in d.recordings],
        "cost": {"seconds": _round(d.seconds), "simulations": d.comparison.simulations, "fe_solves": d.fe_solves},
    }


def unknown_probability(v: Verdict) -> float:
    """How surely the cause is outside the library: above a half just where that is the verdict."""
    p = unknown(v.unexplained, v.gap_after)
    return 0.55 + 0.45 * p if v.verdict == "unknown" else min(p, 0.5)


def _round(x: float) -> float:
    return float(f"{x:.5g}")


def breakdown(d: Diagnosis) -> dict[str, dict[str, dict[str, float]]]:
    """Gap before and after by channel, phase, level, direction and repeat."""
    out: dict[str, dict[str, dict[str, float]]] = {}
    for label in LABELS:
        sums: dict[str, np.ndarray] = {}
        for name, problem in d.problems.items():
            codes, names = problem.rows.labels[label]
            before = d.null.fits[name].residual ** 2
            after = d.best.fits[name].residual ** 2
            for k, value in enumerate(names):
                at = codes == k
                part = np.array([before[at].sum(), after[at].sum(), at.sum()])
                sums[value] = sums.get(value, np.zeros(3)) + part
        out[label] = {
            value: {"before": _round(np.sqrt(s[0] / s[2])), "after": _round(np.sqrt(s[1] / s[2]))}
            for value, s in sums.items()
            if s[2] and value != "-"
        }
    return out


def parameters(d: Diagnosis, cause: Cause) -> dict[str, dict[str, Any]]:
    """Values, standard errors and units of a cause's parameters."""
    out: dict[str, dict[str, Any]] = {}
    for effect in cause.effects:
        f, at = _fit_of(cause, effect)
        block = effect.blocks[0]
        for k, p in enumerate(effect.parameters):
            u = float(f.unit[at + k])
            slope = (from_unit(p, min(u + 1e-3, 1.0)) - from_unit(p, max(u - 1e-3, 0.0))) / 2e-3
            variance = f.covariance[at + k, at + k] * d.verdict.temper[block]
            key = p.name if len(cause.effects) == 1 else f"{effect.name}.{p.name}"
            se = abs(slope) * float(np.sqrt(max(variance, 0.0)))
            out[key] = {"value": _round(from_unit(p, u)), "se": _round(se), "unit": p.unit}
    return out


def _fit_of(cause: Cause, effect: Candidate) -> tuple[Any, int]:
    """The fit that holds an effect's parameters, and where they begin in it."""
    f = cause.hypothesis.fits[effect.blocks[0]]
    at = 0
    for other in f.hypothesis:
        if other == effect:
            break
        at += len(other.parameters)
    return f, at


def _cause(d: Diagnosis, cause: Cause, rank: int) -> dict[str, Any]:
    return {
        "effects": [e.name for e in cause.effects],
        "class": [n for n in cause.names],
        "stages": [e.stage for e in cause.effects],
        "where": [e.key for e in cause.effects],
        "probability": _round(cause.probability),
        "parameters": parameters(d, cause),
        "detectability": _round(cause.detectability),
        "meaning": [e.meaning for e in cause.effects],
        "remedy": [e.remedy for e in cause.effects],
        "shrink": {k: _round(s) for k, s in _told(d, rank).items()},
    }


def _told(d: Diagnosis, rank: int) -> dict[str, float]:
    """Shrink of a cause by split; on withheld recordings only where there is something to shrink."""
    return {k: s.value for k, s in d.shrinks[rank].items() if k == "fitted" or s.shows}


def words(name: str) -> str:
    """An effect's name as people say it."""
    return name.replace("_", " ")


PREFIXED = {"m": (("mm", 1e3, 1e-3), ("µm", 1e6, 0.0)), "s": (("s", 1.0, 0.1), ("ms", 1e3, 0.0)),
            "Pa": (("mbar", 1e-2, 0.0),), "N": (("N", 1.0, 0.1), ("mN", 1e3, 0.0))}  # fmt: skip
"""For an SI unit: unit, factor, and the least magnitude (SI) for which people use it."""

UNNAMED = ("1", "choice", "velocity", "position", "rate")
"""Pure numbers, and what a rig's model does not tell the unit of."""


def quantity(value: float, unit: str, se: float | None = None) -> str:
    """A number as people write it: ``0.31 ± 0.02 s``, ``98.2 µm``; nothing after a pure number."""
    shown, factor, _ = next((u for u in PREFIXED.get(unit, ()) if abs(value) >= u[2]), (unit, 1.0, 0.0))
    spread = f" ± {rounded(se * factor, 1)}" if se is not None else ""
    return f"{rounded(value * factor)}{spread} {'' if shown in UNNAMED else shown}".rstrip()


def rounded(x: float, digits: int = 3) -> str:
    """``x`` to some significant digits, without a power of ten where people write none: ``40``, ``1320``."""
    return f"{float(f'{x:.{digits}g}'):g}"


def sentences(d: Diagnosis) -> list[str]:
    """Three sentences for whoever ran the measurement."""
    v = d.verdict
    by_phase = breakdown(d)["phase"]
    worst = max(by_phase, key=lambda k: by_phase[k]["before"]) if len(by_phase) > 1 else ""
    phase = {"load": "loading", "unload": "unloading", "hold": "holding", "rest": "resting"}.get(worst, worst)
    mostly = f", mostly while {phase}" if worst and by_phase[worst]["before"] > 1.2 * d.gap_before else ""
    first = f"The simulation is {rounded(d.gap_before)} times the noise off{mostly}."
    if d.gap_before < 1.1:
        first = f"Simulation and measurement agree to within the noise (gap {d.gap_before:.2f}, noise 1)."
    if v.verdict in ("none", "undetectable"):
        if d.gap_before >= 1.1:
            other = "A model that is wrong otherwise" if "rig" in d.problems else "Skin of another law"
            second = f"{other} could do that as well: no effect stands out beyond it."
        elif v.verdict == "none":
            second = "No effect of the library is needed to explain these recordings."
        else:
            second = "No effect stands out: if one acts, it is weaker than what these recordings can show."
        third = "The bounds below say how strong each effect could still be." if d.bounds else ""
        return [s for s in (first, second, third) if s]
    if v.verdict == "unknown" and (hum := [s.text for s in d.signatures if s.effect == HUM]):
        return [first, f"{'; '.join(hum)}: no effect of the library makes that.", UNKNOWN_NEXT]
    if not v.causes:
        return [first, "Nothing in the library explains it.", UNKNOWN_NEXT]
    cause = v.causes[0]
    what = " and ".join(words(e.name) for e in cause.effects)
    share = 100 * min(max(shrink(d.gap_before, d.gap_after), 0.0), 1.0)  # below the noise floor: all of it, not more
    if v.verdict == "unknown":
        second = f"Nothing in the library explains it: the best candidate, {what}, takes away only {share:.0f} % of it."
        return [first, second, UNKNOWN_NEXT]
    stage = ", ".join(dict.fromkeys(e.stage for e in cause.effects))
    how_sure = f"(probability {cause.probability:.2f})"
    verb = "explain" if len(cause.effects) > 1 else "explains"
    named = f"{what.capitalize()} ({'; '.join([stage, *numbers(d, cause)])})"
    second = f"{named} {verb} {share:.0f} % of it {how_sure}."
    if d.gap_before < 1.1:
        stands = "stand" if len(cause.effects) > 1 else "stands"
        second = f"{named} {stands} out all the same, by {cause.detectability:.0f} σ {how_sure}."
    others = [words(n) for n in cause.names[1:]]
    told = _told(d, 0)
    split = next((k for k in ("waveform", "level", "direction", "repeat") if k in told), "")
    if others:
        third = f"These data cannot tell it from {' or '.join(others)}."
    elif d.gap_before < 1.1:
        third = f"That nothing acts has probability {v.probability_none:.2f}."
    elif split:
        held = {"waveform": "another waveform", "level": "another level", "direction": "another direction"}
        on = held.get(split, "another repeat")
        third = f"On {on}, withheld from the fit, the gap shrinks by {100 * min(told[split], 1.0):.0f} %."
    else:
        third = f"In reality: {cause.effects[0].remedy}"
    return [first, second, third]


def numbers(d: Diagnosis, cause: Cause, most: int = 2) -> list[str]:
    """The first parameters of a cause as people write them: ``tau 0.31 s``."""
    out = []
    for effect in cause.effects:
        for p in effect.parameters[:most]:
            found = parameters(d, cause)[p.name if len(cause.effects) == 1 else f"{effect.name}.{p.name}"]
            if p.unit != "choice":
                out.append(f"{words(p.name)} {quantity(found['value'], p.unit)}")
    return out[: 2 * most]
