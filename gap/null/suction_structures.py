"""Structures that a suction regulator may have beside a second order: each is tried until one comes to the noise."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import product
from typing import NamedTuple, Protocol

import numpy as np

from gap.data.tolerances import Tolerance
from gap.inference.evidence import Fit
from gap.inference.hypothesis import FROZEN
from gap.inference.least_squares import fit, under
from gap.inference.problem import Problem
from gap.null.suction_regulator import (
    CLEARS,
    DAMPING,
    EMPTIES,
    FLOW,
    INERTIA,
    LANDS,
    LEAD,
    SHIFT,
    SOFTLY,
    SPAN,
    STAYS,
    SWINGS,
    TIME,
    TRACKS,
    UNKNOWN,
    VALVE,
    VALVE_NOMINAL,
    VENTS,
    WEIGHED,
    WHOLLY,
    Vent,
    opened_flow,
)
from sim_devices.chain import FloatArray
from sim_devices.effects.build import PRESSURE

NOISY, ABOVE, STRAINED, WORTH = 1.2, 1.05, 60.0, 20.0
"""χ² for each row above which a regulator of another structure is tried, and from which on one that weighs its
set-point is, or from such a strain of tolerances on; and how much of both any structure must take away at least,"""
LEFT, FOLLOWS, INTEGRAL, OPENED = 2.0, 0.5, 0.1, 0.3
"""which is one if it leaves less than so much of χ² and strain for each row, and if its flow follows the pressure by so
many tolerances, or it comes to the noise and has an integral of so many 1/s, or a valve that the largest command opens
by so much: else it is but a better place to start from, and something else acts,"""
SPANS, LIMITS = (0.04, 0.08, 0.15, -0.04, -0.08, -0.15), 0.01
"""s for 300 mbar at which a limited rate is looked for, below nought the set-point's, and from which on it is one."""
LEAVES = 0.05
"""Share of the excess over the noise that a structure may leave: what acts beside it is then looked for."""
MOST = 0.5
"""The same of a regulator that is not far from a second order: a command that is looked at now and then is not repaired
by a valve."""
UNEXPLAINED = 0.2
"""Share of the excess over the noise that a regulator of an unknown structure may leave: it has many parameters, and a
larger rest is something else's."""
FAR = 10.0
"""Times wider noise of rows that are left out."""
QUICK_INTEGRAL = 3.0
"""1/s from which on an integral is none that makes up for a leak, where the set-point is weighed."""
SIMPLER = 40.0
"""How much more of χ² and strain a limited rate may leave than a valve that is opened wholly: that has four parameters
more."""
UNLIKE = EMPTIES, STAYS, CLEARS, SWINGS, LANDS
"""Ways to vent that are unlike each other, of which each start is tried."""
FIRST, LEADERS, NEXT, GO_ON, LAST = 10, 2, 6, 3, 40
"""Steps of fits of loops with an integral that vent in these ways, how many of them the other ways begin from and with
how many steps, how many of all go on, and for how long."""
HEAVY = 0.5
"""Inertia of a valve from which a fit begins: a little of it moves nothing;"""
SLUGGISH = (0.5, -0.5)
"""and what is then added to the logarithms of time and damping: a valve that is e times as late, of the same gain."""
HARDLY = 1.3
"""Times that the error of the largest command opens a valve as far as it goes, of which it then lacks hardly any."""
WHOLE = 1.5
"""Tolerances within which a set-point is whole: less of it is a leak in the loop, which its integral repairs."""
INTEGRAL_STARTS = ((0.5, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0), (1.0, 2.0, 0.0, 6.0), (0.5, 1.4, 1.0, 0.0))
"""A PI loop that sees all of its set-point is looked for from these: the integral's rate, how far and how softly its
valve opens, and the rate (1/s) at which the integral tracks that."""
WEIGHED_STARTS = ((-0.6, 0.0, 6.0, -0.4), (0.0, 0.0, 6.0, -0.8))
"""A weighed set-point is looked for from these: logarithms of time and damping, the integral's rate, weight less 1."""
VALVE_STARTS = (
    {"integral_rate": 0.5, "suction_flow_slope": 0.3},
    {"integral_rate": 0.1, "suction_flow_slope": 0.6, "venting_flow_slope": 0.6, "flow_asymmetry": 0.3},
    {
        "integral_rate": 1.0,
        "suction_flow_slope": 1.2,
        "venting_flow_slope": 1.2,
        "flow_asymmetry": 0.9,
        "opened_wholly": 2.0,
    },
    {"integral_rate": 0.5, "opened_wholly": 1.0, "opened_softly": 1.0},
    {"integral_rate": 0.5, "opened_wholly": 2.0, "integral_tracks": 6.0},
)
"""A valve whose flow follows the pressure is looked for from here: one whose flow hardly does, one that vents a chamber
also when it is nearly empty, one between a supply and the air, whose flow is in proportion to the pressure across it,
one that comes softly to its end, and one whose integral tracks it there."""


