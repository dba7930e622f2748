"""The forward chain: stages of operators from set-point to processed measurement, and the effects that change it.

``timing -> command -> actuator -> interface -> tissue -> sensor -> processing``

A chain is a list of operators. Each reads some named signals and writes others, on a time grid that need not be
uniform, and keeps its state between calls: the simulated instruments advance it chunk by chunk in (scaled) real time,
the diagnosis runs whole sessions in one call; both get the same numbers. An operator can be left out by giving its
output (a recorded signal) instead: that is how a stage is fed with its recorded input.

An effect is data plus a function that returns a changed chain: with an operator more, or with other parameters.
"""

from __future__ import annotations

import abc
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Signals = dict[str, FloatArray]

STAGES = ("timing", "command", "actuator", "interface", "tissue", "sensor", "processing")


@dataclass(frozen=True)
class Operator(abc.ABC):
    """One causal step of the chain; subclasses are frozen dataclasses whose further fields are its parameters (SI)."""

    name: str
    stage: str

    @property
    @abc.abstractmethod
    def reads(self) -> tuple[str, ...]:
        """Names of the signals it needs."""

    @property
    @abc.abstractmethod
    def writes(self) -> tuple[str, ...]:
        """Names of the signals it makes (or changes: a name may be in both)."""

    @cached_property
    def wiring(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Signals that it reads and that it writes, put together once: a diagnosis asks very many times."""
        return self.reads, self.writes

    @abc.abstractmethod
    def fresh(self) -> Any:
        """A state at rest (all signals zero since ever)."""

    @abc.abstractmethod
    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        """Write the outputs for ``time`` (n,) s, strictly increasing, and move ``state`` to its end, in place.

        ``signals`` holds arrays of shape (n,); inputs are piecewise linear between samples. The state keeps the last
        time and input of the previous call, so that chunks join without a seam.
        """


@dataclass(frozen=True)
class Chain:
    """An ordered list of operators; a value, changed only by making another."""

    instrument: str
    operators: tuple[Operator, ...]

    def __getitem__(self, name: str) -> Operator:
        for op in self.operators:
            if op.name == name:
                return op
        raise KeyError(f"{self.instrument} chain has no operator {name!r}; it has {[o.name for o in self.operators]}")

    def tuned(self, name: str, **parameters: Any) -> Chain:
        """The chain with other parameters of one operator."""
        changed = replace(self[name], **parameters)
        return replace(self, operators=tuple(changed if o.name == name else o for o in self.operators))

    def inserted(self, operator: Operator, *, before: str = "", after: str = "") -> Chain:
        """The chain with one operator more, next to the named one."""
        anchor = self.operators.index(self[before or after]) + (1 if after else 0)
        ops = (*self.operators[:anchor], operator, *self.operators[anchor:])
        return replace(self, operators=ops)

    def without(self, name: str) -> Chain:
        """The chain with one operator less."""
        gone = self[name]
        return replace(self, operators=tuple(o for o in self.operators if o is not gone))

    def run(self, time: FloatArray, signals: Mapping[str, FloatArray]) -> Signals:
        """All signals on ``time`` (n,) s from rest, given the inputs.

        An operator all of whose outputs are given (and which does not read them) is left out.
        """
        return Runner(self, given=tuple(signals)).advance(time, signals)


class Runner:
    """A chain with its states, to be advanced chunk by chunk."""

    def __init__(self, chain: Chain, given: Sequence[str] = ()) -> None:
        self.chain = chain
        self._operators = _running(chain, set(given))
        self._states = [op.fresh() for op in self._operators]

    def advance(self, time: FloatArray, signals: Mapping[str, FloatArray]) -> Signals:
        """Signals on the next chunk ``time`` (n,) s, which begins after the end of the last one."""
        out: Signals = dict(signals)
        for op, state in zip(self._operators, self._states, strict=True):
            op.advance(state, time, out)
        return out

    def restart(self, name: str) -> None:
        """Put the named operator, if it is there, back to rest while the others go on (a sensor zeroed anew)."""
        for k, op in enumerate(self._operators):
            if op.name == name:
                self._states[k] = op.fresh()


def _running(chain: Chain, given: set[str]) -> list[Operator]:
    """The operators with something to do: not those whose outputs are given, nor those that only feed such ones."""
    running = [op for op in chain.operators if not (set(op.writes) <= given and not set(op.writes) & set(op.reads))]
    inner = {name for op in chain.operators for name in op.reads}  # a signal that nobody reads is a result
    while True:
        used = [op for op in running if _feeds(op, running) or not set(op.writes) <= inner]
        if len(used) == len(running):
            return running
        running = used


def _feeds(op: Operator, operators: Sequence[Operator]) -> bool:
    return any(set(op.writes) & set(other.reads) for other in operators if other is not op)


@dataclass(frozen=True)
class Parameter:
    """A number that an effect (or a tissue) has: unit, prior range and the value at which it does nothing.

    ``null`` is None for shape parameters, which change the form of an effect and not its strength.
    ``scale`` says how the prior is uniform: ``linear`` or ``log`` (then ``low`` > 0; ``null`` may be 0). ``only`` lists
    the numbers of the choice ``form`` in which the parameter means something; empty: in all. ``fine`` is the share of
    the prior's range over which its trace is nearly linear.
    """

    name: str
    unit: str
    low: float
    high: float
    null: float | None = 0.0
    default: float = 0.0
    scale: str = "linear"
    meaning: str = ""
    only: tuple[int, ...] = ()
    fine: float = 1e-3


@dataclass(frozen=True)
class Effect:
    """Something a real instrument or tissue does and the nominal chain does not.

    ``install(chain, values)`` returns the chain with the effect; ``values`` has every parameter. ``remedy`` says how
    to remove it in reality, ``source`` where it is known from. ``instruments`` are the chains it fits. An effect that
    hits samples by chance has a ``scatter``: the rms (s) by which a channel's true instants are off their stamps, given
    the instrument and the values (none: not by chance); a diagnosis then looks for the noise that it makes and not for
    the very draw. It is ``sparse`` if chance hits some samples and makes these older, else all are off a little. One
    whose readings walk at random has a ``wander``: by channel, SI, the rms after a second, given the values; one of a
    ``frequency`` that wanders has a ``rhythm``: by channel, SI, its rms.
    ``form`` is which of several laws it follows, where that is fixed; ``extends`` names effects that it becomes in a
    limit of its parameters.
    """

    name: str
    stage: str
    instruments: tuple[str, ...]
    meaning: str
    remedy: str
    source: str
    parameters: tuple[Parameter, ...]
    install: Callable[[Chain, Mapping[str, float]], Chain] = field(repr=False)
    scatter: Callable[[str, Mapping[str, float]], Mapping[str, float]] | None = field(default=None, repr=False)
    sparse: bool = False
    form: int = 0
    extends: tuple[str, ...] = ()
    wander: Callable[[Mapping[str, float]], Mapping[str, float]] | None = field(default=None, repr=False)
    rhythm: Callable[[Mapping[str, float]], Mapping[str, float]] | None = field(default=None, repr=False)

    @property
    def event(self) -> bool:
        """Whether it happens at one moment, which a repeat of the recording does not foretell."""
        return any(p.name == "moment" for p in self.parameters)

    @property
    def strengths(self) -> tuple[Parameter, ...]:
        """The parameters whose null value switches the effect off."""
        return tuple(p for p in self.parameters if p.null is not None)

    @property
    def of_chance(self) -> tuple[Parameter, ...]:
        """The parameters that say how strong chance is, and at which rate, and not which draw it was."""
        rate = ("frequency",) if self.rhythm else ()
        return tuple(p for p in self.parameters if p.null is not None or p.name in rate)

    def apply(self, chain: Chain, values: Mapping[str, float] | None = None) -> Chain:
        """The chain with this effect; parameters not given take their defaults.

        Raises ValueError for a parameter it does not have or a chain it does not fit.
        """
        if chain.instrument not in self.instruments:
            raise ValueError(f"effect {self.name} is for {', '.join(self.instruments)}, not for {chain.instrument}")
        given = dict(values or {})
        unknown = set(given) - {p.name for p in self.parameters}
        if unknown:
            known = ", ".join(p.name for p in self.parameters)
            raise ValueError(f"effect {self.name} has no parameter {sorted(unknown)}; it has {known}")
        return self.install(chain, {p.name: given.get(p.name, p.default) for p in self.parameters})
