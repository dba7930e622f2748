"""Parts of a term: one function each of a stage's own signals, without a unit and about 1 in size."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sim_devices.chain import FloatArray
from sim_devices.stages.kernels import STATE, low_pass

OWN, INPUT, ERROR, START = "own", "input", "error", "start"
"""Roles of signals at a place: its stage's output, its input, by how much the second is ahead; and a part that dies out
from the start of the clock on, which is the session's on our instruments and the recording's on a rig."""
SIGN_WIDTH = 0.02
"""Of a signal's scale: over which its sign goes from −1 to 1."""
FUNCTIONS: Mapping[str, Callable[[FloatArray], FloatArray]] = {
    "x": lambda v: v,
    "|x|": np.abs,
    "x|x|": lambda v: v * np.abs(v),
    "x^2": np.square,
    "x^3": lambda v: v * v * v,
    "sgn x": lambda v: np.tanh(v / SIGN_WIDTH),
}
Memory = dict[str, Any]
Show = Callable[[float, str], str]
"""A number of a unit as text."""


@dataclass(frozen=True)
class Place:
    """Where a term can act: at an operator of an instrument's chain, or a tap of a rig's model, called ``anchor``.

    ``own`` are the signals that are corrected (of ``unit``), each by itself, ``inputs`` those that the stage is fed
    with, in the same order; ``names`` and ``units`` are those of the roles, for people; ``size`` (SI) is how large a
    correction may be, ``blocks`` where it shows, and ``highest`` where the corrected signal ends: a vented probe is at
    ambient pressure.
    """

    anchor: str
    stage: str
    unit: str
    size: float
    own: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    names: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    blocks: tuple[str, ...] = ()
    highest: float = np.inf
    rig: bool = False


@dataclass(frozen=True)
class Part:
    """``function`` of a signal over its ``scale`` (SI): the one whose role is ``of``, or its rate of change (then the
    scale is of that, per s); times the signal ``times`` over ``times_scale``, if one is named; and seen through a
    first-order lag of ``tau`` s, if that is not 0; if it is ``fading``, the part this lag has not followed yet. With
    ``times`` = `START`, ``tau`` is the time in which it dies out from the start."""

    of: str
    function: str = "x"
    scale: float = 1.0
    rate: bool = False
    tau: float = 0.0
    times: str = ""
    times_scale: float = 1.0
    fading: bool = False

    def value(self, memory: Memory, time: FloatArray, signals: Mapping[str, FloatArray], tau: float) -> FloatArray:
        """The part at ``time`` (n,) s, (n,); ``memory`` goes on from call to call, empty at first."""
        x = signals[self.of]
        f = FUNCTIONS[self.function]((_rate(memory, time, x) if self.rate else x) / self.scale)
        if self.times == START:
            return np.asarray(f * np.exp(-np.maximum(time, 0.0) / tau))
        if self.times:
            f = f * signals[self.times] / self.times_scale
        if not tau:
            return f
        late = _lagged(memory, time, f, tau)
        return f - late if self.fading else late

    def text(self, place: Place, show: Show) -> str:
        """The part as people write it, numbers by ``show``."""
        name, unit = place.names[self.of], place.units.get(self.of) or "1"
        x = f"(d{name}/dt / {show(self.scale, f'{unit}/s')})" if self.rate else f"({name} / {show(self.scale, unit)})"
        said = {"x": x, "|x|": f"|{x[1:-1]}|", "x|x|": f"{x}·|{x[1:-1]}|", "x^2": f"{x}²", "x^3": f"{x}³"}
        out = said.get(self.function, f"sgn{x}")
        if self.times == START:
            return f"[{out}], dying out within {show(self.tau, 's')} of the start"
        if self.times:
            out += f"·({place.names[self.times]} / {show(self.times_scale, place.units.get(self.times) or '1')})"
        if not self.tau:
            return out
        return f"[{out}], {'fading within' if self.fading else 'late by'} {show(self.tau, 's')}"


def in_si(value: float, unit: str) -> str:
    """A number to three digits with its unit, if it has one."""
    return f"{float(f'{value:.3g}'):g} {'' if unit == '1' else unit}".rstrip()


def _rate(memory: Memory, time: FloatArray, x: FloatArray) -> FloatArray:
    """Rate of change since the sample before; of the first the next one's, or 0."""
    if not len(x):
        return np.zeros(0)
    last_time, last = memory.get("last", (np.nan, np.nan))
    step = np.diff(time, prepend=last_time)
    rate = np.divide(np.diff(x, prepend=last), step, out=np.zeros(len(x)), where=step > 0)
    # A call within one instant goes on as before.
    rate = np.where(step > 0, rate, memory.get("rate", rate[1] if len(rate) > 1 and not step[0] > 0 else 0.0))
    memory["last"], memory["rate"] = (time[-1], x[-1]), rate[-1]
    return rate


def _lagged(memory: Memory, time: FloatArray, f: FloatArray, tau: float) -> FloatArray:
    """First-order lag that begins at the first value."""
    first = memory.setdefault("first", f[0])
    state = memory.setdefault("lag", np.zeros(STATE))
    out = np.empty(len(f))
    low_pass(state, np.ascontiguousarray(time), np.ascontiguousarray(f - first), np.array([tau]), out)
    return np.asarray(first + out)
