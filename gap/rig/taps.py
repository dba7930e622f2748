"""The taps that a rig's model calls: a nominal run notes ranges, a trial how motion is resisted, and in a run with
effects they act."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gap.rig.catalogue import GENERIC
from gap.rig.generic import GenericEffect
from gap.rig.generic_laws import State
from sim_devices.chain import FloatArray, Parameter

STEADY = 0.05
"""Share of its size that a signal's range counts as at least."""
BACK = 0.05
"""Share of its range by which a signal must come back to have turned; less is noise."""


@dataclass
class Way:
    """How far a signal went: its range, and most up and down again."""

    low: float = np.inf
    high: float = -np.inf
    up: float = 0.0
    down: float = 0.0

    def go(self, values: FloatArray) -> None:
        """Further ``values`` (m,); values that are no number say nothing."""
        values = values[np.isfinite(values)]
        if not len(values):
            return
        lowest = np.minimum.accumulate(np.r_[self.low, values])[1:]
        highest = np.maximum.accumulate(np.r_[self.high, values])[1:]
        self.low, self.high = float(lowest[-1]), float(highest[-1])
        self.up = max(self.up, float(np.max(values - lowest)))
        self.down = max(self.down, float(np.max(highest - values)))

    @property
    def turns(self) -> bool:
        """Whether it went up and down, and not only one way."""
        return self.high > self.low and min(self.up, self.down) > BACK * (self.high - self.low)


@dataclass
class Seen:
    """Statistics of a tap in a nominal run: the scale of its signal and of the related ones, how many values of it
    there are to a sample, and whether it takes ``whole`` series. ``opposes`` says that motion is resisted by an
    addition to the signal, not by a subtraction. ``ways`` has those of the signal (under ``""``) and of the related
    ones in each run."""

    low: float = np.inf
    high: float = -np.inf
    rate: float = 0.0
    related: dict[str, float] = field(default_factory=dict)
    values: int = 0
    calls: int = 1
    whole: bool = False
    opposes: bool = True
    ways: dict[str, list[Way]] = field(default_factory=dict)

    def turns(self, related: str = "") -> bool:
        """Whether the signal, or a related one, goes to and fro in some run."""
        return any(way.turns for way in self.ways.get(related, ()))


class Survey:
    """The tap of a nominal run: changes nothing, notes ranges."""

    def __init__(self) -> None:
        self.seen: dict[str, Seen] = {}
        self.time: FloatArray = np.zeros(0)
        self.work = 0  # calls of all taps in all runs

    def begin(self, time: FloatArray) -> None:
        """Another run, on ``time`` (n,) s."""
        for seen in self.seen.values():
            seen.values = 0
            for ways in seen.ways.values():
                ways.append(Way())
        self.time = time

    def __call__(self, name: str, values: Any, **related: Any) -> Any:
        self.work += 1
        seen = self.seen.setdefault(name, Seen())
        y = np.atleast_1d(np.asarray(values, dtype=float))
        seen.values += y.size
        seen.calls = max(seen.calls, round(seen.values / max(self.time.size, 1)))
        seen.low, seen.high = min(seen.low, float(np.nanmin(y))), max(seen.high, float(np.nanmax(y)))
        for key, going in {"": y, **related}.items():
            seen.ways.setdefault(key, [Way()])[-1].go(np.atleast_1d(np.asarray(going, dtype=float)))
        if y.size == self.time.size and y.size > 1:
            seen.whole = True
            seen.rate = max(seen.rate, float(np.nanmax(np.abs(np.diff(y) / np.diff(self.time)))))
        for key, other in related.items():
            seen.related[key] = max(seen.related.get(key, 0.0), float(np.nanmax(np.abs(other))))
        return values


class Drag:
    """The tap of a run with a little drag at ``name``: notes how much motion there is."""

    def __init__(self, name: str, coefficient: float) -> None:
        self.motion, self._name, self._coefficient = 0.0, name, coefficient

    def __call__(self, name: str, values: Any, **related: Any) -> Any:
        if name != self._name:
            return values
        velocity = related.get("velocity", 0.0)
        self.motion += float(np.sum(np.square(velocity)))
        return values + self._coefficient * velocity


