"""Laws that a person's skin may follow under suction, in a few parameters each.

A law is how skin creeps (two times, four, or a power law of time) and its nonlinear part: a memory of stress
in front of the elastic curve (Fung 1981) and not of height behind it, creep that runs the faster the further it has to
go (Eyring 1936), creep that load slows or quickens (Schapery 1969), flow beyond a yield load (Bingham), or a stiffening
sheet in parallel with a viscous arm, which is no elastic curve with a memory at all.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from gap.inference.hypothesis import FROZEN
from sim_devices.chain import Chain, FloatArray, Signals
from sim_devices.stages.kernels import evaluate, hold_weights, yield_flow
from sim_devices.stages.operators import Wired, after, before

FULL = 1.0 - 1e-13
"""Greatest tanh of half an activated dashpot's lag, whose inverse is still known: a lag of 30 units of its flow."""
SHORT, SMALL = 1.0, 0.09
"""Squares up to which the continued fractions of tanh and artanh are within 3e-8 of them."""
DASHPOT = 5e-3
"""s: relaxation time of the spring in series with which a dashpot is stepped."""


class Part(NamedTuple):
    """A parameter of skin: its prior's width before the person's skin was fitted alone and after, where it begins, and
    the amount without which it means nothing (itself, of an amount)."""

    sd: float
    warm_start: float
    begin: float = 0.0
    of: str = ""


PARTS: Mapping[str, Part] = {
    "compliance": Part(1.5, 0.5),  # logarithm, at the strongest suction
    "knee": Part(1.0, 0.15),  # logarithm
    "exponent": Part(0.4, 0.08),
    **{f"creep{k + 1}": Part(0.15, 0.15, g, f"creep{k + 1}") for k, g in enumerate((0.15, 0.15, 0.2, 0.2))},
    **{f"time{k + 1}": Part(0.7, 0.3, 0.0, f"creep{k + 1}") for k in range(4)},  # logarithms
    "residual": Part(0.1, 0.06, 0.12, "residual"),  # share of the height
    "softening": Part(0.04, 0.03),
    "power": Part(0.3, 0.3, 0.25, "power"),
    "fraction": Part(0.7, 0.3, 0.0, "power"),  # logarithm
    "activation": Part(4.0, 1.0, 2.0, "activation"),  # of elastic heights at the strongest suction
    "slowing": Part(1.5, 0.5, 0.3, "slowing"),  # of the strongest suction, in logarithms of the times
    "flow": Part(0.3, 0.15, 0.2, "flow"),  # share of the elastic height at the strongest suction
    "yield": Part(0.3, 0.15, 0.1, "flow"),  # share of the strongest suction
    "rise": Part(1.5, 0.4, 0.0, "flow"),  # logarithm
    "fall": Part(1.0, 0.4, 0.0, "flow"),  # logarithm
    "fung": Part(FROZEN, FROZEN, 1.0, "fung"),  # 1: the memory is of stress, in front of the elastic curve
    "sheet": Part(FROZEN, FROZEN, 1.0, "sheet"),  # 1: skin is a sheet with an arm
    "slack": Part(1.5, 0.3, 0.5, "sheet"),  # log odds of stiffening against tension at the strongest suction
    "bend": Part(0.7, 0.2, 0.0, "sheet"),  # logarithm
    "viscosity": Part(1.5, 0.4, 0.0, "sheet"),  # logarithm
    "arm": Part(1.0, 0.3, 0.0, "sheet"),  # logarithm
    "arm_time": Part(1.0, 0.3, 0.0, "sheet"),  # logarithm
}
CREEP = ("creep1", "creep2", "creep3", "creep4", "power")
"""Amounts of a linear memory."""
RISE, FALL = 1.0, 100.0
"""Times of flow and of its recovery from which fits begin, s."""
VISCOSITY, ARM, ARM_TIME = 0.06, 0.17, 7.0
"""Of a sheet's dashpot (s) and arm (share, s), from which fits begin."""
TIMES = ("time1", "time2", "time3", "time4")
"""Creep times, which have local optima."""


@dataclass(frozen=True)
class SkinLaw:
    """``amounts`` of which a law has some; all others are nothing. A ``simple`` one must do with an elastic curve of
    three parameters and a channel that neither holds nor integrates."""

    amounts: tuple[str, ...]
    simple: bool = True

    def frees(self, part: Part) -> bool:
        """Whether a parameter means something under this law."""
        return not part.of or part.of in self.amounts

    @property
    def nonlinear(self) -> tuple[str, ...]:
        """Its parameters other than linear creep."""
        return tuple(a for a in self.amounts if a not in (*CREEP, "residual"))

    @property
    def timed(self) -> bool:
        """Whether it has creep times, which have local optima."""
        return any(PARTS[time].of in self.amounts for time in TIMES)

    def beside(self, others: Sequence[str]) -> SkinLaw:
        """The law with more amounts."""
        return replace(self, amounts=tuple(dict.fromkeys((*self.amounts, *others))))


