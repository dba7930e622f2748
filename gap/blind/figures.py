"""The figures of the blind check: of which cases each is, how it is computed and the target beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .answers import Case

BINS = ((0.5, 3.0), (3.0, 5.0), (5.0, 10.0), (10.0, 30.0), (30.0, 100.0), (100.0, np.inf))
"""Detectabilities δ between which the first cause's share is told apart."""
_RESAMPLES = 400


@dataclass(frozen=True)
class Figure:
    """One figure with its 95 % bootstrap interval over ``n`` cases; ``target`` like ``>= 0.95``, or empty."""

    name: str
    value: float
    low: float
    high: float
    n: int
    target: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the value meets the target; None without target or cases."""
        if not self.target or not self.n:
            return None
        relation, bound = self.target.split()
        return self.value >= float(bound) if relation == ">=" else self.value <= float(bound)


Array = NDArray[np.float64]
Statistic = Callable[[Sequence[Case]], float]
Kind = Callable[[Case], bool]


@dataclass(frozen=True)
class Definition:
    """A figure: its name, the cases it is about, its statistic and its target.

    Where ``needs`` is given and no case is of that kind, there is nothing to compute it from.
    """

    name: str
    of: Kind
    statistic: Statistic
    target: str = ""
    needs: Kind | None = None

    def figure(self, cases: Sequence[Case]) -> Figure:
        """The figure over those of ``cases`` that it is about."""
        chosen = [c for c in cases if self.of(c)]
        if not chosen or (self.needs is not None and not any(map(self.needs, chosen))):
            return Figure(self.name, float("nan"), float("nan"), float("nan"), 0, self.target)
        low, high = _interval(chosen, self.statistic)
        return Figure(self.name, self.statistic(chosen), low, high, len(chosen), self.target)


def _interval(cases: Sequence[Case], statistic: Statistic) -> tuple[float, float]:
    """The bootstrap interval that 95 % of resampled ``cases`` fall into."""
    rng = np.random.default_rng(0)
    draws = [statistic([cases[i] for i in rng.integers(len(cases), size=len(cases))]) for _ in range(_RESAMPLES)]
    finite = [d for d in draws if np.isfinite(d)] or [float("nan")]
    low, high = np.quantile(finite, [0.025, 0.975])
    return float(low), float(high)


def _share(test: Callable[[Case], bool]) -> Statistic:
    return lambda cases: float(np.mean([test(c) for c in cases]))


def _stage_right(c: Case) -> bool:
    if c.report is None or not c.report.where:
        return False
    return max(c.report.where, key=lambda p: p.probability).stage in c.stages


def calibration_error(cases: Sequence[Case]) -> float:
    """Expected calibration error of the first cause's probability, ten equal bins (Guo et al. 2017)."""
    told, right = _forecasts(cases)
    return _binned_error(told, right) if told.size else float("nan")


def calibration_by_chance(cases: Sequence[Case]) -> float:
    """The calibration error that exact probabilities would have in as few cases: the mean of drawn outcomes.

    The bins take chance for error (Bröcker and Smith 2007, 'consistency'): forty cases leave about .1 of it.
    """
    told, _ = _forecasts(cases)
    if not told.size:
        return float("nan")
    drawn = np.random.default_rng(0).random((_RESAMPLES, told.size)) < told
    return float(np.mean([_binned_error(told, outcome) for outcome in drawn]))


def overconfidence(cases: Sequence[Case]) -> float:
    """How much more probable first causes are called than they are right, in the mean; below nought: too doubtful."""
    told, right = _forecasts(cases)
    return float(np.mean(told) - np.mean(right)) if told.size else float("nan")


def _forecasts(cases: Sequence[Case]) -> tuple[Array, Array]:
    """Probability of each report's first cause, and whether it is right (1 or 0); reports without causes left out."""
    rated = [c for c in cases if c.report and c.report.causes]
    told = [c.report.ranked[0].probability for c in rated if c.report]
    return np.array(told), np.array([bool(c.effects) and c.hit(1) for c in rated], float)