class Acting:
    """The tap of a run with effects; keeps their states through one recording."""

    def __init__(
        self,
        at: Mapping[str, Sequence[tuple[GenericEffect, Mapping[str, float]]]],
        time: FloatArray,
        seen: Mapping[str, Seen],
    ) -> None:
        self._at: dict[str, list[tuple[GenericEffect, Mapping[str, float], State, bool]]] = {
            name: [(e, p, {}, e.resists and not seen[name].opposes) for e, p in effects] for name, effects in at.items()
        }
        self._time, self._stamps = time, time.tolist()
        self._calls = {name: seen[name].calls for name in at}
        self._used = dict.fromkeys(at, 0)
        self._single = {name: all(e in GENERIC for e, _ in effects) for name, effects in at.items()}

    def __call__(self, name: str, values: Any, **related: Any) -> Any:
        if name not in self._at:
            return values
        used = self._used[name]
        if isinstance(values, float) or np.ndim(values) == 0:
            self._used[name] = used + 1
            now = self._stamps[min(used // self._calls[name], len(self._stamps) - 1)]
            about = {k: float(v) for k, v in related.items()}
            if self._single[name]:  # floats are many times faster here than arrays of one
                return float(self._changed(name, now, float(values), about))
            return float(self._changed(name, np.array([now]), np.array([float(values)]), _arrays(about))[0])
        y = np.asarray(values, dtype=float)
        self._used[name] = used + y.size
        places = np.minimum((used + np.arange(y.size)) // self._calls[name], self._time.size - 1)
        return self._changed(name, self._time[places], y, _arrays(related))

    def _changed(self, name: str, time: Any, y: Any, about: Mapping[str, Any]) -> Any:
        for effect, p, state, from_net in self._at[name]:
            y = -effect.act(state, time, -y, about, p) if from_net else effect.act(state, time, y, about, p)
        return y


def _arrays(related: Mapping[str, Any]) -> dict[str, FloatArray]:
    return {k: np.atleast_1d(np.asarray(v, dtype=float)) for k, v in related.items()}


def scaled(
    parameter: Parameter, seen: Seen, measured: float, dt: float, duration: float, signal_unit: str
) -> Parameter:
    """The generic prior in the units of this rig; ``signal_unit`` is that of the tap's signal."""
    span = seen.high - seen.low
    # A signal that hardly moves, as the air about an oven, may yet drift by more than that.
    signal = max(span, STEADY * max(abs(seen.low), abs(seen.high))) or measured
    velocity = seen.related.get("velocity", 1.0) or 1.0
    position = seen.related.get("position", 1.0) or 1.0
    other = seen.related.get("other", 1.0) or 1.0
    scales = {
        "signal": signal, "velocity": velocity, "position": position, "dt": dt, "duration": duration,
        "signal/velocity": signal / velocity, "signal/velocity²": signal / velocity**2,
        "signal/position³": signal / position**3, "1/position": 1 / position, "1/signal": 1 / signal,
        "signal/duration": signal / duration, "signal/other": signal / other, "rate": seen.rate or signal / duration,
    }  # fmt: skip
    if parameter.unit == "size":
        size = max(abs(seen.low), abs(seen.high))
        low, high = parameter.low * size, parameter.high * size
        return replace(parameter, unit=signal_unit, low=low, high=high, default=size)
    if parameter.unit == "level":
        return replace(
            parameter,
            unit=signal_unit,
            low=seen.low + parameter.low * span,
            high=seen.low + parameter.high * span,
            default=seen.low + parameter.default * span,
        )
    k = scales.get(parameter.unit, 1.0)
    unit = {"dt": "s", "duration": "s", "signal": signal_unit, "rate": f"{signal_unit}/s"}.get(
        parameter.unit, parameter.unit
    )
    return replace(parameter, unit=unit, low=parameter.low * k, high=parameter.high * k, default=parameter.default * k)
