"""Operators of general use: wired to signals by name, they hold a law and its parameters."""

from __future__ import annotations

import abc
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sim_devices.chain import Chain, FloatArray, Operator, Signals
from sim_devices.stages.kernels import STATE, Kernel

Names = tuple[str, ...]
ROUNDING = 2e-10
"""s by which rounding may put a moment beside the one it is: less than a step of the command takes."""
RARE = 5e-3
"""s between looks from which each is a jump: steps of a command that is looked at more often, regulators and loops even
out."""


@dataclass(frozen=True)
class Wired(Operator):
    """An operator that says which signals it reads and writes, so that effects can re-route them."""

    source: Names
    target: Names

    @property
    def reads(self) -> Names:
        return self.source

    @property
    def writes(self) -> Names:
        return self.target

    def fresh(self) -> Any:
        return None


@dataclass(frozen=True)
class Pass(Wired):
    """Each source becomes its target, unchanged: the place where an effect can step in."""

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        for source, target in zip(self.source, self.target, strict=True):
            signals[target] = signals[source]


@dataclass(frozen=True)
class Map(Wired):
    """A law without memory: ``function(time, *inputs, *parameters)`` gives the target, or a tuple of the targets."""

    function: Callable[..., Any]
    parameters: tuple[float, ...] = ()

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        out = self.function(time, *[signals[s] for s in self.source], *self.parameters)
        if len(self.target) == 1:
            signals[self.target[0]] = out
        else:
            signals.update(zip(self.target, out, strict=True))


@dataclass(frozen=True)
class Law(Wired):
    """A compiled law with memory (``kernels``), the same for each pair of source and target.

    With ``add`` the law's output is added to its input, else it replaces it.
    """

    kernel: Kernel
    parameters: tuple[float, ...] = ()
    add: bool = False

    def fresh(self) -> Any:
        return np.zeros((len(self.source), STATE)), np.array(self.parameters, dtype=float)

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        memory, parameters = state
        for row, source, target in zip(memory, self.source, self.target, strict=True):
            u = signals[source]
            out = np.empty(len(time))
            self.kernel(row, time, u, parameters, out)
            signals[target] = out + u if self.add else out


@dataclass(frozen=True)
class Retimed(Wired):
    """Each target at t is its source at another moment, ``seen(t)``; zero before the first sample.

    Where that is ahead it reads as far as the samples of one call reach: a running instrument cannot, a simulation of
    a whole session can.
    """

    @property
    @abc.abstractmethod
    def moves(self) -> bool:
        """Whether anything is moved at all."""

    @abc.abstractmethod
    def seen(self, time: FloatArray) -> FloatArray:
        """The moments (n,) s of the source that the target shows at ``time`` (n,) s."""

    @abc.abstractmethod
    def shows(self, moments: FloatArray) -> FloatArray:
        """When the source's ``moments`` (n,) s appear in the target."""

    def jumps(self, begin: float, end: float) -> FloatArray:
        """Moments (k,) s between ``begin`` and ``end`` at which the target jumps though the source may not."""
        return np.zeros(0)

    def fresh(self) -> Any:
        return {"time": np.empty(0), **{source: np.empty(0) for source in self.source}}

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        if not self.moves:
            for source, target in zip(self.source, self.target, strict=True):
                signals[target] = signals[source]
            return
        past = np.concatenate([state["time"], time])
        at = self.seen(time)
        start = max(np.searchsorted(past, at[-1]) - 1, 0)  # later calls never need anything older
        for source, target in zip(self.source, self.target, strict=True):
            values = np.concatenate([state[source], signals[source]])
            signals[target] = np.interp(at, past, values, left=0.0)
            state[source] = values[start:]
        state["time"] = past[start:]


@dataclass(frozen=True)
class Delay(Retimed):
    """Dead time: each target at t is its source at t - delay - skew (t - t0).

    ``delay`` s; ``skew`` is the relative rate by which the reading clock runs fast against the writing one since they
    were aligned last, at the latest of ``marks`` (s; the start of time, if there is none).
    """

    delay: float = 0.0
    skew: float = 0.0
    marks: tuple[float, ...] = ()

    @property
    def moves(self) -> bool:
        return self.delay != 0.0 or self.skew != 0.0

    def seen(self, time: FloatArray) -> FloatArray:
        return time - self.delay - self.skew * (time - _latest(self.marks, time))

    def shows(self, moments: FloatArray) -> FloatArray:
        return moments + (self.delay + self.skew * (moments - _latest(self.marks, moments))) / (1.0 - self.skew)


