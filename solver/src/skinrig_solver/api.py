"""Interface of every forward model of the plugin: the types that pass between models, fits and the application.

SI throughout (pascal gauge with suction negative, metre, second, newton). Arrays are float64; ``n`` is the number of
samples of an experiment's time grid and ``m`` the number of parameters a sensitivity was asked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Problem = Literal["suction", "sheet", "finger"]
Instrument = Literal["cutometer", "aspiration", "microrobot"]


class SolverError(RuntimeError):
    """The equations could not be solved: says at what time, under what load and in which element it stopped.

    Attributes
    ----------
    time : float
        Experiment time [s] of the last attempted step; nan where there is none.
    load : Mapping[str, float]
        Drive values (SI) of that step, by drive name.
    element : int or None
        Element with the largest residual or with an inverted or non-finite deformation.
    """

    def __init__(
        self,
        message: str,
        *,
        time: float = float("nan"),
        load: Mapping[str, float] | None = None,
        element: int | None = None,
    ) -> None:
        self.reason = message
        self.time = time
        self.load = dict(load or {})
        self.element = element
        where = [f"at t = {time:.6g} s"] if np.isfinite(time) else []
        where += [f"{name} = {value:.6g}" for name, value in self.load.items()]
        where += [f"element {element}"] if element is not None else []
        super().__init__(f"{message} ({', '.join(where)})" if where else message)

    def __reduce__(self) -> tuple[Any, ...]:  # keyword-only arguments survive the trip back from a worker process
        return _rebuild_error, (self.reason, self.time, self.load, self.element)


def _rebuild_error(reason: str, time: float, load: dict[str, float], element: int | None) -> SolverError:
    return SolverError(reason, time=time, load=load, element=element)


@dataclass(frozen=True)
class Parameter:
    """One model parameter: ``lower <= default <= upper`` in SI; ``unit`` is '' for pure numbers.

    ``source`` names where the default comes from: a paper (F, M, W) or 'assumed'. ``scale`` is 'log' where a fit
    should step in the logarithm (positive quantities spread over decades). ``fit_lower`` is where a fit stops unless
    its specification gives a lower bound of its own: below it the model runs, but its material may be unstable.
    """

    symbol: str
    unit: str
    lower: float
    upper: float
    default: float
    meaning: str
    source: str
    scale: Literal["linear", "log"] = "linear"
    fit_lower: float | None = None

    def __post_init__(self) -> None:
        if not self.lower <= self.default <= self.upper:
            raise ValueError(f"parameter {self.symbol}: default {self.default} outside [{self.lower}, {self.upper}]")
        if self.scale == "log" and self.lower <= 0:
            raise ValueError(f"parameter {self.symbol}: a log scale needs a positive lower bound, got {self.lower}")


@dataclass(frozen=True)
class ModelInfo:
    """Description of a model: its parameters and channels."""

    name: str
    problem: Problem
    parameters: tuple[Parameter, ...]
    channels: tuple[str, ...]
    description: str
    source: str

    @property
    def symbols(self) -> tuple[str, ...]:
        return tuple(p.symbol for p in self.parameters)

    @property
    def defaults(self) -> dict[str, float]:
        return {p.symbol: p.default for p in self.parameters}

    def __getitem__(self, symbol: str) -> Parameter:
        for parameter in self.parameters:
            if parameter.symbol == symbol:
                return parameter
        raise KeyError(f"model {self.name} has no parameter {symbol!r}; it has {', '.join(self.symbols)}")

    def complete(self, parameters: Mapping[str, float]) -> dict[str, float]:
        """All parameters in the model's order: the given values over the defaults.

        Raises ``ValueError`` naming a symbol that is unknown, not finite, or outside its bounds.
        """
        values = self.defaults
        for symbol, value in parameters.items():
            if symbol not in values:
                raise ValueError(f"model {self.name} has no parameter {symbol!r}; it has {', '.join(self.symbols)}")
            parameter, number = self[symbol], float(value)
            if not np.isfinite(number) or not parameter.lower <= number <= parameter.upper:
                raise ValueError(
                    f"model {self.name}, parameter {symbol}: {number} outside [{parameter.lower}, {parameter.upper}]"
                )
            values[symbol] = number
        return values


@dataclass(frozen=True)
class Experiment:
    """An instrument's experiment: its drive on a time grid, and the geometry that was not identified.

    Parameters
    ----------
    instrument : 'cutometer', 'aspiration' or 'microrobot'
    time : (n,) strictly increasing [s]
    drive : name -> (n,) in SI: ``pressure`` (Pa gauge, suction negative) or ``probe_x|y|z`` (m)
    geometry : options of the problem (opening radius, layer thicknesses, rim fillet, hole radius, pre-stress mode, …);
        each problem documents its own and refuses names it does not know
    label : shown in reports and error messages
    snapshots : times [s] at which fields are wanted with stress, stretch and history. Without any, a model gives the
        deformed mesh only, at times of its own choice
    """

    instrument: Instrument
    time: Array
    drive: Mapping[str, Array]
    geometry: Mapping[str, Any] = field(default_factory=dict)
    label: str = ""
    snapshots: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        time = np.ascontiguousarray(self.time, dtype=np.float64)
        who = f"experiment {self.label or self.instrument!r}"
        if time.ndim != 1 or time.size < 2:
            raise ValueError(f"{who}: time must be one-dimensional with at least two samples, has shape {time.shape}")
        if not np.all(np.isfinite(time)) or not np.all(np.diff(time) > 0):
            raise ValueError(f"{who}: time must be finite and strictly increasing")
        drive: dict[str, Array] = {}
        for name, values in self.drive.items():
            array = np.ascontiguousarray(values, dtype=np.float64)
            if array.shape != time.shape:
                raise ValueError(f"{who}: drive {name!r} has shape {array.shape}, time has {time.shape}")
            if not np.all(np.isfinite(array)):
                raise ValueError(f"{who}: drive {name!r} is not finite at sample {int(np.argmin(np.isfinite(array)))}")
            drive[name] = array
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "drive", drive)
        for moment in self.snapshots:
            if not time[0] <= moment <= time[-1]:
                raise ValueError(f"{who}: snapshot at {moment} s lies outside {time[0]:.6g} to {time[-1]:.6g} s")
        object.__setattr__(self, "geometry", dict(self.geometry))


@dataclass(frozen=True)
class Field:
    """A mesh with its deformed position at one time, and what else is known at its nodes.

    ``nodes`` (k, 2 or 3) reference positions [m]; ``displacement`` same shape [m]; ``cells`` (e, 9) nodes of
    biquadratic quadrilaterals in VTK's order (four corners, four mid-sides, centre); ``layer`` (e,) index into
    ``layer_names``; ``time`` [s]. ``values`` maps a name to a scalar (k,) or a symmetric tensor (k, 6: xx, yy, zz, xy,
    yz, xz) at the nodes, SI; in an axisymmetric body x is the radius, y the axis and z the hoop direction. Layers share
    no nodes, so that values may jump between them.
    """

    nodes: Array
    displacement: Array
    cells: NDArray[np.int64]
    layer: NDArray[np.int64]
    layer_names: tuple[str, ...]
    time: float
    values: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class Cost:
    """Counts of a run: forward runs, wall seconds (perf_counter), Newton iterations, accepted steps, cuts, unknowns."""

    forward_runs: int = 1
    seconds: float = 0.0
    newton_steps: int = 0
    time_steps: int = 0
    cuts: int = 0
    dofs: int = 0


@dataclass(frozen=True)
class Result:
    """Channels on the experiment's own time grid, and their derivatives.

    ``channels[name]`` is (n,) in SI; ``sensitivities[name]`` is (n, m), column j the derivative with respect to
    ``parameters[j]`` (channel unit / parameter unit), or ``sensitivities`` is None where none were asked for.
    ``warnings`` say in words where a result is a number, but hardly one of living tissue.
    """

    time: Array
    channels: dict[str, Array]
    parameters: tuple[str, ...] = ()
    sensitivities: dict[str, Array] | None = None
    cost: Cost = Cost()
    fields: tuple[Field, ...] = ()
    notes: dict[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


@runtime_checkable
class Model(Protocol):
    """A forward model. Stateless from the outside: equal arguments give equal results."""

    @property
    def info(self) -> ModelInfo: ...

    def simulate(
        self, experiment: Experiment, parameters: Mapping[str, float], sensitivities: Sequence[str] = ()
    ) -> Result:
        """Run the experiment. Missing parameters take their defaults.

        Raises ``ValueError`` for a wrong drive, geometry option or parameter value (named), ``KeyError`` for an unknown
        sensitivity, ``SolverError`` where the equations could not be solved.
        """
        ...
