"""Power of a session like this one: each effect put into it at its just-visible size, and looked for.

Linearised: an effect's change of the session's rows, less the part that unknowns (tolerances, zeros and gains, skin of
any law) take up, is a direction of so many σ. Noise is added to it, and of all effects' directions the one that
explains most is taken. The strength at which it is `VISIBLE` σ long is the least that such a session shows.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from acquire.recording.model import Recording
from gap.data.quantities import quantity
from gap.decision.thresholds import INSTRUMENT
from gap.design.bench import Acting, Bench
from gap.design.choice import FORM_ERROR
from gap.design.information import Known
from gap.design.unknowns import Unknowns
from gap.effects.load import forms_by_name
from gap.inference.hypothesis import from_unit, to_unit
from sim_devices.chain import Effect, FloatArray, Parameter

SEEN = INSTRUMENT.seen
"""Tempered σ from which the diagnosis names an effect."""
VISIBLE = SEEN + 2.0
"""Tempered σ of an effect that is just visible: noise takes two off in one session of forty."""
DRAWS = 200
NOT_SURELY, FOUND = "not surely", "found"
FORMS = 2
"""Forms of an effect that are tried."""


@dataclass(frozen=True)
class Checked:
    """An effect: the least ``strength`` (in ``unit``, of ``parameter``) that shows surely, None where none in its range
    does; how often it was ``recovered`` ``at`` that, or at its greatest where it is None, and the effects (or none) it
    was taken for."""

    effect: str
    stage: str
    parameter: str
    unit: str
    strength: float | None
    delta: float
    recovered: float
    taken_for: Mapping[str, float]
    at: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        return {
            "effect": self.effect, "stage": self.stage, "parameter": self.parameter, "unit": self.unit,
            "minimum_visible": None if self.strength is None else float(f"{self.strength:.3g}"),
            "delta": round(self.delta, 2), "recovery": round(self.recovered, 3),
            "recovered_at": float(f"{self.at:.3g}"),
            "taken_for": {k: round(v, 3) for k, v in self.taken_for.items()},
        }  # fmt: skip


@dataclass(frozen=True, eq=False)  # compared by identity: it has arrays
class _Trace:
    effect: Effect
    acting: Acting
    strength: float | None
    left: FloatArray
    size: float


def selfcheck(recordings: Sequence[Recording], effects: Mapping[str, Effect], seed: int = 1) -> list[Checked]:
    """Every effect (the best-seen of its forms) in sessions like ``recordings``, in the order of their names."""
    bench = Bench(recordings)
    sound = bench.rows(bench.session, bench.simulate(bench.session))
    known = Known(Unknowns(bench).of(bench.session), (), FORM_ERROR)
    found: dict[str, list[_Trace]] = {}
    for name, several in sorted(forms_by_name(effects).items()):
        found[name] = [_just_visible(bench, known, sound, e) for e in several[:FORMS]]
    return _recovered(found, np.random.default_rng(seed))


def _just_visible(bench: Bench, known: Known, sound: FloatArray, effect: Effect) -> _Trace:
    """An effect at the strength that is `VISIBLE`, else at its strongest; shapes at their defaults."""
    strength = next((p for p in effect.parameters if p.null is not None), None)
    values = {p.name: p.default for p in effect.parameters}

    def at(size: float) -> _Trace:
        there = values | ({strength.name: size} if strength else {})
        acting = [(effect, there)]
        left = known.left(bench.changed(bench.session, acting, sound))
        return _Trace(effect, acting, size, left, float(np.linalg.norm(left)))

    if strength is None:
        return at(0.0)
    weak, strong = _range(strength)
    best = at(from_unit(strength, strong))
    if best.size < VISIBLE:
        return _Trace(effect, best.acting, None, best.left, best.size)
    for _ in range(7):  # bisection in quantiles of the prior
        middle = at(from_unit(strength, 0.5 * (weak + strong)))
        if middle.size >= VISIBLE:
            strong, best = 0.5 * (weak + strong), middle
        else:
            weak = 0.5 * (weak + strong)
        if best.size < 1.2 * VISIBLE:
            break
    return best


def _range(strength: Parameter) -> tuple[float, float]:
    """Quantiles of the weakest and of the strongest value: a limit is strongest where it is lowest."""
    weak = to_unit(strength, strength.null or 0.0)
    return weak, 0.0 if weak == 1.0 else 1.0


def _recovered(found: Mapping[str, Sequence[_Trace]], rng: np.random.Generator) -> list[Checked]:
    """How often each effect is recovered from noise on its trace, the best-seen of its forms."""
    traces = [t for several in found.values() for t in several if t.size > 1e-6]
    names = [t.effect.name for t in traces]
    ways = np.stack([t.left / t.size for t in traces]) if traces else np.zeros((0, 0))
    cosines = ways @ ways.T
    values, vectors = np.linalg.eigh(cosines) if traces else (np.zeros(0), np.zeros((0, 0)))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    out = []
    for name, several in found.items():
        best = max(several, key=lambda t: (t.strength is not None, t.size))
        parameter, unit = _strength_of(best.effect)
        taken = Counter({"none": DRAWS})  # an effect without a trace shows nothing
        if best in traces:
            signal = min(best.size, VISIBLE) * cosines[traces.index(best)]
            taken = _taken_for(names, signal + rng.standard_normal((DRAWS, len(traces))) @ root.T)
        shares = {k: n / DRAWS for k, n in taken.most_common(4) if k != name}
        stage, recovered = best.effect.stage, taken[name] / DRAWS
        at = best.acting[0][1].get(parameter, 0.0)
        out.append(Checked(name, stage, parameter, unit, best.strength, best.size, recovered, shares, at))
    return out


def _strength_of(effect: Effect) -> tuple[str, str]:
    """Name and unit of an effect's strength; '' of one that has none."""
    return next(((p.name, p.unit) for p in effect.parameters if p.null is not None), ("", ""))


def _taken_for(names: Sequence[str], seen: FloatArray) -> Counter[str]:
    """The effects, by ``names`` (k,), that noisy projections ``seen`` (draws, k) are taken for: the largest of each
    draw, or none."""
    largest = np.argmax(np.abs(seen), axis=1)
    heights = np.abs(seen).max(axis=1)
    return Counter(names[k] if height > SEEN else "none" for k, height in zip(largest, heights, strict=True))


def as_text(checked: Sequence[Checked]) -> str:
    """The table, in plain text."""
    lines = [f"{'effect':<36}{'shows from':>16}{FOUND:>8}  taken for"]
    for c in checked:
        shows = NOT_SURELY if c.strength is None else quantity(c.strength, c.unit, None, c.parameter)
        least = shows if c.parameter else "always"
        others = ", ".join(f"{k} {v:.2f}" for k, v in c.taken_for.items() if v >= 0.05)
        lines.append(f"{c.effect:<36}{least:>16}{c.recovered:>8.2f}  {others}")
    if any(c.strength is None for c in checked):
        lines.append(f"\n{NOT_SURELY}: at its greatest, of which {FOUND!r} then tells, it is below {VISIBLE:g} σ")
    return "\n".join(lines)