def _latest(marks: tuple[float, ...], time: FloatArray) -> FloatArray:
    """The latest of ``marks`` (s), or 0, before each of ``time`` (n,) s."""
    since = np.array([0.0, *sorted(marks)])
    return since[np.maximum(np.searchsorted(since, time, side="right") - 1, 0)]


@dataclass(frozen=True)
class Gap(Retimed):
    """Samples of ``lost`` s are missing from ``moment`` on, and those behind them moved up until the next of ``marks``
    (s), when another recording begins: the value of a stamp was true ``lost`` s after it."""

    lost: float = 0.0
    moment: float = 0.0
    marks: tuple[float, ...] = ()

    @property
    def moves(self) -> bool:
        return self.lost != 0.0

    def _within(self, time: FloatArray) -> FloatArray:
        end = min((m for m in self.marks if m > self.moment), default=np.inf)
        return np.asarray((time >= self.moment) & (time < end))

    def seen(self, time: FloatArray) -> FloatArray:
        return time + self.lost * self._within(time)

    def shows(self, moments: FloatArray) -> FloatArray:
        return moments - self.lost * self._within(moments - self.lost)


@dataclass(frozen=True)
class Polled(Retimed):
    """The source is looked at every ``period`` s only, and held in between.

    The first look is at ``phase`` (0 to 1 of it) after the latest of ``marks`` (s; the start of time, if there is
    none).
    """

    period: float = 0.0
    phase: float = 0.0
    marks: tuple[float, ...] = ()

    @property
    def moves(self) -> bool:
        return self.period > 0.0

    def seen(self, time: FloatArray) -> FloatArray:
        since = _latest(self.marks, time)
        return since + self.period * (np.floor((time - since + ROUNDING) / self.period - self.phase) + self.phase)

    def shows(self, moments: FloatArray) -> FloatArray:
        since = _latest(self.marks, moments)
        return since + self.period * (np.ceil((moments - since - ROUNDING) / self.period - self.phase) + self.phase)

    def jumps(self, begin: float, end: float) -> FloatArray:
        if self.period < RARE:
            return np.zeros(0)
        return np.unique(self.shows(np.arange(begin, end, self.period)))


@dataclass(frozen=True)
class Wandering(Retimed):
    """A clock that goes to and fro: the source ``amplitude`` sin(2 π (t / period - phase)) s ago."""

    amplitude: float = 0.0
    period: float = 1.0
    phase: float = 0.0

    @property
    def moves(self) -> bool:
        return self.amplitude != 0.0

    def _off(self, time: FloatArray) -> FloatArray:
        return np.asarray(self.amplitude * np.sin(2 * np.pi * (time / self.period - self.phase)))

    def seen(self, time: FloatArray) -> FloatArray:
        return time - self._off(time)

    def shows(self, moments: FloatArray) -> FloatArray:
        shown = moments
        for _ in range(8):  # to far within a `JUMP`: each step gains a factor of the greatest rate, which is small
            shown = moments + self._off(shown)
        return shown


@dataclass(frozen=True)
class Warming(Retimed):
    """A clock whose crystal warms up: it runs fast by ``cold`` at first, by ``warm`` in the end, and comes from one to
    the other within ``tau`` s; it is aligned at each of ``marks`` (s)."""

    cold: float = 0.0
    warm: float = 0.0
    tau: float = 1.0
    marks: tuple[float, ...] = ()

    @property
    def moves(self) -> bool:
        return self.cold != 0.0 or self.warm != 0.0

    def _off(self, time: FloatArray, aligned: FloatArray) -> FloatArray:
        """The integral of the rate since it was ``aligned`` (n,) s."""
        gone = np.exp(-aligned / self.tau) - np.exp(-time / self.tau)
        return np.asarray(self.warm * (time - aligned) + (self.cold - self.warm) * self.tau * gone)

    def seen(self, time: FloatArray) -> FloatArray:
        return time - self._off(time, _latest(self.marks, time))

    def shows(self, moments: FloatArray) -> FloatArray:
        shown, aligned = moments, _latest(self.marks, moments)
        for _ in range(4):  # each step gains a factor of the rate
            shown = moments + self._off(shown, aligned)
        return shown