TWO_TIMES = ("creep2", "creep3")
BASIC = (SkinLaw((*TWO_TIMES, "residual")), SkinLaw(("power", "residual")))
"""Simple laws of an elastic curve and a linear memory."""
USUAL = SkinLaw(("creep1", "creep2", "creep3", "creep4", "residual"), simple=False)
"""A person's skin at large."""
FURTHER = (
    SkinLaw((*TWO_TIMES, "fung")),
    SkinLaw(("power", "fung")),
    SkinLaw((*TWO_TIMES, "residual", "activation")),
    SkinLaw((*TWO_TIMES, "residual", "slowing")),
    SkinLaw((*TWO_TIMES, "flow")),
    SkinLaw(("sheet",)),
)
"""Those that are tried where no basic one is at the noise."""


def switched(parts: Mapping[str, Part], nuisance: FloatArray, law: SkinLaw) -> FloatArray:
    """``nuisance`` (p,), whose first are the ``parts``, with nothing of the amounts that a law lacks, and with what it
    cannot be without."""
    out = nuisance.copy()
    for k, (name, part) in enumerate(parts.items()):
        if part.of == name and (name not in law.amounts or part.sd == FROZEN):
            out[k] = part.begin if name in law.amounts else 0.0
    return out


def guesses(parts: Mapping[str, Part], size: int) -> list[FloatArray]:
    """Nuisance vectors (``size``,), whose first are the ``parts``, from which fits begin: of skin that is as quick as
    usual, quicker and slower."""
    times = np.array([name in TIMES for name in parts])
    out = []
    for at in (0.0, -0.8, 0.8):
        guess = np.zeros(size)
        guess[: len(times)] = [part.begin for part in parts.values()] + at * times
        out.append(guess)
    return out


def bounded_exp(x: float) -> float:
    """Exponential of a logarithm that a fit may have tried far out."""
    return math.exp(min(max(float(x), -15.0), 15.0))


def rewired(chain: Chain, c: Mapping[str, float], strongest: float, reach: float) -> Chain:
    """The chain of a tissue of the usual kind with its further parts in ``c``.

    ``reach`` is the elastic height, m, at the ``strongest`` suction, Pa.
    """
    if c["sheet"]:
        arm = ARM * bounded_exp(c["arm"]), ARM_TIME * bounded_exp(c["arm_time"])
        tension = 1.0 / (1.0 + bounded_exp(c["slack"]))
        constants = (strongest, reach, tension, bounded_exp(c["bend"]), VISCOSITY * bounded_exp(c["viscosity"]), *arm)
        return chain.tuned("elastic", function=_sheet_height, parameters=constants)
    memory: Any = chain["memory"]
    if c["fung"]:
        chain = chain.tuned("memory", parameters=(1.0,))
        chain = before(chain, "elastic", lambda s, t: replace(memory, name="stress_memory", source=s, target=t))
    if c["activation"]:
        chain = chain.tuned("memory", kernel=activated, parameters=(c["activation"] / reach, *memory.parameters[1:]))
    if c["slowing"]:
        chain = chain.tuned("memory", kernel=slowed, parameters=(c["slowing"] / reach, *memory.parameters[1:]))
    if c["flow"]:
        flow = (c["flow"], c["yield"] * strongest, RISE * bounded_exp(c["rise"]), FALL * bounded_exp(c["fall"]))
        chain = after(
            chain, "memory", lambda s, t: LoadFlow("flow", "tissue", (*s, "skin_pressure"), t, reach / strongest, flow)
        )
    return chain


@dataclass(frozen=True)
class LoadFlow(Wired):
    """Height (first source), and ``compliance`` (m/Pa) times the flow under a load (second source, gauge pressure),
    whatever the height: ``kernels.yield_flow``."""

    compliance: float
    parameters: tuple[float, ...]

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        height, pressure = (signals[s] for s in self.source)
        flown = evaluate(yield_flow, time, pressure, *self.parameters) - pressure
        signals[self.target[0]] = height - self.compliance * flown


@njit(cache=True, error_model="numpy")
def _bent_on(x: float, rate: float, per: float, dt: float) -> float:
    """Solution after ``dt`` s of x' = rate/2 - per x - rate/2 x², from ``x``, by t = tanh(d dt / 2) / d with
    d² = per² + rate²; of short steps as a continued fraction, which takes neither root nor exponential."""
    square = (per * per + rate * rate) * (0.25 * dt * dt)
    if square < SHORT:
        left = 945.0 + square * (420.0 + 15.0 * square)
        grown = 0.5 * dt * (945.0 + square * (105.0 + square))
    else:
        d = math.sqrt(per * per + rate * rate)
        e = math.exp(-d * dt)
        left, grown = (1.0 + e) * d, 1.0 - e
    return (x * left + (rate - x * per) * grown) / (left + (rate * x + per) * grown)


