"""Draws from the posterior of a report: effects with parameters, each with its share of the probability.

A class that a report names is drawn about its leader's parameters; its other members, whose parameters no report has,
are moved until they change the session as the leader does. An effect outside the library changed the session as the
leader does. In an experiment on skin it does more or less than the leader; on a reference specimen it does so, too, or
nothing, if it is skin of a law that nobody thought of. Effects that a report does not name may act all the same, too
weak or too well hidden by skin to show: they are drawn from their priors, and those kept that the session could not
have seen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gap.design.bench import Acting, Bench
from gap.design.information import Known
from gap.effects.load import forms_by_name
from gap.inference.hypothesis import from_unit, to_unit
from sim_devices.chain import Effect, FloatArray

NONE, OUTSIDE = "none", "outside"
CAUSES, MEMBERS, DRAWS = 5, 3, 6
"""How many causes of a report are drawn, how many members of each, and how often each."""
TRIES = {False: 4, True: 2}
"""Draws from the prior of each effect that the report does not name, for suction and for the robot, which is slow."""
UNSEEN = 3.5
"""Tempered σ in the session below which an effect would not have been named."""
STRANGE = 1.5
"""The outside acts in an experiment by the leader's change times nought to so many."""
STEP = 0.02
"""Quantile by which a parameter is moved for a derivative."""


@dataclass(frozen=True)
class Draw:
    """One possibility: its ``label`` (an effect, ``a + b``, outside, or none), acting effects, and ``weight``. In an
    experiment it has so many times the effects' change ``on_skin`` and ``on_references``."""

    label: str
    acting: Acting
    weight: float
    change: FloatArray  # (n,) of the session's rows
    on_skin: float = 1.0
    on_references: float = 1.0


def within_tolerance(report: Mapping[str, Any]) -> float:
    """The probability of causes that are within a stated tolerance: they are no finding, and not to be looked for."""
    return sum(float(c.get("probability", 0.0)) for c in report.get("causes", []) if c.get("tolerated"))


