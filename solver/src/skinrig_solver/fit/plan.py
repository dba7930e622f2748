"""Which further experiment narrows a parameter most per minute, from a fit and its noise (Fisher's information)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..api import Array, Experiment, Model
from .problem import simulate

DRAWS = 2  # of the posterior beside its centre, over which the expected variance is a mean


@dataclass(frozen=True)
class Candidate:
    """An experiment that could be done: its set-points on a time grid, and its cost [min]."""

    name: str
    experiment: Experiment
    minutes: float


@dataclass(frozen=True)
class Gain:
    """The gain of a candidate for one parameter: its expected standard deviation [SI] afterwards, and the share of
    the present one that goes per minute. ``trouble`` says why it could not be judged."""

    name: str
    minutes: float
    deviation: float
    narrowing: float
    trouble: str = ""

    @property
    def per_minute(self) -> float:
        """Natural logarithm of the narrowing, per minute: the quantity that repeats add up."""
        return -float(np.log1p(-min(self.narrowing, 1.0 - 1e-12))) / self.minutes


@dataclass(frozen=True)
class Known:
    """The state that a fit left: free symbols, values (draws, m) [SI] with the best first, covariance (m, m), held
    parameters; per channel of the model, residual deviation [SI], and effective samples a second; channels of unknown
    zero."""

    symbols: tuple[str, ...]
    values: Array
    covariance: Array
    held: Mapping[str, float]
    noise: Mapping[str, tuple[float, float]]
    floating: frozenset[str] = frozenset()


def known(fit: Mapping[str, Any]) -> Known:
    """From the data of a ``fit.json``. Raises ValueError naming a missing entry."""
    try:
        rows, held = fit["parameters"], dict(fit["held"])
        symbols = tuple(str(row["symbol"]) for row in rows)
        best = np.array([float(row["value"]) for row in rows])
        draws = np.array(fit["posterior"]["draws"]) if "posterior" in fit else np.empty((0, len(rows)))
        widest = np.array([(row["bounds"][1] - row["bounds"][0]) ** 2 / 12.0 for row in rows])
        if len(draws):
            covariance = np.atleast_2d(np.cov(draws.T))
            chosen = draws[np.linspace(0, len(draws) - 1, DRAWS).astype(int)]
        else:
            covariance, chosen = _plain(fit["covariance"], widest), draws
        noise: dict[str, tuple[float, float]] = {}
        floating: set[str] = set()
        for recording in fit["recordings"]:
            rate = 1.0 / float(np.median(np.diff(np.array(recording["time"], dtype=float))))
            for name, channel in recording["channels"].items():
                own = (float(channel["noise"]), rate / float(channel["persistence"]))
                noise[name] = max(noise.get(name, own), own)
                if channel.get("zero") is not None:
                    floating.add(name)
    except (KeyError, TypeError, IndexError) as error:
        raise ValueError(f"not the data of a fit (fit.json): {error!r} is missing or of another kind") from None
    return Known(symbols, np.vstack([best, chosen]), covariance, held, noise, frozenset(floating))


def _plain(data: Any, widest: Array) -> Array:
    """A covariance whose unknown rows (at a bound, or not felt) are as wide as the bounds allow."""
    matrix = np.array([[np.nan if x is None else x for x in row] for row in data], dtype=float)
    blind = ~np.isfinite(np.diag(matrix)) | (np.diag(matrix) > widest)
    matrix[blind], matrix[:, blind] = 0.0, 0.0
    matrix[blind, blind] = widest[blind]
    return np.asarray(np.nan_to_num(matrix), dtype=np.float64)


def plan(model: str | Model, before: Known, candidates: Sequence[Candidate], parameter: str) -> list[Gain]:
    """The candidates' gains for one parameter, best per minute first.

    A candidate's information is JᵀJ over its effective samples at the fit's noise; the expected variance is the mean
    over draws of (C⁻¹ + JᵀJ)⁻¹. Raises ValueError for a parameter that the fit did not free.
    """
    if parameter not in before.symbols:
        raise ValueError(f"{parameter!r} was not free in this fit; free were {', '.join(before.symbols)}")
    place = before.symbols.index(parameter)
    scale = np.sqrt(np.diag(before.covariance))
    now = np.linalg.pinv(before.covariance / np.outer(scale, scale), rcond=1e-10)
    found = [_gain(model, before, candidate, place, scale, now) for candidate in candidates]
    return sorted(found, key=lambda gain: (bool(gain.trouble), -gain.per_minute))


def _gain(model: str | Model, before: Known, candidate: Candidate, place: int, scale: Array, now: Array) -> Gain:
    variances = []
    for values in before.values:
        parameters = dict(before.held) | dict(zip(before.symbols, values.tolist(), strict=True))
        result = simulate(model, candidate.experiment, parameters, before.symbols)
        if isinstance(result, str):
            return Gain(candidate.name, candidate.minutes, float(scale[place]), 0.0, result)
        assert result.sensitivities is not None
        information = np.zeros_like(now)
        for channel, slopes in result.sensitivities.items():
            if channel in before.noise:
                deviation, rate = before.noise[channel]
                share = np.gradient(candidate.experiment.time) * rate  # effective samples of each grid point
                rows = slopes * scale / deviation
                if channel in before.floating:
                    rows = rows - share @ rows / share.sum()
                information += rows.T @ (rows * share[:, None])
        variances.append(float(np.linalg.pinv(now + information, rcond=1e-12)[place, place]))
    after = float(np.sqrt(np.mean(variances)))
    return Gain(candidate.name, candidate.minutes, after * float(scale[place]), max(0.0, 1.0 - after))