@njit(cache=True, error_model="numpy")
def _unbent(x: float) -> float:
    """2 artanh(x); of a small one as a continued fraction, which takes no logarithm."""
    square = x * x
    if square < SMALL:
        return 2.0 * x * (945.0 + square * (64.0 * square - 735.0)) / (945.0 + square * (225.0 * square - 1050.0))
    return math.log((1.0 + x) / (1.0 - x))


@njit(cache=True, error_model="numpy")
def activated(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Creep by Eyring's dashpots: y = u + sum g_i z_i with z_i' = sinh(a (u - z_i)) / (a tau_i).

    ``p`` = (a, g1, tau1 s, ...). Exact for u linear between nodes: x = tanh(a (u - z) / 2) obeys Riccati's equation
    x' = r/2 - x/tau - r/2 x² with r = a u'.
    """
    n = (p.size - 1) // 2
    a = max(abs(p[0]), 1e-9)
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
        s[3 : 3 + n] = math.tanh(min(max(0.5 * a * u[0], -15.0), 15.0))
    for i in range(t.size):
        dt, du = t[i] - s[1], u[i] - s[2]
        out = u[i]
        for k in range(n):
            x = s[3 + k]
            if dt > 0.0:
                x = _bent_on(x, a * du / dt, 1.0 / p[2 + 2 * k], dt)
            elif du != 0.0:
                x = math.tanh(min(max(math.atanh(x) + 0.5 * a * du, -15.0), 15.0))
            s[3 + k] = x = min(max(x, -FULL), FULL)
            out += p[1 + 2 * k] * (u[i] - _unbent(x) / a)
        s[1], s[2] = t[i], u[i]
        y[i] = out


@njit(cache=True, error_model="numpy")
def slowed(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Creep in reduced time: y = u + sum g_i lag(u, tau_i exp(a |u|)). ``p`` = (a, g1, tau1 s, ...)."""
    n = (p.size - 1) // 2
    if s[0] == 0.0 and t.size:
        s[0], s[1], s[2] = 1.0, t[0], u[0]
    for i in range(t.size):
        dt = (t[i] - s[1]) * math.exp(-min(max(0.5 * p[0] * abs(u[i] + s[2]), -20.0), 20.0))
        out = u[i]
        for k in range(n):
            if dt > 0.0:
                e, a, b = hold_weights(dt, p[2 + 2 * k])
                s[3 + k] = e * s[3 + k] + a * s[2] + b * u[i]
            out += p[1 + 2 * k] * s[3 + k]
        s[1], s[2] = t[i], u[i]
        y[i] = out


@njit(cache=True, error_model="numpy")
def stiffening_sheet(s: FloatArray, t: FloatArray, u: FloatArray, p: FloatArray, y: FloatArray) -> None:
    """Height of a sheet that stiffens, in parallel with a dashpot and a Maxwell arm, under gauge pressure u, Pa.

    With x = y/h and q = -u/Q: q = k0 x + (1 - k0) x (exp(b x²) - 1) / (exp(b) - 1) + c x' + e (x - lag(x, tau)), which
    is 1 at x = 1 in the end. ``p`` = (Q Pa, h m, k0, b, c s, e, tau s). A membrane's tension and its stretching (k0 =
    0, small b: q = x³) with Fung's exponential.
    """
    stiff, tension, b = p[4] / DASHPOT, p[2], max(p[3], 1e-3)
    scale = (1.0 - tension) / math.expm1(b)
    first = s[0] == 0.0
    if first and t.size:
        s[0], s[1] = 1.0, t[0]
    for i in range(t.size):
        dt = t[i] - s[1]
        e1, a1, b1 = hold_weights(dt, DASHPOT)
        e2, a2, b2 = hold_weights(dt, p[6])
        if first:  # as it would be in the end
            b1, b2 = 1.0, 1.0
        z1, z2 = e1 * s[3] + a1 * s[2], e2 * s[4] + a2 * s[2]
        slope = stiff * (1.0 - b1) + p[5] * (1.0 - b2)
        load = -u[i] / p[0] + stiff * z1 + p[5] * z2
        x, low, high = s[2], -4.0, 4.0
        for _ in range(60):
            square = min(b * x * x, 50.0)
            grown = math.expm1(square)
            left = (tension + slope) * x + scale * x * grown - load
            if left > 0.0:
                high = x
            else:
                low = x
            new = x - left / (tension + slope + scale * (grown + 2.0 * square * (grown + 1.0)) + 1e-12)
            if not low < new < high:
                new = 0.5 * (low + high)
            done = abs(new - x) < 1e-10
            x = new
            if done:
                break
        s[3], s[4] = z1 + b1 * x, z2 + b2 * x
        first = False
        s[1], s[2] = t[i], x
        y[i] = x * p[1]


def _sheet_height(time: FloatArray, pressure: FloatArray, *constants: float) -> FloatArray:
    return evaluate(stiffening_sheet, time, pressure, *constants)
