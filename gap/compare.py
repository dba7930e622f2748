"""The comparison of hypotheses on one case: screen every effect, refit the best, then pairs, each jointly with the
nuisance.

A case is one or several blocks (independent data with their own nuisance; for a suction instrument command ->
pressure and pressure -> height). A hypothesis changes only the blocks its effects touch, so the evidence of the
others is shared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from gap.hypothesis import Candidate, FloatArray, Problem, to_unit
from gap.noise import correlation_time
from gap.solve import Fit, Projector, fit

STRENGTHS = (0.25, 0.7)
SIGNED = (-0.2, -0.04, 0.04, 0.2)
"""Of the prior's range, about the value that does nothing, where that lies inside: half the range is mostly absurd."""
SHAPES = (0.25, 0.75)
MAX_GRID = 8
HOPELESS = 4.0
"""Fall of χ² in the screening below which an effect is not refitted."""
STARTS = 2
"""Screening points from which a refit starts."""
AMPLITUDES = (0.25, 2.0)
"""How far a linear rescaling of a screened effect may be trusted, as a multiple of its simulated strength."""


@dataclass(frozen=True)
class Hypothesis:
    """Effects and their fits, one per block; blocks they do not touch carry the null's fit."""

    effects: tuple[Candidate, ...]
    fits: dict[str, Fit]

    @property
    def objective(self) -> float:
        return sum(f.objective for f in self.fits.values())

    @property
    def name(self) -> str:
        return " + ".join(e.key for e in self.effects) or "none"


@dataclass
class Screened:
    """One effect after the screening: where in its prior it does best, and by how much χ² falls with the nuisance
    refitted.

    ``detectability`` lists, for every simulated point, how far it stands out (‖P Δ‖, untempered); ``traces`` what it
    changes in each block's whitened residual.
    """

    candidate: Candidate
    unit: FloatArray
    gain: float
    others: tuple[FloatArray, ...] = ()  # further points of the prior worth starting from
    detectability: list[tuple[FloatArray, float]] = field(default_factory=list)
    traces: list[dict[str, FloatArray]] = field(default_factory=list)


@dataclass
class Comparison:
    """All hypotheses tried on a case, and what it cost."""

    problems: dict[str, Problem]
    null: Hypothesis
    hypotheses: list[Hypothesis] = field(default_factory=list)
    screened: list[Screened] = field(default_factory=list)
    simulations: int = 0

    def temper(self) -> dict[str, float]:
        """Per block: how much of χ² to believe, from the best hypothesis' own misfit and its correlation in time.

        1 when the best residual is white at the noise floor. Untempered evidence turns wrong as effects grow: the
        form error of the right effect is then worth hundreds of nats to a spurious one.
        """
        out = {}
        for name in self.problems:
            best = min((h.fits[name] for h in (self.null, *self.hypotheses)), key=lambda f: f.objective)
            misfit = max(1.0, best.chi2 / max(len(best.residual) - len(best.nuisance), 1))
            out[name] = misfit * _mean_correlation(best.residual, self.problems[name].rows.recording)
        return out


def _mean_correlation(residual: FloatArray, recording: np.ndarray) -> float:
    times = [correlation_time(residual[recording == r]) for r in np.unique(recording)]
    return float(np.mean(times)) if times else 1.0


