"""A term for a gap that no known effect explains: chosen by evidence, fitted with everything else, and believed only if
it serves on recordings that it was not fitted to.

Parts are chosen one by one, as in orthogonal least squares (Chen, Billings and Luo, Int. J. Control 50 (1989) 1873), by
the part each takes from the residual once nuisance and the parts before are projected out. Terms of one, two and three
parts are fitted; of those whose evidence is better than none's the shortest that does on withheld recordings as well as
the best is proposed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import cast

import numpy as np
from scipy.special import gammaln

from gap.data.noise import mean_correlation
from gap.decision.gaps import Shrink, gap_without_discrepancy, in_changed_blocks
from gap.decision.settle import Case
from gap.decision.thresholds import Thresholds
from gap.decision.transfer import plain, transferred
from gap.inference.evidence import Fit, Hypothesis
from gap.inference.hypothesis import Active
from gap.inference.linear import Projector
from gap.inference.problem import Problem
from gap.null.blocks import Block
from gap.rig.problem import RigProblem
from gap.search.compare import LEAST_TEMPER
from gap.search.refits import refit
from gap.search.screening import STRAIN_EACH, Screened
from gap.terms.dictionary import INSTRUMENTS, Choice, choices
from gap.terms.term import Term, as_effect, as_generic, candidate_of
from sim_devices.chain import FloatArray

MOST = 3
"""Parts that a term has at most: more are no explanation."""
TRIAL = 3e-3
"""Share of a place's size at which a part's trace is taken."""


@dataclass(frozen=True)
class Proposal:
    """The best term for a case. ``evidence`` is in nats against none, the size of the dictionary paid for; ``shrinks``
    are of the gap, by split, and ``errors`` the standard errors of the amounts. ``reason`` is why it is not
    believed, '' where it is; without a ``term`` none was worth a fit."""

    term: Term | None
    evidence: float = 0.0
    shrinks: Mapping[str, Shrink] = field(default_factory=dict)
    errors: tuple[float, ...] = ()
    reason: str = ""
    hypothesis: Hypothesis | None = field(default=None, repr=False)

    @property
    def judged(self) -> Shrink:
        """The gap that judges it: on another waveform, else on other withheld recordings, else where it was fitted."""
        judges = [self.shrinks[k] for k in ("waveform", "repeat", "recording", "level", "fitted") if k in self.shrinks]
        return judges[0] if judges else Shrink(1.0, 1.0)

    @property
    def helps(self) -> bool:
        return self.term is not None and not self.reason


@dataclass(frozen=True)
class _Linear:
    """A term of one place, as its parts' traces tell: the χ² that it leaves, of how many parts it was chosen, and which
    with which amounts."""

    choice: Choice
    left: float
    among: int
    parts: tuple[int, ...]
    amounts: tuple[float, ...]


def best_term(case: Case, t: Thresholds, jobs: int = 1) -> Proposal | None:
    """The term that the data of a case speak for most, tested; None where no place for one is known."""
    problems, null = case.comparison.problems, case.comparison.null
    everywhere = choices(problems)
    if not everywhere:
        return None
    loud = {b for b in problems if gap_without_discrepancy(case.null, {b}) > t.quiet_gap}
    places = [c for c in everywhere if loud & set(c.place.blocks)]
    if not places:
        return Proposal(None, reason="no stage where a term is known to fit leaves a gap above the noise")
    tested = [[_tested(case, f, t, jobs) for f in _chosen(problems, null, c)] for c in places]
    earned = [[p for p in sizes if p.evidence > t.evidence_tie] for sizes in tested]
    found = sorted((_shortest(sizes, t) for sizes in earned if sizes), key=lambda p: -p.evidence)
    if not found:
        return Proposal(None, reason="no part of a term earns its place in these data")
    return next((p for p in found if p.helps), found[0])


def _shortest(sizes: Sequence[Proposal], t: Thresholds) -> Proposal:
    """Of terms of one place, by their number of parts, the shortest that withheld recordings do not speak against."""
    left = [max(p.judged.after, 1.0) for p in sizes]
    same = t.transfer_lead * max(sizes[0].judged.before, 1.0)
    return next(p for p, gap in zip(sizes, left, strict=True) if gap <= min(left) + same)


def extended(problems: Mapping[str, Problem], key: str, term: Term) -> dict[str, Problem]:
    """The problems, those that a term touches knowing it by a candidate's key."""
    out = dict(problems)
    for b in term.place.blocks:
        problem = problems[b]
        if isinstance(problem, RigProblem):
            out[b] = cast(Problem, problem.knowing({key: as_generic(term)}))
        elif isinstance(problem, Block):
            out[b] = problem.knowing({key: as_effect(term, INSTRUMENTS)})
    return out


