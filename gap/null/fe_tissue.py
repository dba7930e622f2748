"""Skin under a suction probe by finite elements, as a tissue of the diagnosis.

Thousands of simulations cannot each be a finite-element solve. The model is solved at the recorded pressure history
and its exact sensitivities kept; away from there a surrogate carries on. For quasi-linear viscoelasticity the
surrogate is the creep of the suction (the inverse of the law's relaxation), then the model's own instantaneous curve:

    h(t) = phi(J * q; x) + r(t) + r'(t) (x - x0)

with r the solve at the anchor x0 less the surrogate, and r' the same of their sensitivities: value and slope are the
finite elements' own there ("first-order consistency": Alexandrov & Lewis, AIAA 2000-4886). Curve and anchor are
renewed while the fit moves. Slow flow that stays and softening by the first loading, which no quasi-linear law has,
stay those of the reduced tissue. Contact at the rim is frictionless and without preload: both are effects.
"""

from __future__ import annotations

import abc
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from scipy.interpolate import PchipInterpolator

from gap.data.checks import stated_opening
from gap.inference.evidence import Fit
from gap.inference.hypothesis import Active
from gap.inference.least_squares import fit
from gap.inference.problem import Problem
from gap.null.blocks import Block
from gap.null.chains import needed
from gap.null.fe_law import FREE, TIMES, creep, moduli, moduli_slopes
from gap.null.fe_solver import Experiment, FeModel, fe_model
from gap.null.groups import Group, GroupedSession
from gap.null.skin_laws import Part, SkinLaw
from gap.null.suction_height import HeightBlock
from gap.null.suction_line import chain_of
from gap.null.suction_pressure import PressureBlock
from sim_devices.chain import Chain, Effect, FloatArray
from sim_devices.stages.kernels import evaluate, prony
from sim_devices.stages.operators import Law, Map, after, before
from sim_devices.stages.sampling import REFINEMENT, simulate
from sim_devices.stages.suction import OPENING
from sim_devices.stages.tissues import SuctionTissue

ANCHORS = 5
"""Linearisations at most."""
NEAR = 0.25
"""How far from its anchor (in logarithms of parameters) a fit may stay without another linearisation."""
MESH = 0.5
"""Density of the mesh: the apex is about 2 % off the finest one's, which the modulus takes up."""
CURVE_POINTS = 25
TABLE_POINTS = 600


