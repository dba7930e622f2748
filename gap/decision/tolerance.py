"""Whether an effect is within the tolerances of a sound instrument: then it is no finding."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from gap.data.tolerances import Tolerance
from gap.inference.evidence import Hypothesis
from gap.inference.hypothesis import FROZEN, Candidate, from_unit, slope
from gap.inference.least_squares import predicted
from gap.inference.problem import Problem
from sim_devices.chain import FloatArray

Stated = Mapping[str, Mapping[str, Tolerance]]
"""Tolerances of parameters by effect; under `CHANNELS` those of channels as functions of their own values."""
CHANNELS = "channels"
STRAINED = 25.0
"""Fall of the nuisance's penalty beside an effect from which on tolerances were strained without: 5 of them."""
DEGREE = 3
"""Of the polynomial that a channel's error is of its own value: zero, gain, and a bend with one turn."""
KNOWN = 1e-12
"""Variance of a parameter, in tolerances, that counts as known."""


class Size(NamedTuple):
    """How many stated ``tolerances`` an effect is large (inf where none is stated), and by how many tempered σ it shows
    ``beyond`` that. ``of_channels`` is the size of one whose parameters are larger, or have none stated: of how far it
    moves the channels' own scales off those of a sound instrument's simulation, fitted within its tolerances."""

    tolerances: float = float(np.inf)
    beyond: float = 0.0
    of_channels: bool = False

    def within(self, most: float, seen: float) -> bool:
        """Whether it is ``most`` tolerances at most, and shows less than ``seen`` σ beyond."""
        return self.tolerances <= most and self.beyond < seen

    def __str__(self) -> str:
        return f"{self.tolerances:.1f} stated tolerances{' of the channels' if self.of_channels else ''}"


NOT_STATED = Size()


def in_tolerances(
    problems: Mapping[str, Problem],
    null: Hypothesis,
    members: Sequence[Hypothesis],
    stated: Stated,
    temper: Mapping[str, float],
    seen: float = np.inf,
) -> Size:
    """The size of the smallest of hypotheses that cannot be told apart, by its parameters or by its change of the
    channels' own scales, of those that show less than ``seen`` σ beyond if possible.

    Where the simulation by itself strains tolerances to do a hypothesis' work, the hypothesis does not change the
    channels: its parameters alone tell its size then."""
    fair = [h for h in members if all(null.fits[b].penalty - h.fits[b].penalty <= STRAINED for b in problems)]
    sizes = [Size(_by_parameters(h, null, stated)) for h in members]
    sizes += [_by_channels(problems, null, h, stated.get(CHANNELS, {}), temper) for h in fair]
    return min(sizes, key=lambda size: size.tolerances if size.beyond < seen else np.inf, default=NOT_STATED)


def strained(problems: Mapping[str, Problem], null: Hypothesis, h: Hypothesis) -> bool:
    """Whether a simulation without the hypothesis strains tolerances to take it on, where no skin is in play."""
    sound = [b for b, p in problems.items() if not of_skin(p)]
    return any(null.fits[b].penalty - h.fits[b].penalty > STRAINED for b in sound)


def of_skin(problem: Problem) -> bool:
    """Whether a block's nuisance holds the law of a person's skin, known for a simple one as it may be."""
    return problem.open_law or bool(np.any(problem.prior_sd[: problem.law_parameters] > FROZEN))


def _by_parameters(h: Hypothesis, null: Hypothesis, stated: Stated) -> float:
    return max((in_stated(e, h, null, stated) for e in h.effects), default=float(np.inf))


def in_stated(effect: Candidate, h: Hypothesis, null: Hypothesis, stated: Stated) -> float:
    """The size of an effect of a hypothesis in stated tolerances of its parameters, of what they are at `least`, as
    sure as they are beside the ``null``; inf where none is stated."""
    known = stated.get(effect.name, {})
    strengths = [p for p in effect.parameters if p.null is not None]
    # An event is no tolerance: an instrument is off all the time.
    if effect.event or not strengths or any(p.name not in known for p in strengths):
        return float(np.inf)
    surest = h.surest(effect)
    fitted = h.fits[surest]
    at = np.add(fitted.place(effect), [effect.parameters.index(p) for p in strengths])
    units = [(p, known[p.name].value, float(u)) for p, u in zip(strengths, fitted.unit[at], strict=True)]
    value = np.array([(from_unit(p, u) - (p.null or 0.0)) / one for p, one, u in units])
    scale = np.array([slope(p, u) / one for p, one, u in units])
    covariance = fitted.covariance[np.ix_(at, at)] * np.outer(scale, scale)
    gained = null.fits[surest].objective - fitted.objective
    return float(np.max(np.abs(least(value, as_sure(value, covariance, gained)))))