@dataclass(frozen=True)
class _Point:
    """Where a block is linearised: its nuisance (p,), what acts, the residual (n,) and Jacobian (n, p) there.

    At the null's fit; where that strains tolerances, which have then taken on much of the gap, at a sound
    instrument, from where no straight line leads back.
    """

    nuisance: FloatArray
    active: Active
    residual: FloatArray
    jacobian: FloatArray
    mean: FloatArray
    widths: tuple[FloatArray, ...]

    @classmethod
    def of(cls, problem: Problem, f: Fit) -> _Point:
        if problem.sound is None or f.penalty < STRAIN_EACH:
            return cls(f.nuisance, f.active, f.residual, f.jacobian, f.prior_mean, (f.prior_sd,))
        here = problem.evaluate(problem.sound, {})
        return cls(problem.sound, {}, here.residual, here.jacobian, f.prior_mean, tuple(problem.prior_scales))


def _traces(problems: Mapping[str, Problem], points: Mapping[str, _Point], choice: Choice) -> dict[str, FloatArray]:
    """By block, the change by each part in the whitened prediction, (n, parts), for an amount of the place's size.

    Where the signal has an end, a part may act on one side only: the trace is that of the sign which explains more.
    """
    columns: dict[str, list[FloatArray]] = {b: [] for b in choice.place.blocks}
    signs = (1.0,) if np.isinf(choice.place.highest) else (1.0, -1.0)
    clear = {b: Projector(points[b].jacobian, points[b].widths[-1]) for b in columns}
    for part in choice.parts:
        term = Term(choice.place, (part,), (TRIAL * choice.place.size,))
        candidate = candidate_of(term, choice.place.blocks)
        known = extended(problems, candidate.key, term)
        usual = {p.name: p.default for p in candidate.parameters}
        tried = []
        for sign in signs:
            active = {candidate: usual | {"amount": sign * usual["amount"]}}
            tried.append({b: sign * _trace(known[b], points[b], active) for b in columns})
        best = max(zip(signs, tried, strict=True), key=lambda st: _explained(clear, points, *st))[1]
        for b, column in columns.items():
            column.append(best[b])
    return {b: np.column_stack(c) for b, c in columns.items()}


def _trace(problem: Problem, at: _Point, active: Active) -> FloatArray:
    """The change of the whitened residual (n,), per size, by a part at the share `TRIAL` of its place's size."""
    moved = problem.evaluate(at.nuisance, {**at.active, **active}, want_jacobian=False).residual
    return np.asarray((at.residual - moved) / TRIAL)


def _explained(
    clear: Mapping[str, Projector], points: Mapping[str, _Point], sign: float, traces: Mapping[str, FloatArray]
) -> float:
    """Fall of χ² by a part of the given ``sign``."""
    cross = sign * sum(float(points[b].residual @ clear[b].apply(v)) for b, v in traces.items())
    square = sum(float(v @ clear[b].apply(v)) for b, v in traces.items())
    return max(cross, 0.0) ** 2 / max(square, 1e-300)


