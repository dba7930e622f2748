"""The screening: every effect on top of a fitted hypothesis, by the linear refit of the nuisance under several widths
of its prior, then a few steps of a real fit where straight lines may mislead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from gap.hypothesis import Candidate, FloatArray, Problem, to_unit
from gap.solve import Fit, Hypothesis, Projector, fit, under

STRENGTHS = (0.06, 0.3, 0.7)
SIGNED = (-0.2, -0.04, -0.006, 0.006, 0.04, 0.2)
"""Quantiles of the prior from the value that does nothing, where that lies inside: half the range is mostly absurd."""
SHAPES = (0.2, 0.5, 0.8)
MAX_GRID = 9
STEEP = 10.0
"""Detectability at the weakest strength simulated above which the linear screening says nothing."""
LINES = 2
"""Frequencies at which a rhythm is looked for."""
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


def _points(candidate: Candidate, problems: dict[str, Problem], base: Hypothesis) -> list[FloatArray]:
    """The screening grid; of a rhythm, at the frequencies and phases that the residual itself shows, as a fit finds a
    narrow line only from close by."""
    points = grid(candidate)
    names = [p.name for p in candidate.parameters]
    if "frequency" not in names or "phase" not in names:
        return points
    at, turn = names.index("frequency"), names.index("phase")
    known = candidate.parameters[at]
    out = []
    for b in candidate.blocks:
        time, residual = problems[b].rows.time, base.fits[b].residual
        for line in _lines(time, residual, known.low, known.high):
            wave = 2 * np.pi * line * time
            phase = float(np.arctan2(residual @ np.cos(wave), residual @ np.sin(wave))) % (2 * np.pi)
            for unit in points[:: max(len(points) // len(STRENGTHS), 1)]:
                point = unit.copy()
                point[at], point[turn] = to_unit(known, line), phase / (2 * np.pi)
                out.append(point)
    return out


def _lines(time: FloatArray, residual: FloatArray, low: float, high: float) -> list[float]:
    """The strongest frequencies, Hz, between ``low`` and ``high`` in a residual (n,) at uneven ``time`` (n,) s."""
    step = 0.2 / high
    index = ((time - time.min()) / step).astype(np.int64)
    even = np.bincount(index, residual - residual.mean())
    power = np.abs(np.fft.rfft(even, 4 * len(even)))
    frequency = np.fft.rfftfreq(4 * len(even), step)
    power[(frequency < low) | (frequency > high)] = 0.0
    out: list[int] = []
    for k in np.argsort(-power):
        if all(abs(k - other) > 8 for other in out):
            out.append(int(k))
        if len(out) == LINES:
            break
    return [float(frequency[k]) for k in out]


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
            units, traces = before[candidate].units, before[candidate].traces
        else:
            units, traces = tuple(_points(candidate, problems, base)), {}
            for b in candidate.blocks:
                traces[b] = np.column_stack([_trace(problems[b], base.fits[b], candidate, unit) for unit in units])
            simulations += len(candidate.blocks) * len(units)
        gain, along = 0.0, np.zeros(len(units))
        starts, widths = {}, {}
        for b, changes in traces.items():
            along += own[b].squares(changes, own[b].jacobian.T @ changes)
            gains, lens = _seen_through(lenses[b], changes)
            best = float(gains.max())
            order = np.argsort(-gains)[:STARTS]
            starts[b] = tuple(units[k] for k in order if k == order[0] or gains[k] > 0.6 * best)
            widths[b] = lens.sd
            gain += best
        seen = list(zip(units, np.sqrt(np.maximum(along, 0.0)).tolist(), strict=True))
        out.append(Screened(candidate, units, gain, starts, widths, seen, traces))
    out.sort(key=lambda s: -s.gain)
    for k, s in enumerate(out):
        if k < quick_fits or (quick_fits and min(d for _, d in s.detectability) > STEEP):
            simulations += _quick_fit(problems, base, s)
    return sorted(out, key=lambda s: -s.gain), simulations


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