def as_sure(value: FloatArray, covariance: FloatArray, gained: float) -> FloatArray:
    """The ``covariance`` (k, k) of a ``value`` (k,), narrowed where by it nought would be likelier than it is: the fit
    without is worse by ``gained`` in χ², but a threshold, as a dead band's, may be flat about its best value."""
    said = float(value @ np.linalg.pinv(covariance) @ value)
    return covariance * min(1.0, said / gained) if gained > 0.0 else covariance


def least(value: FloatArray, covariance: FloatArray) -> FloatArray:
    """The point (k,) nearest to nought within one standard deviation of ``value`` (k,), by its ``covariance`` (k, k):
    of parameters that are known together only, none by itself tells how large an effect must be."""
    variances, axes = np.linalg.eigh(covariance)
    variances, along = np.maximum(variances, KNOWN), axes.T @ value
    if np.sum(np.square(along) / variances) <= 1.0:
        return np.zeros_like(value)

    def away(weight: float) -> float:  # the more weight on where it is, the less
        return float(np.sum(variances * np.square(along / (variances + weight)))) - 1.0

    weight = brentq(away, 0.0, float(np.sqrt(np.sum(variances * np.square(along)))))
    return np.asarray(axes @ (along * weight / (variances + weight)))


def weakest(h: Hypothesis, within: float) -> bool:
    """Whether a single effect is as weak as its prior allows: ``within`` that share of its range in logarithms."""
    if len(h.effects) != 1:
        return False
    effect = h.effects[0]
    known = enumerate(effect.parameters)
    strength = [k for k, p in known if p.null is not None and p.scale == "log" and p.null < p.low]
    fitted = [f for f in h.fits.values() if effect in f.hypothesis]
    return bool(strength) and all(f.unit[f.place(effect) + strength[0]] < within for f in fitted)


def shortest(h: Hypothesis, within: float) -> bool:
    """Whether a single event is as short as its prior allows: ``within`` that share of its range in logarithms."""
    if len(h.effects) != 1 or not h.effects[0].event:
        return False
    effect = h.effects[0]
    lasting = [k for k, p in enumerate(effect.parameters) if p.name == "duration"]
    fitted = [f for f in h.fits.values() if effect in f.hypothesis]
    return bool(lasting and fitted) and all(f.unit[f.place(effect) + lasting[0]] < within for f in fitted)


def _by_channels(
    problems: Mapping[str, Problem],
    null: Hypothesis,
    h: Hypothesis,
    stated: Mapping[str, Tolerance],
    temper: Mapping[str, float],
) -> Size:
    """The largest change that is a function of the channel's own value alone, in tolerances; and the rest, in σ."""
    # Scatter of the samples moves no prediction.
    by_chance = any(problem.noise_scale(h.fits[b].active) is not None for b, problem in problems.items())
    if not stated or not h.effects or by_chance:
        return NOT_STATED
    largest, rest = 0.0, 0.0
    for block, problem in problems.items():
        nominal, changed = predicted(problem, null.fits[block]), predicted(problem, h.fits[block])
        sigma = problem.sigma * np.sqrt(temper[block])
        codes, names = problem.rows.labels["channel"]
        for k, name in enumerate(names):
            at = codes == k
            change = (changed - nominal)[at]
            if name not in stated:
                rest += float(np.sum(np.square(change / sigma[at])))
                continue
            span = max(float(np.ptp(nominal[at])), 1e-300)
            powers = np.vander((nominal[at] - nominal[at].mean()) / span, DEGREE + 1)
            weights = np.linalg.lstsq(powers / sigma[at, None], change / sigma[at], rcond=None)[0]
            static = powers @ weights
            largest = max(largest, float(np.max(np.abs(static))) / stated[name].value)
            rest += float(np.sum(np.square((change - static) / sigma[at])))
    return Size(largest, float(np.sqrt(rest)), of_channels=True)