@dataclass(frozen=True)
class _Seen:
    """A block's data with the nuisance projected out: Φᵀ P Φ, Φᵀ P r and rᵀ P r."""

    square: FloatArray
    cross: FloatArray
    chi2: float

    @classmethod
    def of(cls, at: _Point, sd: FloatArray, traces: FloatArray) -> _Seen:
        projector = Projector(at.jacobian, sd)
        start = at.residual + at.jacobian @ (at.nuisance - at.mean)
        aim = projector.apply(start)
        return cls(projector.apply(traces).T @ traces, traces.T @ aim, float(start @ aim))


def _chosen(problems: Mapping[str, Problem], null: Hypothesis, choice: Choice) -> list[_Linear]:
    """The best term of one place for each number of parts, by the parts' traces alone."""
    points = {b: _Point.of(problems[b], null.fits[b]) for b in choice.place.blocks}
    traces = _traces(problems, points, choice)
    out: list[_Linear] = []
    most = max(len(p.widths) for p in points.values())
    for width in range(most):
        seen = [_Seen.of(p, p.widths[min(width, len(p.widths) - 1)], traces[b]) for b, p in points.items()]
        usable = [k for k in range(len(choice.parts)) if 0 < sum(s.square[k, k] for s in seen) < np.inf]
        for m in range(1, min(MOST, len(usable)) + 1):
            parts = _picked(seen, usable, m)
            amounts, fall = _solved(seen, parts)
            left = sum(s.chi2 for s in seen) - fall
            sizes = tuple((choice.place.size * amounts).tolist())
            out.append(_Linear(choice, left, len(usable), tuple(parts), sizes))
    numbers = sorted({len(o.parts) for o in out})
    return [min((o for o in out if len(o.parts) == m), key=lambda o: o.left) for m in numbers]


def _picked(seen: Sequence[_Seen], usable: Sequence[int], most: int) -> list[int]:
    """The parts of a term: one by one the one that helps most beside those before, then each exchanged for a better
    one as long as there is one."""

    def best(others: list[int]) -> int:
        return max((k for k in usable if k not in others), key=lambda k: _solved(seen, [*others, k])[1])

    picked: list[int] = []
    while len(picked) < min(most, len(usable)):
        picked.append(best(picked))
    for _ in range(MOST):
        before = list(picked)
        for part in before:
            others = [k for k in picked if k != part]
            picked = [*others, best(others)]
        if set(picked) == set(before):
            break
    return picked


def _solved(seen: Sequence[_Seen], chosen: Sequence[int]) -> tuple[FloatArray, float]:
    """Amounts of some parts in sizes of their place, (m,), normal about 0 with sd 1 beforehand; and the fall of χ²."""
    at = np.ix_(chosen, chosen)
    normal = sum((s.square[at] for s in seen), np.eye(len(chosen)))
    pull = sum((s.cross[list(chosen)] for s in seen), np.zeros(len(chosen)))
    amounts = np.asarray(np.linalg.solve(normal, pull), dtype=float)
    return amounts, float(pull @ amounts)