class Beliefs:
    """Draws from a report about the session of a bench."""

    def __init__(
        self,
        report: Mapping[str, Any],
        bench: Bench,
        known: Known,
        sound: FloatArray,
        effects: Mapping[str, Effect],
        rng: np.random.Generator,
    ) -> None:
        self._bench, self._known, self._sound, self._rng = bench, known, sound, rng
        self._effects = effects
        self._named = forms_by_name(effects)
        self.draws: list[Draw] = []
        self._causes(report.get("causes", []))
        named = {n for d in self.draws for n in d.label.split(" + ")}
        rest = max(1.0 - sum(d.weight for d in self.draws), 0.0)
        none = float(report.get("none_probability", rest)) + within_tolerance(report)
        outside = self._outside(max(rest - none, 0.0))
        self._hidden(named, none, outside)

    def _change(self, acting: Acting) -> FloatArray:
        return self._bench.changed(self._bench.session, acting, self._sound)

    def _causes(self, causes: Sequence[Mapping[str, Any]]) -> None:
        for cause in causes[:CAUSES]:
            probability = float(cause.get("probability", 0.0))
            leader = self._leader(cause)
            if leader is None or probability < 0.005 or cause.get("tolerated"):
                continue
            label = " + ".join(sorted(cause["effects"]))
            drawn: dict[str, list[tuple[Acting, FloatArray]]] = {label: [(a, self._change(a)) for a in leader]}
            target = drawn[label][0][1]
            members = [n for n in cause.get("class", []) if n != label]
            instead = [(n, pair) for n in members if (pair := self._instead(n, leader[0])) is not None]
            for name, (other, beside) in instead[: MEMBERS - 1]:
                drawn[name] = self._imitating(other, target, beside)
            for name, found in drawn.items():  # fits, better than ours, could not split them: each is as probable
                each = probability / (len(drawn) * len(found))
                self.draws += [Draw(name, acting, each, change) for acting, change in found]

    def _outside(self, weight: float) -> float:
        """Draws of causes outside the library, after the most probable cause's leader; the weight that is left, where
        the report names no cause."""
        causes = sorted(self.draws, key=lambda d: -d.weight)
        like = [d for d in causes if d.label == causes[0].label]
        for k, d in enumerate(like):
            often = float(self._rng.uniform(0.0, STRANGE))
            device = often * (k % 2)  # skin's and the instrument's doing in turn
            self.draws.append(Draw(OUTSIDE, d.acting, weight / len(like), d.change, often, device))
        return 0.0 if like else weight

    def _leader(self, cause: Mapping[str, Any]) -> list[Acting] | None:
        """The effects of a cause about its fitted parameters, the first at them."""
        keys = cause.get("where", cause["effects"])
        forms = [
            self._effects.get(key) or next(iter(self._named.get(name, [])), None)
            for key, name in zip(keys, cause["effects"], strict=True)
        ]
        known = [e for e in forms if e is not None]
        if len(known) < len(forms):
            return None
        given = cause.get("parameters", {})
        out: list[Acting] = []
        for k in range(DRAWS):
            acting = []
            for e in known:
                values = {}
                for p in e.parameters:
                    said = given.get(p.name if len(known) == 1 else f"{e.name}.{p.name}", {})
                    value, se = float(said.get("value", p.default)), float(said.get("se", 0.0) or 0.0)
                    u = to_unit(p, value)
                    wide = min(max(abs(to_unit(p, value + se) - u), abs(to_unit(p, value - se) - u)), 0.2)
                    values[p.name] = from_unit(p, u + (wide * float(self._rng.standard_normal()) if k else 0.0))
                acting.append((e, values))
            out.append(acting)
        return out

    def _instead(self, member: str, leader: Acting) -> tuple[str, Acting] | None:
        """The one effect that a member of a class has and its leader has not, and the leader's that act beside it; None
        for a member that differs by more."""
        names = member.split(" + ")
        other = [n for n in names if n in self._named and n not in {e.name for e, _ in leader}]
        beside = [(e, values) for e, values in leader if e.name in names]
        return (other[0], beside) if len(other) == 1 and len(beside) == len(names) - 1 else None

    def _imitating(self, name: str, target: FloatArray, beside: Acting) -> list[tuple[Acting, FloatArray]]:
        """Draws of the effect ``name``, ``beside`` others, that change the session as nearly by
        ``target`` (n,) as they can."""
        best: tuple[float, Effect, FloatArray] | None = None
        for form in self._named[name][: 2 if self._bench.robot else None]:
            for unit in [np.full(len(form.parameters), 0.5), *self._rng.random((4, len(form.parameters)))]:
                off = float(self._known.distance(self._at(form, unit, beside)[1] - target))
                if best is None or off < best[0]:
                    best = (off, form, unit)
        assert best is not None
        off, form, unit = best
        for _ in range(3):  # Gauss-Newton, a shorter step where a whole one leads away
            here = self._at(form, unit, beside)[1]
            left, slopes = self._known.left(here - target), self._slopes(form, unit, here, beside)
            normal = slopes.T @ slopes + 12.0 * np.eye(len(unit))
            step = np.linalg.solve(normal, -slopes.T @ left)
            for share in (1.0, 0.3):
                moved = np.clip(unit + np.clip(share * step, -0.3, 0.3), 0.0, 1.0)
                there = float(self._known.distance(self._at(form, moved, beside)[1] - target))
                if there < off:
                    off, unit = there, moved
                    break
            else:
                break
        here = self._at(form, unit, beside)[1]
        slopes = self._slopes(form, unit, here, beside)
        root = np.linalg.cholesky(np.linalg.inv(slopes.T @ slopes + 12.0 * np.eye(len(unit))))
        units = [unit, *(np.clip(unit + root @ self._rng.standard_normal(len(unit)), 0, 1) for _ in range(DRAWS - 1))]
        return [self._at(form, u, beside) for u in units]

    def _at(self, form: Effect, unit: FloatArray, beside: Acting = ()) -> tuple[Acting, FloatArray]:
        values = {p.name: from_unit(p, float(u)) for p, u in zip(form.parameters, unit, strict=True)}
        acting = [*beside, (form, values)]
        return acting, self._change(acting)

    def _slopes(self, form: Effect, unit: FloatArray, here: FloatArray, beside: Acting) -> FloatArray:
        columns = []
        for k in range(len(unit)):
            moved = unit.copy()
            step = STEP if unit[k] < 0.5 else -STEP
            moved[k] += step
            columns.append(self._known.left(self._at(form, moved, beside)[1] - here) / step)
        return np.stack(columns, axis=1)

    def _hidden(self, named: set[str], none: float, outside: float) -> None:
        """No effect, and effects that the session could not have seen; these share the ``outside`` probability, too."""
        concepts = [n for n in self._named if n not in named]
        kept: list[tuple[str, Acting, FloatArray, float]] = []
        tries = TRIES[self._bench.robot]
        for name in concepts:
            for _ in range(tries):
                form = self._named[name][int(self._rng.integers(len(self._named[name])))]
                acting, change = self._at(form, self._rng.random(len(form.parameters)))
                seen = float(self._known.distance(change))
                if seen < UNSEEN:
                    kept.append((name, acting, change, float(np.exp(-0.5 * seen**2))))
        total = sum(w for *_, w in kept)
        if not kept:
            self.draws.append(Draw(NONE, (), none + outside, np.zeros_like(self._sound)))
            return
        # One effect is as probable as none, all of them together, before anything is measured.
        share = total / (tries * max(len(concepts), 1))
        hidden = outside + none * share / (1.0 + share)
        self.draws.append(Draw(NONE, (), none / (1.0 + share), np.zeros_like(self._sound)))
        self.draws += [Draw(name, acting, hidden * w / total, change) for name, acting, change, w in kept]
