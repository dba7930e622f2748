"""Prior of a parameter: a density over its values, cut at the fit's bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import stats

from ..api import Array
from . import units

if TYPE_CHECKING:
    from .variables import Free

KEYS: dict[str, tuple[str, str]] = {
    "normal": ("mean", "sd"),
    "lognormal": ("median", "factor"),
    "uniform": ("lower", "upper"),
}


@dataclass(frozen=True)
class Prior:
    """``kind`` 'normal' with mean ``a`` and standard deviation ``b``; 'lognormal' with median ``a``, 68 % within a
    factor ``b`` of it; 'uniform' from ``a`` to ``b``. SI. Raises ValueError for numbers that make no density."""

    kind: str
    a: float
    b: float

    def __post_init__(self) -> None:
        if self.kind not in KEYS:
            raise ValueError(f"prior {self.kind!r} is none of {', '.join(KEYS)}")
        first, second = KEYS[self.kind]
        if self.kind == "normal" and not self.b > 0.0:
            raise ValueError(f"{second} {self.b} must be positive")
        if self.kind == "lognormal" and not (self.a > 0.0 and self.b > 1.0):
            raise ValueError(f"{first} {self.a} must be positive and {second} {self.b} above 1")
        if self.kind == "uniform" and not self.a < self.b:
            raise ValueError(f"{first} {self.a} is not below {second} {self.b}")

    @property
    def _distribution(self) -> Any:
        if self.kind == "normal":
            return stats.norm(self.a, self.b)
        if self.kind == "lognormal":
            return stats.lognorm(np.log(self.b), scale=self.a)
        return stats.uniform(self.a, self.b - self.a)

    def mass(self, lower: float, upper: float) -> float:
        """Probability between two values."""
        return float(self._distribution.cdf(upper) - self._distribution.cdf(lower))

    def log_density(self, value: Array) -> Array:
        """Per SI unit, not cut; minus infinity where it is none."""
        if self.kind == "normal":
            return np.asarray(-0.5 * ((value - self.a) / self.b) ** 2 - np.log(self.b) - 0.5 * np.log(2 * np.pi))
        if self.kind == "uniform":
            return np.where((value >= self.a) & (value <= self.b), -np.log(self.b - self.a), -np.inf)
        width = np.log(self.b)
        with np.errstate(divide="ignore", invalid="ignore"):
            x = np.log(value)
            density = -0.5 * ((x - np.log(self.a)) / width) ** 2 - x - np.log(width) - 0.5 * np.log(2 * np.pi)
        return np.where(value > 0.0, density, -np.inf)

    def in_words(self, unit: str) -> str:
        """Such as 'normal, 20 kPa ± 5 kPa'."""
        first = units.show(self.a, unit)
        if self.kind == "normal":
            return f"normal, {first} ± {units.show(self.b, unit)}"
        if self.kind == "lognormal":
            return f"lognormal, {first} × or ÷ {self.b:.4g}"
        return f"uniform, {first} to {units.show(self.b, unit)}"


def read_prior(data: Any, unit: str, where: str) -> Prior:
    """A prior from plain data such as ``{normal: {mean: 20 kPa, sd: 5 kPa}}``. Raises ValueError naming ``where``."""
    if not isinstance(data, Mapping) or len(data) != 1 or next(iter(data)) not in KEYS:
        raise ValueError(f"{where}: a prior is one of {', '.join(KEYS)} with its numbers")
    kind, numbers = next(iter(data.items()))
    first, second = KEYS[kind]
    if not isinstance(numbers, Mapping) or set(numbers) != {first, second}:
        raise ValueError(f"{where}: {kind} needs {first} and {second}")
    a = units.read(numbers[first], unit, f"{where}.{first}")
    b = units.read(numbers[second], "" if kind == "lognormal" else unit, f"{where}.{second}")
    try:
        return Prior(kind, a, b)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def log_prior(free: Free, z: Array) -> Array:
    """Log density (b,) per unit of the coordinate, at coordinates (b,); minus infinity beyond the bounds.

    Without a prior all coordinates between the bounds are alike: values for a linear parameter, their logarithms for
    one that is stepped in its logarithm. Normalised, so that evidences compare.
    """
    low, high = free.coordinate(free.lower), free.coordinate(free.upper)
    inside = (z >= low) & (z <= high)
    if free.prior is None:
        return np.where(inside, -np.log(high - low), -np.inf)
    value = np.exp(z) if free.log else z * free.unit
    slope = z if free.log else np.full_like(z, np.log(free.unit))
    density = free.prior.log_density(value) + slope - _log_mass(free.prior, free.lower, free.upper)
    return np.where(inside, density, -np.inf)


@lru_cache(maxsize=256)
def _log_mass(prior: Prior, lower: float, upper: float) -> float:
    return float(np.log(prior.mass(lower, upper)))  # asked for at every draw: distributions are slow to make