class Structure(NamedTuple):
    """A structure that was found: the widths (p,) of its prior, where a fit begins (p,), how it vents, and the
    ``objective`` of its fit, as if rows that are left out were at the noise."""

    width: FloatArray
    begin: FloatArray
    vent: Vent
    objective: float

    @property
    def keeps(self) -> bool:
        """Whether an integral stays from one stretch of suction to the next."""
        return self.vent == STAYS and bool(self.width[VALVE.start] > FROZEN)


class Regulated(Problem, Protocol):
    """A recorded pressure whose regulator may be of another structure."""

    tolerances: Mapping[str, Mapping[str, Tolerance]]
    vent: Vent

    @property
    def sigma(self) -> FloatArray: ...
    @property
    def largest(self) -> float: ...
    def prior(self, width: Callable[[Tolerance], float], opened: slice = ...) -> FloatArray: ...
    def with_integral(self, width: FloatArray, vent: Vent) -> Regulated: ...
    def remembered(self, found: Fit) -> float: ...


def _left(block: Regulated, found: Fit) -> float:
    """χ² of a fit, of which what is near the noise may be noise that neighbouring rows share."""
    return block.remembered(found) if found.chi2 < LEFT * len(found.residual) else found.chi2


Attempt = Callable[[Regulated, Fit], Structure | None]


def other_structure(block: Regulated, found: Fit, unknown: bool) -> Structure | None:
    """The first structure that comes to the noise where a second order, ``found``, does not or strains the tolerances,
    or, where all are far from it, the best of those that take most away; None where a second order does, or none of
    them takes most. Where it may be ``unknown``, only that is tried."""
    left = _left(block, found)
    if left > len(found.residual) * NOISY:
        tries: tuple[Attempt, ...] = (_unknown,) if unknown else (_integral, _weighed, _limited, _valve, _heavy)
    elif found.penalty > STRAINED or left > len(found.residual) * ABOVE:
        tries = (_integral, _weighed)
    else:
        tries = ()
    best: Structure | None = None
    for attempt in tries:
        structure = attempt(block, found)
        if structure is not None and (best is None or structure.objective < best.objective - WORTH):
            best = structure
        if best is not None and best.objective < len(found.residual) * LEFT:
            break
    if best is None or best.width[WEIGHED.start] <= FROZEN or best.width[INERTIA] > FROZEN:
        return best
    return _of_inertia(block, best)


def _of_inertia(block: Regulated, light: Structure) -> Structure:
    """``light``, a loop about a valve, or the same of a valve with inertia where that is worth it."""
    heavy = light.width.copy()
    heavy[INERTIA] = block.tolerances["regulator"]["valve_inertia"].widest
    begin = light.begin.copy()
    begin[INERTIA] = HEAVY
    begin[[TIME, DAMPING]] += SLUGGISH
    begin[SHIFT : LEAD + 1] = 0.0  # which had to do for it
    found = fit(block.with_integral(light.width, light.vent), nuisance=light.begin)
    again = fit(block.with_integral(heavy, light.vent), nuisance=begin, iterations=LAST)
    better = again.objective < found.objective - WORTH
    return Structure(heavy, again.nuisance, light.vent, again.objective) if better else light


def _about_valve(block: Regulated) -> FloatArray:
    """A prior's width (p,) with a loop about a valve that has no inertia."""
    width = block.prior(lambda t: t.widest, VALVE)
    width[INERTIA] = FROZEN
    return width


def _limited(block: Regulated, found: Fit) -> Structure | None:
    """A rate that is limited within twice its tolerance."""
    width, best = _of_limited_rate(block, found)
    better = _near(best.objective, found, LEFT)
    if not (better and LIMITS < abs(best.nuisance[SPAN]) < 2.0 * width[SPAN]):
        return None
    return Structure(width, best.nuisance, block.vent, best.objective)


