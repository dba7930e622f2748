"""The screening: every effect on top of a fitted hypothesis, by the linear refit of the nuisance under several widths
of its prior, then a few steps of a real fit where straight lines may mislead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from gap.hypothesis import Candidate, FloatArray, Problem, to_unit
from gap.rhythms import Lateness, jumps, lines, looks, wanderings
from gap.solve import Fit, Hypothesis, Projector, fit, under

STRENGTHS = (0.06, 0.3, 0.7)
SIGNED = (-0.2, -0.04, -0.006, 0.006, 0.04, 0.2)
"""Quantiles of the prior from the value that does nothing, where that lies inside: half the range is mostly absurd."""
SHAPES = (0.2, 0.5, 0.8)
MAX_GRID = 9
STEEP = 10.0
"""Detectability at the weakest strength simulated above which the linear screening says nothing."""
AGREED = 0.85
"""How well the moments of commands must agree on looks at equal intervals for these to be refitted anyway."""
SMALL = (3.0, 60.0)
"""σ by which a point should change the data for straight lines to say something."""
BISECTIONS = 7
"""Simulations at most to find one."""
STARTS = 2
"""Screening points from which a refit starts."""
AMPLITUDES = (0.25, 2.0)
"""How far a linear rescaling of a screened effect may be trusted, as a multiple of its simulated strength."""


@dataclass
class Screened:
    """One effect after the screening: ``gain``, twice the nats it earns with the nuisance refitted; and for each block
    the points of its prior, (k,) each, and the width of the nuisance's prior where a fit should start.

    ``detectability`` lists, for every simulated point, how far it stands out (‖P Δ‖, untempered); ``traces`` are what
    the points change in each block's whitened residual, (n, points).
    """

    candidate: Candidate
    units: tuple[FloatArray, ...]
    gain: float
    starts: dict[str, tuple[FloatArray, ...]]
    widths: dict[str, FloatArray]
    detectability: list[tuple[FloatArray, float]] = field(default_factory=list)
    traces: dict[str, FloatArray] = field(default_factory=dict)
    sure: bool = False  # whether it is refitted wherever it ranks


def grid(candidate: Candidate) -> list[FloatArray]:
    """Screening points (k,) in prior quantiles: strengths first, shapes as far as `MAX_GRID` allows."""
    axes = []
    size = 1
    for p in candidate.parameters:
        values: tuple[float, ...] = STRENGTHS if p.null is not None else SHAPES
        if p.null is not None and p.low < p.null < p.high:
            middle = to_unit(p, p.null)
            values = tuple(float(np.clip(middle + d, 0, 1)) for d in SIGNED)
        if size * len(values) > MAX_GRID:
            values = (0.5,) if p.null is None else (values[len(values) // 2 - 1], values[len(values) // 2])
            if size * len(values) > MAX_GRID:
                values = (0.5,)
        size *= len(values)
        axes.append(values)
    return [np.array(point) for point in product(*axes)]


@dataclass(frozen=True)
class _Lens:
    """A block's residual under one prior width ``sd`` (p,) of its nuisance: what an effect must explain.

    ``aim`` (n,) is the residual after the linear nuisance refit, ``evidence`` the base's log evidence.
    """

    sd: FloatArray
    projector: Projector
    aim: FloatArray
    evidence: float

    @classmethod
    def of(cls, f: Fit, sd: FloatArray) -> _Lens:
        # The base's own effect parameters are refitted too: they join the nuisance.
        jacobian = np.hstack([f.jacobian, f.effect_jacobian])
        projector = Projector(jacobian, np.concatenate([sd, np.ones(f.effect_jacobian.shape[1])]), f.normal)
        at_mean = f.residual + f.jacobian @ (f.nuisance - f.prior_mean)
        return cls(sd, projector, projector.apply(at_mean), f.log_evidence(1.0, (sd,)))


def _seen_through(lenses: Sequence[_Lens], changes: FloatArray) -> tuple[FloatArray, _Lens]:
    """Twice the nats that each of the ``changes`` (n, k) earns, its size adjusted; and the lens that shows the best."""
    scores = []
    seen = lenses[0].projector.jacobian.T @ changes
    for lens in lenses:
        along = np.maximum(lens.projector.squares(changes, seen), 1e-9)
        cross = lens.aim @ changes
        size = np.clip(cross / along, *AMPLITUDES)
        scores.append(lens.evidence + 0.5 * np.maximum(2 * cross - along, size * (2 * cross - size * along)))
    base = np.logaddexp.reduce([lens.evidence for lens in lenses])
    best = int(np.argmax(np.max(scores, axis=1)))
    return 2.0 * (np.logaddexp.reduce(scores, axis=0) - base), lenses[best]


def _points(candidate: Candidate, problems: dict[str, Problem], base: Hypothesis) -> tuple[list[FloatArray], bool]:
    """The screening grid; of what is narrow, where the residual itself shows it, as a fit finds it only from close by.
    Also whether it stands out there."""
    points = grid(candidate)
    names = [p.name for p in candidate.parameters]
    if "phase" in names:
        found = [points_of(candidate, problems[b], base.fits[b]) for b in candidate.blocks for points_of in _RHYTHMS]
        return [p for points, _ in found for p in points] or points, any(sure for _, sure in found)
    if "moment" in names:
        moments = []
        for b in candidate.blocks:
            rows = problems[b].rows
            moments += jumps(rows.time, base.fits[b].residual, rows.recording)
        return _at(candidate, points, "moment", moments), False
    if "within" in names:
        rows = problems[candidate.blocks[0]].rows
        middles = [float(np.median(rows.time[rows.recording == k])) for k in np.unique(rows.recording)]
        return _at(candidate, points, "within", middles), False
    return points, False


def _at(candidate: Candidate, points: list[FloatArray], name: str, moments: Sequence[float]) -> list[FloatArray]:
    """``points`` with one parameter at each of ``moments``, s."""
    k = [p.name for p in candidate.parameters].index(name)
    out = []
    for moment in moments:
        moved = np.array(points)
        moved[:, k] = to_unit(candidate.parameters[k], moment)
        out += list(np.unique(moved, axis=0))
    return out or points


Found = tuple[list[FloatArray], bool]


def _lines(candidate: Candidate, problem: Problem, base: Fit) -> Found:
    """Points of a rhythm of some ``frequency``."""
    names = [p.name for p in candidate.parameters]
    if "frequency" not in names:
        return [], False
    at, turn = names.index("frequency"), names.index("phase")
    known, points = candidate.parameters[at], grid(candidate)
    out = []
    time, residual = problem.rows.time, base.residual
    for line in lines(time, residual, known.low, known.high):
        wave = 2 * np.pi * line * time
        phase = float(np.arctan2(residual @ np.cos(wave), residual @ np.sin(wave))) % (2 * np.pi)
        for unit in points[:: max(len(points) // len(STRENGTHS), 1)]:
            point = unit.copy()
            point[at], point[turn] = to_unit(known, line), phase / (2 * np.pi)
            out.append(point)
    return out, False


def _timings(candidate: Candidate, problem: Problem, base: Fit) -> Found:
    """Points of commands that wait for a look, or of a clock that wanders."""
    parameters = {p.name: p for p in candidate.parameters}
    looking, wandering = set(parameters) == {"interval", "phase"}, set(parameters) == {"swing", "period", "phase"}
    late = problem.lateness(base) if looking or wandering else None
    if late is None:
        return [], False
    values, sure = [], False
    if looking:
        for interval, phase, agreement in looks(late):
            values.append({"interval": interval, "phase": phase})
            sure |= agreement > AGREED
    else:
        period = parameters["period"]
        for length, phase, amplitude in wanderings(late, period.low, period.high):
            values.append({"swing": amplitude, "period": length, "phase": phase})
    return [np.array([to_unit(p, v[p.name]) for p in candidate.parameters]) for v in values], sure


def _swings(candidate: Candidate, problem: Problem, base: Fit) -> Found:
    """Points of what goes slowly to and fro with period ``tau``."""
    names = [p.name for p in candidate.parameters]
    if "tau" not in names:
        return [], False
    at, turn = names.index("tau"), names.index("phase")
    known = candidate.parameters[at]
    seen = Lateness(problem.rows.time, base.residual, np.ones(len(base.residual)))
    strengths = {
        tuple(p): p for p in (np.where(np.isin(np.arange(len(names)), (at, turn)), 0.5, p) for p in grid(candidate))
    }
    out = []
    for period, phase, _ in wanderings(seen, known.low, known.high):
        for unit in strengths.values():
            point = unit.copy()
            point[at], point[turn] = to_unit(known, period), phase
            out.append(point)
    return out, False


_RHYTHMS = (_lines, _timings, _swings)


def screen(
    problems: dict[str, Problem],
    base: Hypothesis,
    candidates: Sequence[Candidate],
    known: Sequence[Screened] = (),
    quick_fits: int = 0,
) -> tuple[list[Screened], int]:
    """Every candidate on top of ``base``, by the linear nuisance refit; best first. Also the number of simulations.

    The traces of candidates that are ``known`` from another base are used again: a second effect adds nearly what it
    changes alone, and whatever looks worth it is refitted. The best ``quick_fits``, and those whose weakest strength is
    still far from linear, are fitted a little.
    """
    before = {s.candidate: s for s in known}
    lenses = {b: [_Lens.of(f, sd) for sd in problems[b].alternatives] for b, f in base.fits.items()}
    own = {b: Projector(f.jacobian, f.prior_sd) for b, f in base.fits.items()}
    out, simulations = [], 0
    for candidate in candidates:
        if candidate in before:
            units, traces, sure = before[candidate].units, before[candidate].traces, False
        else:
            points, sure = _points(candidate, problems, base)
            units, traces = _traced(candidate, problems, base, points)
            simulations += len(candidate.blocks) * len(units)
        gain, along = 0.0, np.zeros(len(units))
        starts, widths = {}, {}
        for b, changes in traces.items():
            along += own[b].squares(changes, own[b].jacobian.T @ changes)
            gains, lens = _seen_through(lenses[b], changes)
            times = [problems[b].widening({candidate: candidate.values(unit)}) for unit in units]
            if times[0] is not None:  # the residual does not move, it counts for less
                gains = np.array([_widened(base.fits[b].residual, t) for t in times if t is not None])
            best = float(gains.max())
            order = np.argsort(-gains)[:STARTS]
            starts[b] = tuple(units[k] for k in order if k == order[0] or gains[k] > 0.6 * best)
            widths[b] = lens.sd
            gain += best
        seen = list(zip(units, np.sqrt(np.maximum(along, 0.0)).tolist(), strict=True))
        out.append(Screened(candidate, units, gain, starts, widths, seen, traces, sure))
    out.sort(key=lambda s: -s.gain)
    for k, s in enumerate(out):
        if k < quick_fits or (quick_fits and min(d for _, d in s.detectability) > STEEP):
            simulations += _quick_fit(problems, base, s)
    return sorted(out, key=lambda s: -s.gain), simulations


def _widened(residual: FloatArray, times: FloatArray) -> float:
    """Twice the nats that noise wider by ``times`` (n,) earns on a residual (n,)."""
    return float(np.sum(np.square(residual) * (1.0 - 1.0 / np.square(times)) - 2.0 * np.log(times)))


def _traced(
    candidate: Candidate, problems: dict[str, Problem], base: Hypothesis, points: list[FloatArray]
) -> tuple[tuple[FloatArray, ...], dict[str, FloatArray]]:
    """The points and, for each block, what they change, (n, points); with points where the effect begins to show, if
    none of them has it small: a threshold leaves nothing to linearise below it, and too much far above."""
    units = list(points)
    columns = {b: [_trace(problems[b], base.fits[b], candidate, unit) for unit in units] for b in candidate.blocks}
    strengths = [k for k, p in enumerate(candidate.parameters) if p.null is not None and p.scale == "log"]

    def shown(k: int) -> float:
        return float(np.sqrt(sum(np.sum(np.square(c[k])) for c in columns.values())))

    if len(strengths) == 1:
        at = strengths[0]
        middle = [k for k, u in enumerate(units) if all(u[j] == 0.5 for j in range(len(u)) if j != at)] or [0]
        below = max((units[k][at] for k in middle if shown(k) < SMALL[0]), default=None)
        above = min((units[k][at] for k in middle if shown(k) > SMALL[1]), default=None)
        if below is not None and above is not None and not any(SMALL[0] <= shown(k) <= SMALL[1] for k in middle):
            for _ in range(BISECTIONS):
                unit = units[middle[0]].copy()
                unit[at] = 0.5 * (below + above)
                units.append(unit)
                for b, column in columns.items():
                    column.append(_trace(problems[b], base.fits[b], candidate, unit))
                size = shown(len(units) - 1)
                if SMALL[0] <= size <= SMALL[1]:
                    break
                below, above = (unit[at], above) if size < SMALL[0] else (below, unit[at])
    return tuple(units), {b: np.column_stack(c) for b, c in columns.items()}


def _quick_fit(problems: dict[str, Problem], base: Hypothesis, screened: Screened) -> int:
    """A few steps of a fit from where the linear screening sees most: its gain, and where it came to. Returns the
    number of simulations."""
    gain, simulations = 0.0, 0
    starts = {}
    for block, (unit, *others) in screened.starts.items():
        before, problem = base.fits[block], problems[block]
        here = under(problem, before.prior_mean, screened.widths[block])
        hypothesis, start = (*before.hypothesis, screened.candidate), np.concatenate([before.unit, unit])
        quick = fit(here, hypothesis, start, before.nuisance, iterations=3, jacobian=before.jacobian, gram=before.gram)
        gain += 2 * (quick.log_evidence(1.0, problem.alternatives) - before.log_evidence(1.0, problem.alternatives))
        simulations += quick.simulations
        starts[block] = (quick.unit[len(before.unit) :], *others)
    if gain > screened.gain:
        screened.gain, screened.starts = gain, starts
    return simulations


def _trace(problem: Problem, f: Fit, candidate: Candidate, unit: FloatArray) -> FloatArray:
    """What a candidate at ``unit`` (k,) takes from a fit's whitened residual (n,)."""
    active = {**f.active, candidate: candidate.values(unit)}
    return np.asarray(f.residual - problem.evaluate(f.nuisance, active, want_jacobian=False).residual)