def _binned_error(told: Array, right: Array) -> float:
    cell = np.minimum((told * 10).astype(int), 9)
    return float(np.sum(np.abs(np.bincount(cell, right - told, 10))) / told.size)


def unknown_recall(cases: Sequence[Case]) -> float:
    """Share of unknown effects found by the threshold on their score that flags at most 5 % of the known ones."""
    known = np.array([c.unknown_score for c in cases if c.tier != "T5"])
    hidden = np.array([c.unknown_score for c in cases if c.tier == "T5"])
    if not hidden.size:
        return float("nan")
    if not known.size:
        return float(np.mean(hidden > 0.5))
    # The smallest threshold that at most 5 % of the known exceed.
    threshold = np.sort(known)[::-1][int(0.05 * known.size)]
    return float(np.mean(hidden > threshold))


def _median(value: Callable[[Case], float | None]) -> Statistic:
    def statistic(cases: Sequence[Case]) -> float:
        found = [v for c in cases if (v := value(c)) is not None]
        return float(np.median(found)) if found else float("nan")

    return statistic


def _waveform_shrink(c: Case) -> float | None:
    return c.report.ranked[0].shrink.get("waveform") if c.report and c.report.causes else None


def _seconds(c: Case) -> float | None:
    seconds = c.report.cost.get("seconds") if c.report else None
    return None if seconds is None else float(seconds)


def _size(c: Case) -> int:
    return len(c.report.chosen or ()) if c.report else 0


def _mean_size(cases: Sequence[Case]) -> float:
    return float(np.mean([_size(c) for c in cases]))


# Kinds of cases -------------------------------------------------------------------------------------------------------


def single(c: Case) -> bool:
    """One effect, of a tier whose effects the diagnosis may know."""
    return len(c.effects) == 1 and c.tier in ("T0", "T1", "T2", "T3")


def asked(c: Case) -> bool:
    """One effect, made by a generator that is not the library's."""
    return single(c) and c.tier in ("T2", "T3")


def seen(c: Case) -> bool:
    """One effect, strong enough to be asked for."""
    return asked(c) and c.delta >= 5


def free(c: Case) -> bool:
    """One effect, strong enough for an observer who does not know the skin's law."""
    return asked(c) and (c.delta if c.delta_free is None else c.delta_free) >= 5


def faint(c: Case) -> bool:
    """One effect, too weak to be seen."""
    return asked(c) and c.delta < 3


def sound(c: Case) -> bool:
    """Nothing is hidden."""
    return not c.effects


def seen_or_sound(c: Case) -> bool:
    """Nothing or one strong enough effect, made by a generator that is not the library's."""
    return seen(c) or (sound(c) and c.tier in ("T2", "T3", "T6"))


def pair(c: Case) -> bool:
    """Two effects, each strong enough to be asked for."""
    return len(c.effects) == 2 and min(c.deltas) >= 5


def claimed(c: Case) -> bool:
    """A cause is claimed, in a session with an effect or without."""
    return c.claims and c.tier in ("T2", "T3")


def outside(c: Case) -> bool:
    """The effect is none of the library's."""
    return c.tier == "T5"


def _outside_or_known(c: Case) -> bool:
    return c.delta >= 10 and (outside(c) or (bool(c.effects) and c.tier in ("T1", "T2", "T3")))


def _effect_told(c: Case) -> bool:
    return c.verdict in ("effect", "several")


def _between(low: float, high: float) -> Kind:
    return lambda c: asked(c) and low <= c.delta < high


# The figures ----------------------------------------------------------------------------------------------------------

_first, _third = _share(lambda c: c.hit(1)), _share(lambda c: c.hit(3))
_alarm = _share(lambda c: c.false_alarm)

