"""Where the screening looks for an effect: a grid over its prior, or the places that the data themselves show.

A fit finds a narrow optimum (rhythm, moment, one recording) only from close by. Effects say by the names of their
parameters that they are such: a ``phase`` with a ``frequency``, an ``interval``, a ``period`` or a ``tau``; a
``moment``, which may have a ``duration``; a ``later``; a ``within``; a ``capacity``; a ``knee``; a ``rest``; in
processing, a ``delay``.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from itertools import product

import numpy as np

from gap.data.rhythms import humps, jumps, lines, looks, since_the_start, spells, wanderings
from gap.inference.evidence import Fit, Hypothesis
from gap.inference.hypothesis import Candidate, Lateness, to_unit
from gap.inference.problem import Problem
from gap.search.joint import signed, star
from gap.search.windows import answered, to_the_end
from sim_devices.chain import FloatArray, Parameter

STRENGTHS = (0.06, 0.3, 0.7)
WHOLE = 1.0
"""Quantile of a share that usually is all: cables are exchanged or not, and a little is no start for a fit of it."""
SIGNED = (-0.2, -0.04, -0.006, 0.006, 0.04, 0.2)
"""Quantiles of the prior from the value that does nothing, where that lies inside: half the range is mostly absurd."""
SHAPES = (0.2, 0.5, 0.8)
BESIDE = (0.1, 0.5)
"""The same for a law that is usually plain: with a little of something beside it, or much."""
THRESHOLDS = tuple(np.linspace(0.1, 0.9, 27).tolist())
"""Quantiles of a ``band`` within which nothing answers: an answer to a ramp by steps fits from close by only."""
RESTS = tuple(np.linspace(0.35, 0.95, 12).tolist())
"""The same of a ``rest`` that must be long enough: rests of a protocol differ by steps, and no fit leads from one to
another."""
LIMITS = (0.1, 0.25, 0.4, 0.48, 0.53, 0.57, 0.61, 0.66, 0.72, 0.8)
"""The same of a limit by itself: many a signal meets one for moments only, or would go farther by a simulation that was
never fitted to it."""
LOWER_LIMITS = tuple(1.0 - q for q in LIMITS)
RATES = (0.3, 0.45, 0.6, 0.7, 0.8, 0.87, 0.93, 0.97)
"""The same of a limit of a rate, which few moments of a signal meet."""
SPANS = (0.06, 0.15, 0.22, 0.3, 0.5, 0.7)
"""The same of a limited rate by the time that a span takes: one that is far too slow never arrives, and from there no
fit leads on."""
NAMED = {
    "azimuth": (0.1, 0.35),
    "elevation": (0.5, 0.85),
    "rest": RESTS,
    "span_time": SPANS,
    "presliding": (0.0, 0.04, 0.3),
    "second_sine": (0.5,),
    "second_cosine": (0.5,),
}
"""The same by a parameter's name: of directions two in plane and two that rise; of presliding some micrometres, too, as
no fit leads on from none; of a second harmonic none, as a fit leads to it from the first alone."""
BURSTS = 3
"""Moments at which samples may be lost that are tried."""
MAX_GRID = 12
AGREED = 0.85
"""Share of the commands' lateness that looks at equal intervals must explain to be refitted wherever they rank."""

SHARES = {"capacity": (1.05, 1.25), "knee": (0.3, 0.6, 0.85), "limit": (1.0, 1.2), "at": (0.3, 0.55, 0.8)}
"""Values that are looked at, as shares of the greatest one measured. Far above it no capacity shows, below it all is
lost; a knee does not show above it, nor does a flaw at one height; at a limit a channel is cut off, or it bends towards
one beyond."""

BLEEDS = (0.01, 0.2)
"""1/s that a held suction draws from a store: what is drawn at once and what is drawn in holds empty it otherwise."""

Place = Mapping[str, float]
"""Values of some of an effect's parameters."""


def grid(candidate: Candidate, known: Collection[str] = ()) -> list[FloatArray]:
    """Screening points (k,) in prior quantiles: strengths first, shapes as far as `MAX_GRID` allows. Parameters that
    are ``known`` from elsewhere are not varied."""
    axes = []
    several = which if len(which := signed(candidate)) > 1 else []  # each alone, then together
    size = max(len(several), 1)
    for k, p in enumerate(candidate.parameters):
        values = (0.5,) if k in several or p.name in known else _values(p)
        if values not in (THRESHOLDS, RESTS, LIMITS, LOWER_LIMITS, RATES):
            values = next((v for v in (values, _fewer(p, values)) if size * len(v) <= MAX_GRID), _usual(p))
        size *= len(values)
        axes.append(values)
    points = [np.array(point) for point in product(*axes)]
    return star(candidate, np.array(points)) if several else points