def grid(candidate: Candidate) -> list[FloatArray]:
    """Screening points (k,) in prior quantiles: strengths first, shapes as far as `MAX_GRID` allows."""
    axes = []
    size = 1
    for p in candidate.parameters:
        values: tuple[float, ...] = STRENGTHS if p.null is not None else SHAPES
        if p.null is not None and p.scale == "linear" and p.low < p.null < p.high:
            middle = to_unit(p, p.null)
            values = tuple(float(np.clip(middle + d, 0, 1)) for d in SIGNED)
        if size * len(values) > MAX_GRID:
            values = (0.5,) if p.null is None else (values[len(values) // 2 - 1], values[len(values) // 2])
            if size * len(values) > MAX_GRID:
                values = (0.5,)
        size *= len(values)
        axes.append(values)
    return [np.array(point) for point in product(*axes)]


def screen(
    problems: dict[str, Problem],
    base: Hypothesis,
    candidates: Sequence[Candidate],
    known: Sequence[Screened] = (),
) -> tuple[list[Screened], int]:
    """Every candidate on top of ``base``, by the linear nuisance refit; best first. Also the number of simulations.

    The traces of candidates that are ``known`` from another base are used again: a second effect adds nearly what it
    changes alone, and whatever looks worth it is refitted.
    """
    traces_of = {s.candidate: s.traces for s in known}
    projectors = {}
    for name, f in base.fits.items():
        # The base's own effect parameters are refitted too: they join the nuisance.
        jacobian = np.hstack([f.jacobian, f.effect_jacobian])
        sd = np.concatenate([problems[name].prior_sd, np.ones(f.effect_jacobian.shape[1])])
        projectors[name] = Projector(jacobian, sd)
    projected = {name: projectors[name].apply(f.residual) for name, f in base.fits.items()}
    out, simulations = [], 0
    for candidate in candidates:
        points: list[tuple[float, FloatArray]] = []
        seen = []
        traces = traces_of.get(candidate, [])
        if not traces:
            for unit in grid(candidate):
                traces.append({b: _trace(problems[b], base.fits[b], candidate, unit) for b in candidate.blocks})
                simulations += len(candidate.blocks)
        for unit, trace in zip(grid(candidate), traces, strict=True):
            along = sum(float(change @ projectors[block].apply(change)) for block, change in trace.items())
            cross = sum(float(projected[block] @ change) for block, change in trace.items())
            seen.append((unit, float(np.sqrt(max(along, 0.0)))))
            scale = np.clip(cross / along, *AMPLITUDES) if along > 1e-9 else 1.0
            points.append((max(2 * cross - along, float(scale * (2 * cross - scale * along))), unit))
        points.sort(key=lambda p: -p[0])
        out.append(
            Screened(
                candidate,
                points[0][1],
                points[0][0],
                tuple(u for g, u in points[1:STARTS] if g > 0.6 * points[0][0]),
                seen,
                traces,
            )
        )
    return sorted(out, key=lambda s: -s.gain), simulations


def _trace(problem: Problem, f: Fit, candidate: Candidate, unit: FloatArray) -> FloatArray:
    """What a candidate at ``unit`` (k,) takes from a fit's whitened residual (n,)."""
    active = {**f.active, candidate: candidate.values(unit)}
    return np.asarray(f.residual - problem.evaluate(f.nuisance, active, want_jacobian=False).residual)


def refit(problems: dict[str, Problem], base: Hypothesis, screened: Screened) -> tuple[Hypothesis, int]:
    """``base`` and one effect more, everything refitted jointly in the blocks that any of them touches.

    From the best screening points: a few steps each, then the best to convergence.
    """
    candidate = screened.candidate
    effects = (*base.effects, candidate)
    fits = dict(base.fits)
    simulations = 0
    for block in candidate.blocks:
        before = base.fits[block]
        tries = []
        for unit in (screened.unit, *screened.others):
            start = np.concatenate([before.unit, unit])
            tries.append(fit(problems[block], (*before.hypothesis, candidate), start, before.nuisance, iterations=5))
        best = min(tries, key=lambda f: f.objective)
        fits[block] = fit(problems[block], best.hypothesis, best.unit, best.nuisance)
        simulations += sum(f.simulations for f in tries) + fits[block].simulations
    return Hypothesis(effects, fits), simulations


@dataclass(frozen=True)
class Effort:
    """How wide the search is."""

    refit_singles: int = 9
    pair_bases: int = 2
    refit_pairs: int = 2
    pair_gain: float = 12.0  # tempered fall of χ² below which a second effect is not even refitted


def compare(
    problems: Sequence[Problem],
    candidates: Sequence[Candidate],
    effort: Effort = Effort(),
    suspects: Sequence[Candidate] = (),
) -> Comparison:
    """Null, best singles and best pairs of ``candidates`` on ``problems``; ``suspects`` are refitted wherever they
    rank."""
    blocks = {p.name: p for p in problems}
    fits = {name: fit(p, iterations=60, tolerance=1e-5) for name, p in blocks.items()}
    comparison = Comparison(blocks, Hypothesis((), fits), simulations=sum(f.simulations for f in fits.values()))
    usable = [c for c in candidates if set(c.blocks) <= set(blocks)]
    comparison.screened, n = screen(blocks, comparison.null, usable)
    comparison.simulations += n
    chosen = _shortlist(comparison.screened, effort.refit_singles)
    chosen += [s for s in comparison.screened if s.candidate in suspects and s not in chosen]
    for s in chosen:
        hypothesis, n = refit(blocks, comparison.null, s)
        comparison.hypotheses.append(hypothesis)
        comparison.simulations += n
    _finish_null(comparison)
    _pairs(comparison, usable, effort)
    return comparison


def _finish_null(comparison: Comparison) -> None:
    """Fit the null again from where the effects' fits ended: one that stopped early would give them nats they have
    not earned."""
    for block, problem in comparison.problems.items():
        best = min((h.fits[block] for h in comparison.hypotheses), key=lambda f: f.objective, default=None)
        for start in (comparison.null.fits[block], best):
            if start is None:
                continue
            again = fit(problem, nuisance=start.nuisance, iterations=40, tolerance=1e-5)
            comparison.simulations += again.simulations
            if again.objective < comparison.null.fits[block].objective:
                comparison.null.fits[block] = again
    for h in comparison.hypotheses:
        touched = {b for e in h.effects for b in e.blocks}
        for block in comparison.problems.keys() - touched:
            h.fits[block] = comparison.null.fits[block]


def _shortlist(screened: Sequence[Screened], size: int) -> list[Screened]:
    """The best, no more than two forms of one concept: every concept near the top gets its chance.

    What the linear screening sees no use in (below `HOPELESS`) is left, but the first three always go.
    """
    out: list[Screened] = []
    for s in screened:
        if len(out) >= 3 and s.gain < HOPELESS:
            break
        if sum(o.candidate.name == s.candidate.name for o in out) < 2:
            out.append(s)
        if len(out) == size:
            break
    return out


def _pairs(comparison: Comparison, candidates: Sequence[Candidate], effort: Effort) -> None:
    singles = sorted(comparison.hypotheses, key=lambda h: h.objective)[: effort.pair_bases]
    temper = comparison.temper()
    tried: set[frozenset[str]] = set()
    for base in singles:
        others = [c for c in candidates if c.name != base.effects[0].name]
        screened, n = screen(comparison.problems, base, others, comparison.screened)
        comparison.simulations += n
        for s in screened[: effort.refit_pairs]:
            together = frozenset((base.effects[0].key, s.candidate.key))
            worth = s.gain / max(temper[b] for b in s.candidate.blocks)
            if together in tried or worth < effort.pair_gain:
                continue
            tried.add(together)
            hypothesis, n = refit(comparison.problems, base, s)
            comparison.hypotheses.append(hypothesis)
            comparison.simulations += n