@dataclass(frozen=True)
class Noise(Wired):
    """White Gaussian noise of ``sigma`` on each channel, then rounding to ``resolution``; neither where it is 0."""

    sigma: float = 0.0
    resolution: float = 0.0
    seed: int = 0

    def fresh(self) -> Any:
        return [np.random.default_rng([self.seed, i]) for i in range(len(self.source))] if self.sigma else None

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        for i, (source, target) in enumerate(zip(self.source, self.target, strict=True)):
            out = signals[source]
            if self.sigma:
                out = out + self.sigma * state[i].standard_normal(len(time))
            signals[target] = np.round(out / self.resolution) * self.resolution if self.resolution else out


def analog(*signals: str) -> Names:
    """The names of channels before noise and converter."""
    return tuple(f"{s}|analog" for s in signals)


def after(chain: Chain, anchor: str, make: Callable[[Names, Names], Wired], *signals: str) -> Chain:
    """The chain with one operator more behind ``anchor``, on the named outputs of it (all, if none is named).

    ``make(source, target)`` returns the operator. The anchor's outputs get working names and the new operator writes
    what the anchor wrote: nothing works in place, so that a recorded signal can replace the whole group.
    Signals go by the name the anchor had for them before any effect: ``pressure`` also when it now writes
    ``pressure|leak``.
    """
    op = _wired(chain, anchor)
    chosen = [i for i, t in enumerate(op.target) if not signals or t.split("|")[0] in signals]
    if not chosen:
        raise KeyError(f"operator {anchor!r} of the {chain.instrument} chain does not write {signals}")
    public = tuple(op.target[i] for i in chosen)
    added = _unique(chain, make(public, public))
    raw = tuple(f"{t}|{added.name}" for t in public)
    target = tuple(raw[chosen.index(i)] if i in chosen else t for i, t in enumerate(op.target))
    rename = dict(zip(public, raw, strict=True))
    added = replace(added, source=tuple(rename.get(s, s) for s in added.source))
    return _in_place_of(chain, op, replace(op, target=target), added)


def before(chain: Chain, anchor: str, make: Callable[[Names, Names], Wired], *signals: str) -> Chain:
    """The chain with one operator more ahead of ``anchor``, on the named inputs of it (all, if none is named).

    ``make(source, target)`` returns the operator; only the anchor sees its output.
    """
    op = _wired(chain, anchor)
    public = tuple(s for s in op.source if not signals or s.split("|")[0] in signals)
    if not public:
        raise KeyError(f"operator {anchor!r} of the {chain.instrument} chain does not read {signals}")
    added = _unique(chain, make(public, public))
    rename = {s: f"{s}|{added.name}" for s in public}
    added = replace(added, target=tuple(rename.get(t, t) for t in added.target))
    source = tuple(rename.get(s, s) for s in op.source)
    return _in_place_of(chain, op, added, replace(op, source=source))


def last_writer(chain: Chain, signal: str) -> str:
    """Name of the operator that writes ``signal`` last. Raises KeyError if none does."""
    for op in reversed(chain.operators):
        if signal in op.writes:
            return op.name
    raise KeyError(f"no operator of the {chain.instrument} chain writes {signal!r}")


def _unique(chain: Chain, operator: Wired) -> Wired:
    """The operator under a name that the chain does not have yet."""
    names = {op.name for op in chain.operators}
    if operator.name not in names:
        return operator
    number = next(i for i in range(2, len(names) + 2) if f"{operator.name}#{i}" not in names)
    return replace(operator, name=f"{operator.name}#{number}")


def _wired(chain: Chain, name: str) -> Wired:
    op = chain[name]
    if not isinstance(op, Wired):
        raise TypeError(f"operator {name!r} of the {chain.instrument} chain cannot be re-wired")
    return op


def _in_place_of(chain: Chain, gone: Operator, *operators: Operator) -> Chain:
    at = next(k for k, op in enumerate(chain.operators) if op is gone)
    return Chain(chain.instrument, (*chain.operators[:at], *operators, *chain.operators[at + 1 :]))