FIGURES = (
    Definition("top-1, skin alone, delta_free >= 5", lambda c: free(c) and not c.reference, _first, ">= 0.80"),
    Definition("top-1, with references, delta_free >= 5", lambda c: free(c) and c.reference, _first, ">= 0.90"),
    Definition("top-1, beyond twice the stated tolerances", lambda c: free(c) and not c.tolerated, _first),
    Definition("within twice a stated tolerance: unclaimed", lambda c: c.tolerated, _share(lambda c: not c.claims)),
    Definition("right among claims", claimed, _share(lambda c: bool(c.effects) and c.hit(1)), ">= 0.95"),
    Definition(
        "coverage of the 90 % set",
        lambda c: seen(c) and c.covered is not None,
        _share(lambda c: bool(c.covered)),
        ">= 0.88",
    ),
    Definition("size of the 90 % set (mean)", lambda c: seen(c) and c.covered is not None, _mean_size, "<= 2"),
    Definition("top-1", seen, _first, ">= 0.95"),
    Definition("top-3", seen, _third, ">= 0.99"),
    Definition("stage", seen, _share(_stage_right), ">= 0.93"),
    Definition("top-1, delta > 30", lambda c: asked(c) and c.delta > 30, _first, ">= 0.90"),
    Definition("false alarms T0", lambda c: sound(c) and c.tier == "T0", _alarm, "<= 0.02"),
    Definition("false alarms T6", lambda c: sound(c) and c.tier == "T6", _alarm, "<= 0.05"),
    Definition("false alarms T1-T3 without effect", lambda c: sound(c) and c.tier in ("T1", "T2", "T3"), _alarm),
    Definition("calibration error", seen, calibration_error, "<= 0.05"),
    Definition("calibration error of exact probabilities", seen, calibration_by_chance),
    Definition("overconfidence of the first cause", seen, overconfidence),
    Definition("calibration error, sound sessions among them", seen_or_sound, calibration_error),
    Definition("the same of exact probabilities", seen_or_sound, calibration_by_chance),
    Definition("unknown found at 5 % false, delta >= 10", _outside_or_known, unknown_recall, ">= 0.85", needs=outside),
    Definition("both of a pair in the top three", pair, _third, ">= 0.80"),
    Definition("coin tosses between equivalent effects", seen, _share(lambda c: c.coin_toss), "<= 0"),
    Definition("power at delta = 6", lambda c: asked(c) and 4.5 < c.delta < 8, _share(_effect_told), ">= 0.80"),
    Definition("delta < 3 called undetectable", faint, _share(lambda c: c.verdict == "undetectable")),
    Definition("delta < 3 called undetectable or none", faint, _share(lambda c: c.verdict in ("undetectable", "none"))),
    Definition(
        "shrink on another waveform (median; truth: 1)",
        lambda c: seen(c) and c.hit(1) and _waveform_shrink(c) is not None,
        _median(_waveform_shrink),
        ">= 0.95",
    ),
    Definition("seconds a case (median)", lambda c: _seconds(c) is not None, _median(_seconds), "<= 5"),
)
"""Figures of all cases together."""


def of_bins() -> Iterator[Definition]:
    """How often the first cause is right, by detectability."""
    for low, high in BINS:
        name = f"top-1, delta {low:g} - {high:g}" if np.isfinite(high) else f"top-1, delta >= {low:g}"
        yield Definition(name, _between(low, high), _first)


def of_tier(tier: str) -> Definition:
    """How often the first cause is right in one tier."""
    return Definition(f"top-1, {tier}", lambda c: single(c) and c.tier == tier and c.delta >= 5, _first)


def of_instrument(instrument: str) -> tuple[Definition, Definition]:
    """False alarms of one instrument, and how often its first cause is right."""

    def quiet(c: Case) -> bool:
        return sound(c) and c.instrument == instrument and c.tier == "T6"

    return (
        Definition(f"false alarms T6, {instrument}", quiet, _alarm, "<= 0.05"),
        Definition(f"top-1, {instrument}", lambda c: seen(c) and c.instrument == instrument, _first),
    )


def definitions(cases: Sequence[Case]) -> Iterator[Definition]:
    """Every figure that is asked of ``cases``: together, by detectability, by tier, by instrument."""
    yield from FIGURES
    yield from of_bins()
    yield from map(of_tier, ("T1", "T2", "T3"))
    for instrument in sorted({c.instrument for c in cases}):
        yield from of_instrument(instrument)