@dataclass(frozen=True)
class Curve:
    """Instantaneous height at a suction: knots (k,) Pa and m, and d log(height) by the two stiffening parameters."""

    suction: FloatArray
    height: FloatArray
    slopes: FloatArray

    def at(self, x: FloatArray, anchor: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Tables of suction (m,) Pa and height (m,) m at ``x``; exact in the scale, log-linear in the stiffening."""
        height = self.height * np.exp(np.clip(self.slopes @ (x[1:3] - anchor[1:3]), -2.0, 2.0))
        fine = np.linspace(0.0, self.suction[-1], TABLE_POINTS)
        return fine * float(np.exp(x[0] - anchor[0])), PchipInterpolator(self.suction, height)(fine)


def looked_up(time: FloatArray, pressure: FloatArray, suction: FloatArray, height: FloatArray) -> FloatArray:
    """Height at gauge ``pressure``, Pa (suction negative), from a table; straight on beyond it, odd in pressure."""
    size = np.abs(pressure)
    end = (height[-1] - height[-2]) / (suction[-1] - suction[-2])
    inside = np.interp(size, suction, height)
    extended: FloatArray = np.copysign(inside + end * np.maximum(size - suction[-1], 0.0), -pressure)
    return extended


def _added(time: FloatArray, height: FloatArray, at: FloatArray, values: FloatArray) -> FloatArray:
    return height + np.interp(time, at, values)


@dataclass(frozen=True)
class Anchor:
    """The finite elements at one point: curve, and per group times, remainder (m,) and its slopes (m, 9)."""

    x: FloatArray
    curve: Curve
    remainders: Mapping[str, tuple[FloatArray, FloatArray, FloatArray]]


class Anchored(Block):
    """A block whose tissue is linearised about a finite-element solve: the first ``anchored_by`` nuisance parameters
    are the ones solved for."""

    model: FeModel
    anchored_by: int
    _anchor: Any = None  # with ``x``, where it was solved
    _begin: FloatArray | None = None

    @abc.abstractmethod
    def _anchored(self, x: FloatArray) -> Any:
        """The anchor at ``x``. Raises ValueError where the model cannot be solved."""

    def _trusted(self, x: FloatArray) -> FloatArray:
        """``x`` where the model can be solved."""
        return x

    def _settle(self) -> None:
        """Move the anchor to where the fit leads, until it stays near."""
        for _ in range(ANCHORS):
            fitted = fit(self)
            self._begin = fitted.nuisance
            x = self._trusted(fitted.nuisance[: self.anchored_by])
            if float(np.max(np.abs(x - self._anchor.x))) < NEAR:
                return
            try:
                self._anchor = self._anchored(x)
            except ValueError:  # the fit left where the model can be solved: the anchor before is the best there is
                return

    def start(self) -> FloatArray:
        return self.prior_mean.copy() if self._begin is None else self._begin.copy()

    @abc.abstractmethod
    def surrogate_error(self, fitted: Fit) -> float:
        """rms of surrogate less a full solve in units of the noise, at a fit's parameters and under its effects."""


class FeHeightBlock(Anchored, HeightBlock):
    """Recorded pressure -> apex height with a finite-element tissue.

    Nuisance: the law's parameters of `moduli` in place of the reduced ones; all else as in `HeightBlock`.
    """

    PARTS: ClassVar[Mapping[str, Part]] = {
        "scale": Part(1.0, 0.3),
        "bend2": Part(0.7, 0.15),
        "bend3": Part(1.0, 0.2),
        **{name: Part(0.7, 0.2) for name in ("relax1", "relax2", "relax3", "time1", "time2", "time3")},
        "residual": Part(0.1, 0.06),
        "softening": Part(0.04, 0.03),
    }
    SIMPLE_LAWS: ClassVar[Sequence[SkinLaw]] = (SkinLaw(()),)
    FURTHER_LAWS: ClassVar[Sequence[SkinLaw]] = ()
    USUAL_LAW: ClassVar[SkinLaw] = SkinLaw((), simple=False)

    anchored_by = len(FREE)

    def __init__(
        self,
        session: GroupedSession,
        library: Mapping[str, Effect],
        pressure: PressureBlock | None,
        model: FeModel,
    ) -> None:
        missing = [s for s in (*FREE, "friction", "spring_force") if s not in model.symbols]
        if model.problem != "suction" or missing:
            raise ValueError(
                f"finite-element model {model.name!r} cannot stand for skin under suction here: the diagnosis takes "
                f"suction models of Yeoh's law with quasi-linear viscoelasticity (suction_yeoh_qlv)"
            )
        self.model = model
        self._base = 0.0
        stated = [opening for r in session.recordings if np.isfinite(opening := stated_opening(r))]
        self._opening = stated[0] if stated else OPENING[session.instrument]
        super().__init__(session, library, pressure)
        self._settle()
        n = len(self.PARTS)
        self.prior_mean[:n] = self.start()[:n]
        for sd in (self.prior_sd, *self.prior_scales):
            sd[:n] = [part.warm_start for part in self.PARTS.values()]
        self.prior_sd = fit(self).best_prior(self.prior_scales)

    def _first_guess(self) -> FloatArray:
        if self._anchor is None:
            self._base = self._scale()
            self._anchor = self._anchored(np.zeros(len(FREE)))
        return np.zeros(len(self.PARTS) + 1)

    def _guesses(self) -> list[FloatArray]:
        """Near the anchor, where the surrogate is good."""
        begin = self.start()
        begin[self._curve_part.stop :] = 0.0
        return [begin]

    def tissue(self, nuisance: FloatArray) -> SuctionTissue:
        """The operators that the reduced tissue keeps: slow flow and softening; its own curve and memory are not
        used."""
        c = dict(zip(self.PARTS, nuisance, strict=False))
        flow, soft = self._tissue.residual + c["residual"], self._tissue.softening + c["softening"]
        return replace(self._tissue, creep=(), times=(), residual=flow, softening=soft)

    def quantities(self, nuisance: FloatArray) -> Mapping[str, tuple[float, str]]:
        units = {"g": "1", "tau": "s"}
        law = moduli(nuisance[: len(FREE)], self._base)
        return {name: (float(value), units.get(name.rstrip("0123456789"), "Pa")) for name, value in law.items()}

    def _law_chain(self, group: Group, nuisance: FloatArray) -> Chain:
        chain = chain_of(self.session, group, self.tissue(nuisance))
        if not group.skin or self._anchor is None:
            return chain
        x = nuisance[: len(FREE)]
        table, memory = self._surrogate(x, self._anchor)
        chain = chain.tuned("elastic", function=looked_up, parameters=table)
        chain = before(chain, "elastic", lambda s, t: Law("fe_creep", "tissue", s, t, prony, memory))
        at, value, slopes = self._anchor.remainders[group.specimen]
        values = value + slopes @ (x - self._anchor.x)
        return after(chain, "memory", lambda s, t: Map("fe_remainder", "tissue", s, t, _added, (at, values)))

    def _surrogate(self, x: FloatArray, anchor: Anchor) -> tuple[tuple[FloatArray, FloatArray], tuple[float, ...]]:
        law = moduli(x, self._base)
        shares, times = (np.array([law[f"{s}{i + 1}"] for i in range(len(TIMES))]) for s in ("g", "tau"))
        return anchor.curve.at(x, anchor.x), creep(shares, times)

    def _surrogate_height(self, x: FloatArray, anchor: Anchor, time: FloatArray, pressure: FloatArray) -> FloatArray:
        table, memory = self._surrogate(x, anchor)
        return looked_up(time, evaluate(prony, time, pressure, *memory), *table)

    def _geometry(self, **options: float) -> dict[str, float]:
        return {"opening_radius": self._opening / 2, "mesh": MESH, **options}

    def _top(self) -> float:
        """The strongest suction of any group on skin, Pa."""
        return max(float(np.max(-p)) for (g, _), (_, p) in zip(self.groups, self._line, strict=True) if g.skin)

    def _scale(self) -> float:
        """The shear modulus at which the instantaneous curve, crept, gives the greatest height measured.

        The curve depends on suction over modulus only.
        """
        guess = self.model.defaults["G"]
        curve = self._curve(np.zeros(len(FREE)), guess, 4.0 * guess)
        law = moduli(np.zeros(len(FREE)), guess)
        crept = self._top() / (1.0 - sum(law[f"g{i + 1}"] for i in range(len(TIMES))))
        skin = np.concatenate([np.full(at.stop - at.start, g.skin) for g, at in self.groups])
        wanted = float(np.clip(np.max(self.measured[skin]), 1e-3 * curve.height[-1], curve.height[-1]))
        return guess * crept / float(np.interp(wanted, curve.height, curve.suction))

    def _curve(self, x: FloatArray, base: float, top: float) -> Curve:
        """The model's instantaneous curve up to ``top`` Pa by one solve without relaxation."""
        law = moduli(x, base) | {f"g{i + 1}": 0.0 for i in range(len(TIMES))}
        time = np.linspace(0.0, 1.0, CURVE_POINTS)
        # A solve that breaks off has followed the curve to where the skin would burst: half as far may do.
        for share in (1.0, 0.7, 0.5, 0.35):
            run = Experiment(
                self.session.instrument,
                time,
                {"pressure": -share * top * time},
                self._geometry(steps=(CURVE_POINTS - 1) / 8),
                "instantaneous curve",
            )
            try:
                height, slopes = self.model.simulate(run, law, ("c20", "c30"))
            except ValueError:
                if share < 0.4:
                    raise
                continue
            break
        by_log = slopes[0] * np.array([law["c20"], law["c30"]])
        relative = np.divide(by_log, height[0][:, None], out=np.zeros_like(by_log), where=height[0][:, None] > 0)
        relative[0] = relative[1]
        return Curve(share * top * time, np.maximum.accumulate(height[0]), relative)

    def _anchored(self, x: FloatArray) -> Anchor:
        """Curve and whole histories solved at ``x``. Raises ValueError where the model cannot be solved."""
        law = moduli(x, self._base)
        stays = 1.0 - sum(law[f"g{i + 1}"] for i in range(len(TIMES)))
        bare = Anchor(x.copy(), self._curve(x, self._base, 1.1 * self._top() / stays), {})
        remainders = {}
        for (g, at), (t, p) in zip(self.groups, self._line, strict=True):
            if not g.skin:
                continue
            time = self._solve_times(g, at, t)
            pressure = np.interp(time, t, p)
            height, by_law = self._solved(x, time, pressure, sensitivities=FREE)
            slopes = by_law @ moduli_slopes(x, self._base)
            guess = partial(self._surrogate_height, anchor=bare, time=time, pressure=pressure)
            remainders[g.specimen] = (time, height - guess(x), slopes - _differences(guess, x))
        return replace(bare, remainders=remainders)

    def _solve_times(self, group: Group, at: slice, table: FloatArray) -> FloatArray:
        """Where the finite elements are asked: at the stamps and, finer, behind the command's kinks."""
        kinks = group.commands["pressure"].kinks
        time = np.unique(
            np.concatenate([table[[0, -1]], self.stamps[at], (kinks[:, None] + REFINEMENT).ravel(), kinks])
        )
        time = time[(time >= table[0]) & (time <= table[-1])]
        distinct: FloatArray = time[np.diff(time, prepend=-np.inf) > 1e-6]
        return distinct

    def _solved(
        self, x: FloatArray, time: FloatArray, pressure: FloatArray, sensitivities: tuple[str, ...] = ()
    ) -> tuple[FloatArray, FloatArray]:
        run = Experiment(self.session.instrument, time, {"pressure": pressure}, self._geometry(), "session")
        height, slopes = self.model.simulate(run, moduli(x, self._base), sensitivities)
        return height[0], slopes[0]

    def surrogate_error(self, fitted: Fit) -> float:
        """rms of surrogate less a full solve in units of the noise, at a fit's parameters and under its effects."""
        assert self._anchor is not None
        x = fitted.nuisance[: len(FREE)]
        errors = []
        for (g, at), (t, p) in zip(self.groups, self._line, strict=True):
            if not g.skin:
                continue
            chain = self.with_effects(self._law_chain(g, fitted.nuisance), fitted.active, g)
            time = self._solve_times(g, at, t)
            pressure = self._skin_pressure(chain, g, fitted.active, time, (t, p))
            full, _ = self._solved(x, time, pressure)
            where, value, slopes = self._anchor.remainders[g.specimen]
            quick = self._surrogate_height(x, self._anchor, time, pressure)
            quick += np.interp(time, where, value + slopes @ (x - self._anchor.x))
            errors.append(np.interp(self.stamps[at], time, quick - full) / self.sigma[at])
        return float(np.sqrt(np.mean(np.square(np.concatenate(errors)))))

    def _skin_pressure(
        self, chain: Chain, group: Group, active: Active, time: FloatArray, line: tuple[FloatArray, FloatArray]
    ) -> FloatArray:
        """The pressure on the skin under the active effects, (n,) Pa."""
        given = {"line_pressure": self._fed.beside(chain, group, active, line)}
        reduced = replace(chain, operators=needed(chain, ("skin_pressure",), given))
        return simulate(reduced, group.tables(self.session.held), {"skin_pressure": time}, given)["skin_pressure"]


def fe_height(name: str) -> Callable[[GroupedSession, Mapping[str, Effect], PressureBlock | None], FeHeightBlock]:
    """Makes the block with the tissue of the named model. Raises ValueError where there is none such."""
    return partial(FeHeightBlock, model=fe_model(name))


def checked(problems: Iterable[Problem], fits: Mapping[str, Fit]) -> tuple[int, float, list[str]]:
    """Number of finite-element solves, and how far the surrogate is off a full solve at ``fits``: σ (rms), inf where
    there is none, and in plain words."""
    solves, worst, remarks = 0, 0.0, []
    for p in problems:
        if isinstance(p, Anchored):
            try:
                off = p.surrogate_error(fits[p.name])
                error = f"the surrogate is {off:.2g} σ (rms) off a full solve"
            except ValueError as failure:
                off, error = np.inf, f"no full solve could check the surrogate: {failure}"
            worst = max(worst, off)
            solves += p.model.solves
            remarks.append(
                f"tissue by finite elements ({p.model.name}, {p.model.solves} solves); at the answer {error}"
            )
    return solves, worst, remarks


def _differences(function: Callable[[FloatArray], FloatArray], x: FloatArray, step: float = 1e-4) -> FloatArray:
    """Central differences of ``function`` (9,) -> (n,) at ``x``, (n, 9)."""
    columns = []
    for k in range(len(x)):
        up, down = x.copy(), x.copy()
        up[k] += step
        down[k] -= step
        columns.append((function(up) - function(down)) / (2 * step))
    return np.column_stack(columns)