def _tested(case: Case, found: _Linear, t: Thresholds, jobs: int) -> Proposal:
    """The term fitted together with the nuisance, and tried on the withheld recordings."""
    choice, null = found.choice, case.comparison.null
    order = np.argsort(-np.abs(found.amounts))
    parts = tuple(choice.parts[found.parts[k]] for k in order)
    term = Term(choice.place, parts, tuple(found.amounts[k] for k in order))
    candidate = candidate_of(term, choice.place.blocks)
    problems = extended(case.comparison.problems, candidate.key, term)
    unit = np.array([_quantile(p.low, p.high, p.default, p.scale) for p in candidate.parameters])
    starts: dict[str, tuple[FloatArray, ...]] = {b: (unit,) for b in candidate.blocks}
    widths = {b: null.fits[b].prior_sd for b in candidate.blocks}
    fits, _ = refit(problems, null, Screened(candidate, (unit,), 0.0, starts, widths))
    answer = plain(problems, Hypothesis((candidate,), {**null.fits, **fits}), case.null)
    carried = transferred(problems, case.null, [answer], case.withheld, jobs)[0].session
    shrinks = {"fitted": in_changed_blocks(case.null, answer), **carried}
    last = answer.fits[candidate.blocks[-1]]
    values = last.active[candidate]
    scale = max(_temper(problems[candidate.blocks[-1]], last), 1.0)
    at = last.place(candidate)
    sd = float(np.sqrt(scale * last.covariance[at, at])) * (candidate.parameters[0].high - candidate.parameters[0].low)
    fitted = term.at(values)
    errors = errors_of(fitted.amounts, sd)
    nats = _evidence(problems, null, Hypothesis((candidate,), fits)) - _choosing(found, fitted)
    return Proposal(fitted, nats, shrinks, errors, _doubt(shrinks, t), answer)


def errors_of(amounts: Sequence[float], sd: float) -> tuple[float, ...]:
    """Standard errors of amounts that keep their ratios, where the first has one of ``sd``; of a term that the fit took
    away, all of them have that."""
    return tuple(sd * abs(a / amounts[0]) if amounts[0] else sd for a in amounts)


def _evidence(problems: Mapping[str, Problem], null: Hypothesis, h: Hypothesis) -> float:
    """Nats by which a fitted term is more probable than none, in the blocks that it touches."""
    nats = 0.0
    for b, f in h.fits.items():
        temper = _temper(problems[b], f)
        gain = (
            f.evidences(temper, problems[b].prior_scales)
            - null.fits[b].evidences(temper, problems[b].prior_scales).max()
        )
        nats += float(np.max(np.asarray(problems[b].likelihood_powers) * gain))
    return nats


def _temper(problem: Problem, f: Fit) -> float:
    """By how much a fit's χ² is to be divided, for its residual and the correlation of that."""
    misfit = f.chi2 / max(len(f.residual) - len(f.nuisance), 1)
    return float(max(misfit * mean_correlation(f.residual, problem.rows.recording), LEAST_TEMPER))


def _choosing(found: _Linear, fitted: Term) -> float:
    """Nats that a term pays for having been chosen: its parts among all of the place, and ratios that might have been
    anything."""
    n, m = found.among, len(found.parts)
    ways = float(gammaln(n + 1) - gammaln(m + 1) - gammaln(n - m + 1))
    size = fitted.place.size
    return ways + sum(max(float(np.log(size / max(2.0 * abs(a), 1e-300))), 0.0) for a in fitted.amounts[1:])


def _quantile(low: float, high: float, value: float, scale: str) -> float:
    return float(np.log(value / low) / np.log(high / low) if scale == "log" else (value - low) / (high - low))


def _doubt(shrinks: Mapping[str, Shrink], t: Thresholds) -> str:
    """Why a term is not believed; '' where it is."""
    judges = {k: s for k, s in shrinks.items() if k == "waveform"} or {
        k: s for k, s in shrinks.items() if k != "fitted"
    }
    fitted = shrinks["fitted"].value
    if fitted is None or fitted < t.carries_over:
        return "the best term takes away too little where it was fitted"
    if not judges:
        return "no recording is left to test a term on: measure another waveform, or a repeat"
    for split, s in shrinks.items():
        if split != "fitted" and s.after > t.worse_elsewhere * max(s.before, 1.0):
            return f"the best term makes a withheld {split} worse: gap {s.before:.2f} -> {s.after:.2f}"
    least = max(t.carries_over, t.carried_share * fitted)
    carried = [s.value for s in judges.values() if s.value is not None]
    if not carried or max(carried) < least:
        told = ", ".join(f"{k} {s.before:.2f} -> {s.after:.2f}" for k, s in judges.items())
        return f"the best term does not carry over to withheld recordings: gap {told}"
    return ""