def _of_limited_rate(block: Regulated, found: Fit) -> tuple[FloatArray, Fit]:
    """A prior's width (p,) with a limited rate, and the fit under it."""
    width = block.prior(lambda t: t.widest)
    width[SPAN] = block.tolerances["slew_limit"]["span_time"].value
    looked = under(block, block.prior_mean, width)
    # The time that a second order needs to be as late as a set-point with a limited rate is none of its own.
    begins = np.array([found.nuisance if span > 0.0 else block.prior_mean for span in SPANS])
    begins[:, SPAN] = SPANS
    first = min((fit(looked, nuisance=start, iterations=3) for start in begins), key=lambda f: f.objective)
    return width, fit(looked, nuisance=first.nuisance)


def _integral(block: Regulated, found: Fit) -> Structure | None:
    """A PI loop that sees all of its set-point: it overshoots, where a leak that an integral makes up for falls
    short. Or a loop without an integral whose valve gives no more than so much."""
    width = _about_valve(block)
    width[FLOW] = FROZEN
    near = found.chi2 <= len(found.residual) * NOISY  # an integral is so little that any start will do
    starts = np.array(INTEGRAL_STARTS[:1] if near else [*INTEGRAL_STARTS, INTEGRAL_STARTS[-1]])
    begins = np.tile(block.prior_mean, (len(starts), 1))
    begins[:, [WEIGHED.start, WHOLLY, SOFTLY, TRACKS]] = starts
    begins[-1, [TIME, DAMPING]] = found.nuisance[[TIME, DAMPING]]
    best, vent, objective = min(_with_integral(block, width, begins), key=lambda tried: tried.objective)
    if not near and _near(objective, found, NOISY) and _weighs(best):
        return _of_weighed(block, best, vent, objective)
    if not (_near(objective, found, NOISY) and _of_even_flow(best, width) and _quick(block, best)):
        return None
    # Far from the noise a valve that is opened wholly may be a limited rate, which is simpler.
    opened = not near and best.nuisance[WHOLLY] > OPENED
    if opened and _of_limited_rate(block, found)[1].objective < objective + SIMPLER:
        return None
    return Structure(width, best.nuisance, vent, objective)


def _weighed(block: Regulated, found: Fit) -> Structure | None:
    """A PI loop whose proportional part sees only a share of the set-point."""
    width = block.prior(lambda t: t.widest, WEIGHED)
    begins = np.tile(block.prior_mean, (len(WEIGHED_STARTS), 1))
    begins[:, [TIME, DAMPING, WEIGHED.start, WEIGHED.start + 1]] = WEIGHED_STARTS
    best, vent, objective = min(_with_integral(block, width, begins), key=lambda tried: tried.objective)
    if not (_near(objective, found, NOISY) and _weighs(best)):
        return None
    return Structure(width, best.nuisance, vent, objective)


def _valve(block: Regulated, found: Fit) -> Structure | None:
    """A loop about a valve whose flow follows the pressure."""
    width = _about_valve(block)
    begins = np.tile(block.prior_mean, (len(VALVE_STARTS), 1))
    begins[:, VALVE] = [[at.get(name, 0.0) for name in VALVE_NOMINAL] for at in VALVE_STARTS]
    tries = _with_integral(block, width, (*begins, found.nuisance))
    best, vent, objective = min(tries, key=lambda tried: tried.objective)
    uneven = np.linalg.norm((best.nuisance / width)[FLOW]) > FOLLOWS
    better = _near(objective, found, LEFT if uneven else NOISY)
    if better and not uneven and _weighs(best):
        return _of_weighed(block, best, vent, objective)
    if not (better and _quick(block, best) and (uneven or _of_even_flow(best, width))):
        return None
    return Structure(width, best.nuisance, vent, objective)


def _heavy(block: Regulated, found: Fit) -> Structure | None:
    """A loop about a valve with inertia, of which no valve without it comes near enough to be a place to start from."""
    width = _about_valve(block)
    width[INERTIA] = block.tolerances["regulator"]["valve_inertia"].widest
    begins = np.tile(block.prior_mean, (len(INTEGRAL_STARTS), 1))
    begins[:, [WEIGHED.start, WHOLLY, SOFTLY, TRACKS]] = INTEGRAL_STARTS
    begins[:, [TIME, DAMPING]] += SLUGGISH
    begins[:, INERTIA] = HEAVY
    best, vent, objective = min(_with_integral(block, width, begins), key=lambda tried: tried.objective)
    if not (_near(objective, found, NOISY) and _of_even_flow(best, width) and _quick(block, best)):
        return None
    return Structure(width, best.nuisance, vent, objective)


