"""The screening: every effect on top of a fitted hypothesis, by the linear refit of the nuisance under several widths
of its prior, then a few steps of a real fit where straight lines may mislead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from gap.inference.evidence import Fit, Hypothesis
from gap.inference.hypothesis import FROZEN, Candidate
from gap.inference.least_squares import fit, under
from gap.inference.linear import Projector
from gap.inference.problem import Problem
from gap.inference.workers import each
from gap.search.beside import Beside
from gap.search.joint import together
from gap.search.starts import by_steps, plain_start, starting_points
from gap.search.traces import traced
from sim_devices.chain import FloatArray

STEEP = 10.0
"""Detectability at the weakest strength simulated above which the linear screening says nothing."""
STARTS = 2
"""Screening points from which a refit starts."""
STRAIN_EACH, STRAIN_ONE = 2.5, 3.0
"""Mean penalty of a base's tolerances, or σ by which one is off, from which on effects are looked at beside a
fault-free instrument, too."""
UNSEEN = 0.3
"""σ by which an effect must change a row to be looked at there."""
NEARLY, FEW, FROM_SOUND = 8, 8, 4
"""How many are fitted for a few steps there, those steps, and how many of other names are refitted for it."""
QUICK = 3
"""Steps of a first fit of a screened effect."""
AMPLITUDES = (0.25, 2.0)
"""How far a linear rescaling of a screened effect may be trusted, as a multiple of its simulated strength."""
AS_IT_IS = (1.0, 1.0)
"""The same of an answer by steps: with another threshold other steps are left out, and none is larger."""


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
    score: float = 0.0  # twice the nats that its traces would earn, at any size
    by_chance: bool = False  # whether it moves no prediction but makes the noise wider


@dataclass(frozen=True)
class _ProfiledResidual:
    """A block's residual under one prior width ``sd`` (p,) of its nuisance: an effect must explain it.

    ``aim`` (n,) is the residual after the linear nuisance refit, ``evidence`` the base's log evidence.
    """

    sd: FloatArray
    projector: Projector
    aim: FloatArray
    evidence: float

    @classmethod
    def of(cls, f: Fit, sd: FloatArray) -> _ProfiledResidual:
        # The base's own effect parameters are refitted too: they join the nuisance.
        projector = Projector(f.jacobians, np.concatenate([sd, np.ones(len(f.unit))]), f.normal)
        return cls(sd, projector, projector.apply(f.at_mean), f.log_evidence(1.0, (sd,)))


def _seen_through(
    profiled: Sequence[_ProfiledResidual], changes: FloatArray, sizes: tuple[float, float] = AMPLITUDES
) -> tuple[FloatArray, _ProfiledResidual, float]:
    """Twice the nats that each of the ``changes`` (n, k) earns, between ``sizes`` times as large; the lens that shows
    the best; and the most that any would earn at any size."""
    scores, at_any_size = [], []
    seen = profiled[0].projector.jacobian.T @ changes
    for lens in profiled:
        along = np.maximum(lens.projector.squares(changes, seen), 1e-9)
        cross = lens.aim @ changes
        size = np.clip(cross / along, *sizes)
        scores.append(lens.evidence + 0.5 * np.maximum(2 * cross - along, size * (2 * cross - size * along)))
        at_any_size.append(lens.evidence + 0.5 * np.square(cross) / along)
    base = np.logaddexp.reduce([lens.evidence for lens in profiled])
    best = int(np.argmax(np.max(scores, axis=1)))
    most = float(np.max(np.logaddexp.reduce(at_any_size, axis=0)))
    return 2.0 * (np.logaddexp.reduce(scores, axis=0) - base), profiled[best], 2.0 * float(most - base)


def screen(
    problems: dict[str, Problem],
    base: Hypothesis,
    candidates: Sequence[Candidate],
    known: Sequence[Screened] = (),
    quick_fits: int = 0,
    jobs: int = 1,
    least_score: float = 0.0,
    far_fits: int = 0,
) -> tuple[list[Screened], int]:
    """Every candidate on top of ``base``, by the linear nuisance refit; best first. Also the number of simulations.

    The traces of candidates that are ``known`` from another base are used again: a second effect adds nearly its
    change alone, and whatever looks worth it is refitted. The best ``quick_fits`` are fitted a little, and so are
    ``far_fits`` of those whose weakest strength is still far from linear and whose traces would earn ``least_score``
    at any size. Candidates are simulated and fitted by ``jobs`` processes."""
    before = {s.candidate: s for s in known}
    profiled = {b: [_ProfiledResidual.of(f, sd) for sd in problems[b].prior_scales] for b, f in base.fits.items()}
    own = {b: Projector(f.jacobian, f.prior_sd) for b, f in base.fits.items()}
    out, simulations = [], 0
    new = [c for c in candidates if c not in before]
    looked = dict(zip(new, each(partial(_looked_at, problems, base, own, profiled), new, jobs), strict=True))
    for candidate in candidates:
        if candidate in before:
            units, traces, sure = before[candidate].units, before[candidate].traces, False
        else:
            units, traces, sure = looked[candidate]
            simulations += len(candidate.blocks) * len(units)
        out.append(_screened(candidate, units, traces, sure, problems, base, own, profiled))
    out.sort(key=lambda s: -s.gain)
    bent = [s for s in out if not s.by_chance]  # by chance no prediction moves, of which a straight line could mislead
    far = [s for s in bent[quick_fits:] if s.score >= least_score and min(d for _, d in s.detectability) > STEEP]
    unsure = bent[:quick_fits] + sorted(far, key=lambda s: -s.score)[:far_fits]
    for s, (gain, starts, n) in zip(unsure, each(partial(_quick_fit, problems, base), unsure, jobs), strict=True):
        simulations += n
        if gain > s.gain:
            s.gain, s.starts = gain, starts
    return sorted(out, key=lambda s: -s.gain), simulations


def _screened(
    candidate: Candidate,
    units: tuple[FloatArray, ...],
    traces: dict[str, FloatArray],
    sure: bool,
    problems: dict[str, Problem],
    base: Hypothesis,
    own: dict[str, Projector],
    profiled: dict[str, list[_ProfiledResidual]],
) -> Screened:
    """A candidate as its ``traces`` (n, points) show it in each block."""
    score, along, by_chance = 0.0, np.zeros(len(units)), False
    earned, widths = {}, {}
    for b, changes in traces.items():
        along += own[b].squares(changes, own[b].jacobian.T @ changes)
        gains, lens, most = _seen_through(profiled[b], changes, AS_IT_IS if by_steps(candidate) else AMPLITUDES)
        score += most
        if problems[b].noise_scale({candidate: candidate.values(units[0])}) is not None:
            by_chance = True  # the prediction does not move, the residual counts for less
            gains = np.array([_widened(problems[b], base.fits[b], candidate, unit) for unit in units])
        earned[b], widths[b] = gains, lens.sd
    gain, starts = _beginnings(candidate, units, earned)
    if candidate.event:
        gain -= _windows(sum(len(base.fits[b].residual) for b in traces))
    seen = list(zip(units, np.sqrt(np.maximum(along, 0.0)).tolist(), strict=True))
    return Screened(candidate, units, gain, starts, widths, seen, traces, sure, score, by_chance)


def _beginnings(
    candidate: Candidate, units: Sequence[FloatArray], earned: dict[str, FloatArray]
) -> tuple[float, dict[str, tuple[FloatArray, ...]]]:
    """The gain of an effect at its best points of ``units``, by the gains (points,) ``earned`` in each block; and
    the points to fit from. An event is at the same moment in all blocks, and the one that shows it most comes first.
    """
    if candidate.event:
        whole = np.sum(list(earned.values()), axis=0)
        first = int(np.argmax(whole))
        earned = {b: whole for b, _ in sorted(earned.items(), key=lambda one: -one[1][first])}
    starts = {}
    for b, gains in earned.items():
        order = np.argsort(-gains)[:STARTS]
        starts[b] = tuple(units[k] for k in order if k == order[0] or gains[k] > 0.6 * gains.max())
    bests = [float(gains.max()) for gains in earned.values()]
    return bests[0] if candidate.event else sum(bests), starts


def as_open(width: FloatArray, base: Fit) -> FloatArray:
    """The prior's ``width`` (p,) to fit an effect under from ``base``: the base's, if it would freeze parameters that
    the base has moved."""
    return base.prior_sd if np.any((width <= FROZEN) & (base.prior_sd > FROZEN)) else width


def strains(problem: Problem, base: Fit) -> bool:
    """Whether a fit of the simulation by itself strains the tolerances that its nuisance is."""
    free = problem.prior_sd > FROZEN
    off = np.abs(base.nuisance - problem.prior_mean)[free] / problem.prior_sd[free]
    return base.penalty >= STRAIN_EACH * len(off) or bool(np.any(off >= STRAIN_ONE))


def from_sound(
    problems: dict[str, Problem], base: Hypothesis, screened: Sequence[Screened]
) -> tuple[list[Screened], int]:
    """Those effects that explain most beside a sound instrument, where the base strains its tolerances, and the number
    of simulations.

    Such tolerances have taken on much of the effect, and no straight line leads back. The effects' fits are
    to start from the points where they do.
    """
    out: list[Screened] = []
    simulations = 0
    for block, problem in problems.items():
        sound = problem.sound
        if sound is None or not strains(problem, base.fits[block]):
            continue
        near, tried = _near_sound(problem, sound, block, screened)
        simulations += tried
        names: set[str] = set()
        for f, s in sorted(near, key=lambda one: one[0].objective):
            if s.candidate.name not in names and len(names) < FROM_SOUND:
                names.add(s.candidate.name)
                # An effect is the same in every block.
                s.starts = {b: (f.unit, *others[: STARTS - 1]) for b, others in s.starts.items()}
                out += [s] if s not in out else []
    return out, simulations


def _near_sound(
    problem: Problem, sound: FloatArray, block: str, screened: Sequence[Screened]
) -> tuple[list[tuple[Fit, Screened]], int]:
    """Short fits of the effects that explain most of a block beside its ``sound`` (p,) instrument, and the number of
    simulations."""
    jacobian = problem.evaluate(sound, {}).jacobian
    refits = [Projector(jacobian, sd) for sd in problem.prior_scales]
    seen = [s for s in screened if block in s.traces and np.max(np.abs(s.traces[block]), initial=0.0) > UNSEEN]
    looked = [(Beside(problem, sound, refits, s.candidate), s) for s in seen]
    first = sorted(((beside.nearest(s.units), beside, s) for beside, s in looked), key=lambda one: one[0][0])
    closer = [(beside.closer(*nearest), s) for nearest, beside, s in first[: 2 * NEARLY]]
    best = sorted(closer, key=lambda one: one[0][0])[:NEARLY]
    near = [(fit(problem, (s.candidate,), unit, sound, FEW), s) for (_, unit), s in best]
    return near, sum(beside.tried for beside, _ in looked) + sum(f.simulations for f, _ in near)


def as_if_known(
    problems: dict[str, Problem], screened: Sequence[Screened], most: int, jobs: int = 1
) -> tuple[list[Screened], int]:
    """Those effects, of ``most`` names for a block, with which a simple law comes nearest to the noise, where none does
    by itself; and the number of simulations.

    A wide prior may swallow the very effect without which a simple law would do. By evidence beside the wide
    prior it earns nothing until it is fitted, and the law has taken on too much of it for a straight line to lead
    there: each is fitted a few steps under the law alone. The effects' fits are to start from there.
    """
    out: list[Screened] = []
    simulations = 0
    for block, problem in problems.items():
        if not (most and problem.open_law):
            continue
        asked = [s for s in screened if block in s.traces and not s.by_chance and not s.candidate.event]
        tries = each(partial(_simply, problem), asked, jobs)
        found = [(f.objective, f, s) for f, s in zip(tries, asked, strict=True) if f is not None]
        simulations += sum(f.simulations for _, f, _ in found)
        names: set[str] = set()
        for _, f, s in sorted(found, key=lambda one: one[0]):
            if s.candidate.name not in names and len(names) < most:
                names.add(s.candidate.name)
                s.starts[block] = (f.unit, *s.starts[block][: STARTS - 1])
                out += [s] if s not in out else []
    return out, simulations


def _simply(problem: Problem, screened: Screened) -> Fit | None:
    """A few steps of a fit under a simple law alone, from a small effect of usual shape."""
    return problem.under_simple_law(screened.candidate, plain_start(screened.candidate))


def _windows(rows: int) -> float:
    """χ² that the best of all windows of so many rows takes away by chance: an event was looked for in all of them."""
    return 2.0 * float(np.log(max(rows, 2) ** 2 / 2))


def _widened(problem: Problem, base: Fit, candidate: Candidate, unit: FloatArray) -> float:
    """Twice the nats that the wider noise of an effect by chance, at ``unit`` (k,), earns on the rest of a fit."""
    active = {**base.active, candidate: candidate.values(unit)}
    there = problem.evaluate(base.nuisance, active, want_jacobian=False).residual
    before, after = (1.0 if t is None else t for t in map(problem.noise_scale, (base.active, active)))
    wider = float(np.sum(np.log(after / before)))
    return float(base.residual @ base.residual - there @ there) - 2.0 * wider


def _looked_at(
    problems: dict[str, Problem],
    base: Hypothesis,
    own: dict[str, Projector],
    profiled: dict[str, list[_ProfiledResidual]],
    candidate: Candidate,
) -> tuple[tuple[FloatArray, ...], dict[str, FloatArray], bool]:
    """Where ``candidate`` is looked at, its traces there, and whether it must be refitted."""
    points, sure = starting_points(candidate, problems, base)
    units, traces = traced(candidate, problems, base, own, points)
    lenses = {b: [(r.evidence, r.projector, r.aim) for r in profiled[b]] for b in candidate.blocks}
    if more := together(candidate, units, traces, lenses):
        further, changes = traced(candidate, problems, base, own, more)
        units, traces = (*units, *further), {b: np.hstack([traces[b], changes[b]]) for b in traces}
    return units, traces, sure


def _quick_fit(
    problems: dict[str, Problem], base: Hypothesis, screened: Screened
) -> tuple[float, dict[str, tuple[FloatArray, ...]], int]:
    """A few steps of a fit from where the linear screening sees most: its gain, where it came to, and the number of
    simulations."""
    gain, simulations, there = 0.0, 0, None
    starts = {}
    for block, (unit, *others) in screened.starts.items():
        before, problem = base.fits[block], problems[block]
        here = under(problem, before.prior_mean, as_open(screened.widths[block], before))
        hypothesis = (*before.hypothesis, screened.candidate)
        start = np.concatenate([before.unit, unit if there is None else there])
        steps = QUICK if there is None else 0
        quick = fit(here, hypothesis, start, before.nuisance, steps, jacobian=before.jacobian, gram=before.gram)
        if screened.candidate.event:  # where the block that shows it most has it
            there = quick.unit[len(before.unit) :]
        gain += 2 * (quick.log_evidence(1.0, problem.prior_scales) - before.log_evidence(1.0, problem.prior_scales))
        simulations += quick.simulations
        starts[block] = (quick.unit[len(before.unit) :], *others)
    return gain, starts, simulations