def _values(p: Parameter) -> tuple[float, ...]:
    """Quantiles of its prior at which a parameter is looked at."""
    if p.name in NAMED:
        return NAMED[p.name]
    if p.name == "band" and p.null is not None:
        return THRESHOLDS
    if p.name == "limit" and p.null is None:
        return LIMITS if p.default > 0.5 * (p.low + p.high) else LOWER_LIMITS
    if p.name == "rate" and p.null is None:
        return RATES
    if p.null is None:
        return (to_unit(p, p.default), *BESIDE) if _plain(p) else SHAPES
    if p.low < p.null < p.high:
        middle = to_unit(p, p.null)
        return tuple(float(np.clip(middle + d, 0, 1)) for d in SIGNED)
    return (*STRENGTHS, WHOLE) if p.default == p.high else STRENGTHS


def _plain(p: Parameter) -> bool:
    """Whether a shape is nothing in the plain form of a law, and so at an end of its prior."""
    return p.null is None and p.scale == "linear" and p.default in (p.low, p.high)


def _fewer(p: Parameter, values: tuple[float, ...]) -> tuple[float, ...]:
    """Of these the fewest that serve: of a strength two, of a shape the usual one."""
    return _usual(p) if p.null is None else values[len(values) // 2 - 1 : len(values) // 2 + 1]


def _usual(p: Parameter) -> tuple[float, ...]:
    """The one value of a parameter where there is room for no more."""
    return BESIDE[:1] if _plain(p) else (0.5,)


def by_steps(candidate: Candidate) -> bool:
    """Whether the strength of an effect is a threshold below which nothing answers."""
    return any(p.name == "band" and p.null is not None for p in candidate.parameters)


def plain_start(candidate: Candidate) -> FloatArray:
    """A point (k,) of an effect's prior, in quantiles, from which a fit may lead anywhere: small, of usual shape."""
    at = np.full(len(candidate.parameters), 0.5)
    for k, p in enumerate(candidate.parameters):
        if p.null is not None:
            at[k] = to_unit(p, p.null) + SIGNED[4] if p.low < p.null < p.high else STRENGTHS[1]
    return at


def starting_points(
    candidate: Candidate, problems: Mapping[str, Problem], base: Hypothesis
) -> tuple[list[FloatArray], bool]:
    """Points (k,) in prior quantiles at which to screen ``candidate`` on top of ``base``; and whether they stand out
    so clearly that it must be refitted."""
    places: list[Place] = []
    sure = False
    for b in candidate.blocks:
        found, certain = _places(candidate, problems[b], base.fits[b])
        places += found
        sure |= certain
    points = grid(candidate, {name for place in places for name in place})
    return [p for place in places for p in _placed(candidate, points, place)] or points, sure


def _placed(candidate: Candidate, points: Sequence[FloatArray], place: Place) -> list[FloatArray]:
    """The different ones of ``points``, some of their parameters put at ``place``."""
    moved = np.array(points)
    for k, p in enumerate(candidate.parameters):
        if p.name in place:
            moved[:, k] = to_unit(p, place[p.name])
    return list(np.unique(moved, axis=0))


def _places(candidate: Candidate, problem: Problem, base: Fit) -> tuple[Sequence[Place], bool]:
    """Where a narrow effect would have to be, after a fit of the problem; nothing for other effects."""
    parameters = {p.name: p for p in candidate.parameters}
    time, recording, residual = problem.rows.time, problem.rows.recording, base.residual
    if "moment" in parameters:
        return _spells(candidate, problem, base), False
    if "later" in parameters:
        return [{"later": later} for later in since_the_start(time, residual, recording)], False
    if places := _of_the_greatest(candidate, problem):
        return places, False
    if "within" in parameters:
        return [{"within": float(np.median(time[recording == k]))} for k in np.unique(recording)], False
    if "delay" in parameters and candidate.stage == "processing" and problem.resets:
        return [{"delay": delay} for delay in problem.resets], True
    return _rhythms(parameters, problem, base) if parameters.keys() & {"phase", "frequency"} else ([], False)


def _rhythms(parameters: Mapping[str, Parameter], problem: Problem, base: Fit) -> tuple[Sequence[Place], bool]:
    """The rhythms that a residual, or the lateness of what it is about, may have; and whether one explains it."""
    if "frequency" in parameters:
        return _beats(parameters, problem, base), False
    time, residual = problem.rows.time, base.residual
    if "tau" in parameters:
        tau = parameters["tau"]
        seen = Lateness(time, residual, np.ones(len(residual)), np.zeros(len(residual), dtype=bool))
        return [{"tau": length, "phase": phase} for length, phase, _ in wanderings(seen, tau.low, tau.high)], False
    late = problem.lateness(base)
    if late is None or not parameters.keys() & {"interval", "period"}:
        return [], False
    if "interval" in parameters:
        found = looks(late)
        places = [{"interval": interval, "phase": phase} for interval, phase, _ in found]
        return places, any(share > AGREED for _, _, share in found)
    period = parameters["period"]
    swings = wanderings(late, period.low, period.high) if len(late.time) else []
    return [{"swing": a, "period": length, "phase": phase} for length, phase, a in swings], False


def _beats(parameters: Mapping[str, Parameter], problem: Problem, base: Fit) -> list[Place]:
    """The rhythms of a rate that a residual may have: with a phase, or, of an effect that keeps none, without."""
    time, recording, residual = problem.rows.time, problem.rows.recording, base.residual
    low, high = parameters["frequency"].low, parameters["frequency"].high
    if "phase" not in parameters:
        channel = problem.rows.labels["channel"][0]
        piece = channel * (int(recording.max()) + 1) + recording
        return [{"frequency": rate} for rate in humps(time, piece, residual, low, high)]
    ways = (0.0, np.pi) if "elevation" in parameters else (0.0,)  # a direction may point either way
    return [_wave(time, residual, line, way) for line in lines(time, residual, low, high) for way in ways]


def _of_the_greatest(candidate: Candidate, problem: Problem) -> list[Place]:
    """Where an effect begins that only great values meet: shares of the greatest. What is cut off ends there."""
    most = float(np.max(np.abs(problem.measured)))
    for p in candidate.parameters:
        # A limit of force is not in the unit of an axis.
        if p.name in SHARES and (p.name != "limit" or (candidate.name == "sensor_saturation" and p.unit == "m")):
            shares: list[Place] = [{p.name: share * most} for share in SHARES[p.name]]
            bleeds = BLEEDS if any(q.name == "bleed" for q in candidate.parameters) else ()
            with_bleed: list[Place] = [{**place, "bleed": bleed} for place in shares for bleed in bleeds]
            return with_bleed or shares
    return []


def _spells(event: Candidate, problem: Problem, base: Fit) -> list[Place]:
    """When an event may begin, and how long it may last."""
    time, recording, residual = problem.rows.time, problem.rows.recording, base.residual
    longest = [p.high for p in event.parameters if p.name == "duration"]
    if not longest:
        values = event.values(plain_start(event))
        return [{"moment": m} for m in bursts(event, problem, base, values)]
    moments = jumps(time, residual, recording)
    windows = [*spells(time, residual, recording), answered(base, problem.rows, _all_along(event, problem, base))]
    return [{"moment": m, "duration": length} for m, length in [*[(m, longest[0]) for m in moments], *windows]]


def bursts(event: Candidate, problem: Problem, base: Fit, values: Mapping[str, float]) -> list[float]:
    """Moments, s, at which an event of such ``values`` that lasts to the end of its recording may begin."""
    return to_the_end(base, problem.rows, _begun(event, problem, base, values))[:BURSTS]


def _begun(event: Candidate, problem: Problem, base: Fit, values: Mapping[str, float]) -> FloatArray:
    """The change (n,) of a whitened prediction by an event that begins with each recording's first sample."""
    change = np.zeros(len(base.residual))
    for k in np.unique(problem.rows.recording):
        own = problem.rows.recording == k
        active = {**base.active, event: {**values, "moment": float(np.min(problem.rows.time[own]))}}
        changed = problem.evaluate(base.nuisance, active, want_jacobian=False).residual
        change[own] = np.nan_to_num(base.residual - changed)[own]
    return change


def _all_along(event: Candidate, problem: Problem, base: Fit) -> FloatArray:
    """The change (n,) of a whitened prediction by an event that begins with the first sample and does not end."""
    values = event.values(plain_start(event))
    values |= {"moment": float(np.min(problem.rows.time)), "duration": float(np.ptp(problem.rows.time)) + 1.0}
    changed = problem.evaluate(base.nuisance, {**base.active, event: values}, want_jacobian=False).residual
    return np.nan_to_num(base.residual - changed)


def _wave(time: FloatArray, residual: FloatArray, frequency: float, ahead: float) -> Place:
    """The phase, rad, that a wave of some frequency has in a residual (n,), and ``ahead`` rad more."""
    turn = 2 * np.pi * frequency * time
    phase = float(np.arctan2(residual @ np.cos(turn), residual @ np.sin(turn))) + ahead
    return {"frequency": frequency, "phase": phase % (2 * np.pi)}