def _of_weighed(block: Regulated, best: Fit, vent: Vent, objective: float) -> Structure:
    """A loop that weighs its set-point, where others than `_weighed` come to it: not every way leads there."""
    return Structure(block.prior(lambda t: t.widest, WEIGHED), best.nuisance, vent, objective)


def _weighs(found: Fit) -> bool:
    """Whether a loop with a quick integral sees a share of its set-point alone."""
    rate, weight = found.nuisance[WEIGHED]
    return bool(rate > QUICK_INTEGRAL and -1.0 < weight < 0.0)


def _of_even_flow(found: Fit, width: FloatArray) -> bool:
    """Whether a loop has an integral, or a valve that is opened wholly, and sees all of its set-point."""
    rate, weight = found.nuisance[WEIGHED]
    another = rate > INTEGRAL or found.nuisance[WHOLLY] > OPENED
    return bool(another and abs(weight) < WHOLE * width[WEIGHED.stop - 1])


def _quick(block: Regulated, found: Fit) -> bool:
    """Whether a valve that is opened wholly gives as much as a sound one, or nearly all that is ever asked of it."""
    slowest = PRESSURE / (2.0 * block.tolerances["slew_limit"]["span_time"].value)
    return found.nuisance[WHOLLY] < HARDLY or opened_flow(found.nuisance, block.largest) > slowest


def _near(objective: float, found: Fit, left: float) -> bool:
    """Whether a structure of this ``objective`` is worth it: it comes near the noise, to ``left`` of χ² a row, or takes
    nearly all away that a second order, ``found``, leaves above it; and of little at least the most."""
    n = len(found.residual)
    above = found.objective - n
    return objective < min(max(left * n, n + LEAVES * above), n + MOST * above, found.objective - WORTH)


class _Tried(NamedTuple):
    """A fit with an integral, how that vents, and the ``objective`` as if rows that are left out were at the noise."""

    fit: Fit
    vent: Vent
    objective: float


def _with_integral(block: Regulated, width: FloatArray, begins: Iterable[FloatArray]) -> list[_Tried]:
    """Fits under a ``width`` (p,) of the prior, from each of ``begins`` (p,), of loops of each of `VENTS`; those that
    come farthest in some steps go on. How a loop vents moves its other parameters by little: from all of ``begins``
    only ways that are `UNLIKE` are tried, and the others from where the best of these end."""
    loops = {vent: block.with_integral(width, vent) for vent in VENTS}

    def tried(vent: Vent, begin: FloatArray, iterations: int) -> _Tried:
        looked = loops[vent]
        found = fit(looked, nuisance=begin, iterations=iterations)
        return _Tried(found, vent, found.objective + np.count_nonzero(looked.sigma > FAR * block.sigma))

    first = sorted((tried(vent, begin, FIRST) for vent, begin in product(UNLIKE, begins)), key=lambda t: t.objective)
    others = [vent for vent in VENTS if vent not in UNLIKE]
    first += [tried(vent, t.fit.nuisance, NEXT) for vent, t in product(others, first[:LEADERS])]
    first.sort(key=lambda t: t.objective)
    last = [tried(t.vent, t.fit.nuisance, LAST) for t in first[:GO_ON]]
    return [t._replace(objective=t.objective - t.fit.chi2 + _left(loops[t.vent], t.fit)) for t in last]


def _unknown(block: Regulated, found: Fit) -> Structure | None:
    """A structure that nobody knows, where it takes away most of what a second order leaves."""
    width = block.prior(lambda t: t.widest, UNKNOWN)
    looked = under(block, block.prior_mean, width)
    first = min(
        (fit(looked, nuisance=c, iterations=8) for c in (found.nuisance, block.prior_mean)),
        key=lambda f: f.objective,
    )
    best, n = fit(looked, nuisance=first.nuisance, iterations=60), len(found.residual)
    if best.objective - n > UNEXPLAINED * (found.objective - n):
        return None
    return Structure(width, best.nuisance, block.vent, best.objective)
