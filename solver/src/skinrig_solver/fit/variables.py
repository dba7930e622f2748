"""The unknowns of a fit: free parameters in the coordinate they are stepped in, ties, and what is held."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..api import Array, ModelInfo, Parameter
from .priors import Prior


@dataclass(frozen=True)
class Free:
    """A parameter to identify: ``lower < upper`` and ``start`` between them, in SI; ``log`` steps in its logarithm.

    ``prior`` counts in posteriors only; without one every coordinate between the bounds is alike.
    """

    symbol: str
    start: float
    lower: float
    upper: float
    log: bool
    prior: Prior | None = None

    def __post_init__(self) -> None:
        if not self.lower < self.upper:
            raise ValueError(f"{self.symbol}: lower bound {self.lower} is not below the upper one, {self.upper}")
        if not self.lower <= self.start <= self.upper:
            raise ValueError(f"{self.symbol}: start {self.start} is outside [{self.lower}, {self.upper}]")
        if self.log and not self.lower > 0.0:
            raise ValueError(f"{self.symbol}: a log scale needs a positive lower bound, got {self.lower}")
        if self.prior is not None and not self.prior.mass(self.lower, self.upper) > 0.0:
            raise ValueError(f"{self.symbol}: its prior has no probability between {self.lower} and {self.upper}")

    @classmethod
    def of(
        cls,
        parameter: Parameter,
        start: float | None = None,
        lower: float | None = None,
        upper: float | None = None,
        log: bool | None = None,
        prior: Prior | None = None,
    ) -> Free:
        """The model's own default and bounds of a fit where nothing is given."""
        stable = parameter.lower if parameter.fit_lower is None else parameter.fit_lower
        lower = stable if lower is None else lower
        upper = parameter.upper if upper is None else upper
        start = min(max(parameter.default, lower), upper) if start is None else start
        free = cls(parameter.symbol, start, lower, upper, parameter.scale == "log" if log is None else log, prior)
        return free.within(parameter)

    def within(self, parameter: Parameter) -> Free:
        """Itself; raises ValueError where its bounds leave the model's."""
        if self.lower < parameter.lower or self.upper > parameter.upper:
            allowed = f"[{parameter.lower}, {parameter.upper}]"
            raise ValueError(f"{self.symbol}: bounds [{self.lower}, {self.upper}] leave the model's, {allowed}")
        return self

    @property
    def unit(self) -> float:
        """Size of one step of the coordinate of a linear parameter."""
        return max(abs(self.start), 1e-3 * (self.upper - self.lower))

    def coordinate(self, value: float) -> float:
        """The optimiser's coordinate of a value: its logarithm, or the value in `unit`s."""
        return float(np.log(value)) if self.log else value / self.unit

    def value(self, z: float) -> float:
        """The value at a coordinate, never beyond the bounds by rounding."""
        return float(np.clip(np.exp(z) if self.log else z * self.unit, self.lower, self.upper))

    def slope(self, value: float) -> float:
        """d(value)/d(coordinate)."""
        return value if self.log else self.unit


@dataclass(frozen=True)
class Tied:
    """A parameter that is always ``factor`` times a free one."""

    symbol: str
    tied: str
    factor: float = 1.0


@dataclass(frozen=True)
class Variables:
    """Free and tied parameters of one model over the held ``values`` (all symbols, SI)."""

    info: ModelInfo
    free: tuple[Free, ...]
    tied: tuple[Tied, ...]
    held: Mapping[str, float]

    def __post_init__(self) -> None:
        names = [f.symbol for f in self.free]
        for tie in self.tied:
            if tie.tied not in names:
                raise ValueError(f"{tie.symbol} is tied to {tie.tied!r}, which is not free")
        if not self.free:
            raise ValueError("no parameter is free")

    @property
    def symbols(self) -> tuple[str, ...]:
        return tuple(f.symbol for f in self.free)

    @property
    def start(self) -> Array:
        """Coordinates (m,) of the starting values."""
        return np.array([f.coordinate(f.start) for f in self.free])

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Coordinates (m,), (m,) of the bounds."""
        return (
            np.array([f.coordinate(f.lower) for f in self.free]),
            np.array([f.coordinate(f.upper) for f in self.free]),
        )

    def values(self, z: Array) -> dict[str, float]:
        """All parameters of the model at coordinates (m,)."""
        result = dict(self.held)
        for free, x in zip(self.free, z, strict=True):
            result[free.symbol] = free.value(float(x))
        for tie in self.tied:
            result[tie.symbol] = tie.factor * result[tie.tied]
        return result

    @property
    def wanted(self) -> tuple[str, ...]:
        """Symbols a model must differentiate by: the free and the tied."""
        return (*self.symbols, *(tie.symbol for tie in self.tied))

    def chain(self, values: Mapping[str, float]) -> Array:
        """(len(wanted), m): derivatives of the wanted parameters by the coordinates, at ``values``."""
        matrix = np.zeros((len(self.wanted), len(self.free)))
        for k, free in enumerate(self.free):
            matrix[k, k] = free.slope(values[free.symbol])
        for j, tie in enumerate(self.tied):
            matrix[len(self.free) + j] = tie.factor * matrix[self.symbols.index(tie.tied)]
        return matrix

    def only(self, moving: tuple[str, ...], values: Mapping[str, float]) -> Variables:
        """Those of ``moving`` free, starting from ``values``; the others held there, ties to them included."""
        held = dict(self.held) | {s: values[s] for s in self.wanted}
        free = tuple(replace(f, start=values[f.symbol]) for f in self.free if f.symbol in moving)
        return Variables(self.info, free, tuple(t for t in self.tied if t.tied in moving), held)
