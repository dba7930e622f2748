"""The nominal chains of the two suction instruments, from pressure set-point to apex height.

command_pressure -> due_pressure -> setpoint_pressure -> line_pressure (true) -> skin_pressure -> elastic_height ->
viscous_height -> bulge (true) -> raw_height; measured: pressure, apex_height.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from sim_devices.chain import Chain, FloatArray, Signals
from sim_devices.stages import kernels, laws
from sim_devices.stages.operators import Delay, Law, Map, Noise, Pass, Wired, analog
from sim_devices.stages.tissues import SuctionTissue, for_opening, suction_tissue

OPENING = {"cutometer": 2e-3, "aspiration": 8e-3}
"""Default probe openings (diameter, m)."""
VACUUM = {"cutometer": -50e3, "aspiration": -70e3}
"""Deepest pressure the pump reaches (Pa gauge), by devices' published range."""
COMMAND_STEP = 100.0
"""Command resolution, Pa (1 mbar, assumed)."""
REGULATOR_TAU = 0.040
"""Time constant of the second-order pressure regulator, s (assumed)."""


VALVE_AND_INTEGRAL = slice(4, 7)
"""Where the state of `kernels.valve_loop` has the valve, its speed and the integral."""


@dataclass(frozen=True)
class Regulator(Wired):
    """Second-order pressure regulation, tau² p'' + 2 zeta tau p' + p = set-point, within the pump's limits.

    ``rates`` (Pa/s) limit how fast pressure rises and falls, at once or, if it is ``eased``, ever more as they are
    approached. One with a ``valve`` (r 1/s, b, build, vent, lean, open Pa, softly, tracks 1/s, inertia of
    `kernels.valve_loop`) is a PI loop whose flow follows the pressure; it is the second order where these are 0, 1, 0,
    0, 0, inf, 0, 0, 0. At
    times when it is ``armed`` (s) such a loop begins with its integral empty and its valve closed; it ``clears`` its
    integral when `kernels.CLEARS` says. One of ``unknown`` structure (largest command Pa, logarithms of
    `kernels.free_loop`) is the second order where these are 0. One that ``sleeps`` (band Pa, share and s of
    `kernels.sleeping_loop`) is, where it is awake, and one that ``laps`` (band Pa, 1 where it is rounded, of
    `kernels.overlapping_loop`) for large errors.
    """

    tau: float = REGULATOR_TAU
    zeta: float = 1.0
    lowest: float = -50e3
    highest: float = 0.0
    rates: tuple[float, float] = (np.inf, np.inf)
    eased: bool = False
    valve: tuple[float, ...] = ()
    unknown: tuple[float, ...] = ()
    sleeps: tuple[float, ...] = ()
    laps: tuple[float, ...] = ()
    armed: tuple[float, ...] = ()
    clears: str = "never"

    @property
    def second_order(self) -> bool:
        """Whether it is of the nominal structure, and its rates are not limited."""
        return not (self.valve or self.unknown or self.sleeps or self.laps) and bool(np.isinf(self.rates).all())

    def fresh(self) -> Any:
        if self.unknown:
            return np.zeros(kernels.STATE), np.array([self.tau, self.zeta, *self.unknown])
        if self.sleeps or self.laps:
            return np.zeros(kernels.STATE), np.array([self.tau, self.zeta, *self.sleeps, *self.laps])
        loop = np.array([self.tau, self.zeta, *self.rates])
        if self.valve:
            # By their names, as a kernel reads on beyond too few.
            reset, weight, build, vent, lean, opened, softly, tracks, inertia = self.valve
            line = (-self.lowest, float(self.eased), opened, self.highest, kernels.CLEARS.index(self.clears))
            loop = np.array([*loop, reset, weight, build, vent, lean, *line, softly, tracks, inertia])
        return np.zeros(kernels.STATE), loop

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        law = kernels.eased if self.eased else kernels.hurried
        law = kernels.second_order if np.isinf(self.rates).all() else law
        law = kernels.valve_loop if self.valve else law
        law = kernels.sleeping_loop if self.sleeps else law
        law = kernels.overlapping_loop if self.laps else law
        law = kernels.free_loop if self.unknown else law
        out = kernels.anew(law, state[0], time, signals[self.source[0]], state[1], self.armed, VALVE_AND_INTEGRAL)
        signals[self.target[0]] = np.clip(out, self.lowest, self.highest, out=out)


@dataclass(frozen=True)
class Zeroing(Wired):
    """Height reset to zero when suction starts.

    Sources are height and due pressure. ``marks`` (s) are the moments at which the instrument is armed anew, one for
    each recording of a session: the reading is zeroed there and at the first suction after it, ``delay`` s late. With
    ``anew`` > 0 every suction that follows ``anew`` s or more of rest is zeroed too. If it is ``averaged``, the zero is
    the mean over the delay and is taken off from the mark on, as in processing afterwards: as far back as the samples
    of one call reach. With ``held`` the zero is that of a flat surface, taken before.
    """

    marks: tuple[float, ...] = ()
    delay: float = 0.0
    anew: float = 0.0
    averaged: bool = False
    held: bool = False

    def fresh(self) -> Any:
        state = np.zeros(ZERO_STATE)
        state[1] = 3.0 if self.held else 0.0
        return state, np.array([*(() if self.held else sorted(self.marks)), np.inf])

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        height, pressure = (signals[s] for s in self.source)
        out = np.empty(len(time))
        zeroed(state[0], time, height, pressure, state[1], self.delay, self.anew, self.averaged, True, out)
        signals[self.target[0]] = out


ZERO_STATE = 8
"""Length of the state of `zeroed`."""


@njit(cache=True, error_model="numpy")
def zeroed(
    s: FloatArray,
    t: FloatArray,
    h: FloatArray,
    p: FloatArray,
    marks: FloatArray,
    delay: float,
    anew: float,
    averaged: bool,
    at_marks: bool,
    y: FloatArray,
) -> None:
    """Height less its zero, taken when suction starts after a mark, and at the mark itself with ``at_marks``."""
    # s: [0] zero, [1] 0 = unstarted, 1 = armed, 2 = waiting out the delay, 3 = zeroed;
    # [2] when the delay ends, [3] index of the next mark, [4] at rest since, [5] last time, [6] last height,
    # [7] integral of height since suction started
    for i in range(t.size):
        if s[1] == 0.0 or t[i] >= marks[int(s[3])]:
            _arm(s, t[i], marks)
            if at_marks:
                s[0] = h[i]
        if p[i] < -1.0:  # suction
            if _starts(s, t[i], anew):
                s[1], s[2], s[5], s[6], s[7] = 2.0, t[i] + delay, t[i], h[i], 0.0
            s[4] = t[i]
        if s[1] == 2.0 and _waited(s, t[i], h[i]):
            s[0], s[1] = s[6], 3.0
            if averaged and delay > 0.0:
                s[0] = s[7] / delay
                _take_off(s, t, h, marks, i, y)
        y[i] = h[i] - s[0]


@njit(cache=True, error_model="numpy")
def _arm(s: FloatArray, now: float, marks: FloatArray) -> None:
    """Arm the zeroing at ``now``, past all marks until then."""
    while now >= marks[int(s[3])]:
        s[3] += 1.0
    s[1], s[4] = 1.0, now


@njit(cache=True, error_model="numpy")
def _waited(s: FloatArray, now: float, height: float) -> bool:
    """Go on to a sample, or to the end of the delay, which lies between two; whether the delay is over."""
    end = min(now, s[2])
    part = (end - s[5]) / (now - s[5]) if now > s[5] else 1.0
    there = s[6] + part * (height - s[6])
    s[7] += 0.5 * (s[6] + there) * (end - s[5])
    s[5], s[6] = end, there
    return bool(now >= s[2] - 1e-9)


@njit(cache=True, error_model="numpy")
def _starts(s: FloatArray, now: float, anew: float) -> bool:
    """Whether suction at ``now`` is the first since the zeroing was armed, or since a rest of ``anew`` s."""
    return bool(s[1] == 1.0 or (s[1] == 3.0 and 0.0 < anew <= now - s[4]))


@njit(cache=True, error_model="numpy")
def _take_off(s: FloatArray, t: FloatArray, h: FloatArray, marks: FloatArray, end: int, y: FloatArray) -> None:
    """Take the zero off the samples before ``end``, back to the last mark."""
    begin = marks[int(s[3]) - 1] if s[3] > 0.0 else -np.inf
    for j in range(end - 1, -1, -1):
        if t[j] < begin:
            break
        y[j] = h[j] - s[0]


def elastic_height(
    time: FloatArray, pressure: FloatArray, compliance: float, knee: float, exponent: float
) -> FloatArray:
    """Instantaneous apex height, m, under gauge ``pressure``, Pa (suction negative); odd in pressure."""
    ratio = np.abs(pressure) / knee
    return compliance * knee / exponent * np.copysign(np.expm1(exponent * np.log1p(ratio)), -pressure)


def tissue_operators(tissue: SuctionTissue) -> tuple[Wired, ...]:
    """The tissue's operators, skin_pressure -> bulge."""
    pairs = [x for pair in zip(tissue.creep, tissue.times, strict=True) for x in pair]
    flow = (tissue.residual, 0.0, tissue.residual_rise, tissue.residual_fall)
    soft = (tissue.softening, tissue.softening_height, *tissue.softening_law)
    curve = (tissue.compliance, tissue.knee, tissue.exponent)
    return (
        Map("elastic", "tissue", ("skin_pressure",), ("elastic_height",), elastic_height, curve),
        Law("memory", "tissue", ("elastic_height",), ("viscous_height",), kernels.prony, (1.0, *pairs)),
        Law("residual", "tissue", ("viscous_height",), ("flowed_height",), kernels.yield_flow, flow),
        Law("softening", "tissue", ("flowed_height",), ("bulge",), kernels.exposure_gain, soft),
    )


def nominal_suction(
    instrument: str,
    *,
    opening: float | None = None,
    tissue: str | SuctionTissue = "forearm",
    latency: float = 0.0,
    tau: float = REGULATOR_TAU,
    zeta: float = 1.0,
    command_step: float = COMMAND_STEP,
    marks: tuple[float, ...] = (),
) -> Chain:
    """The chain of an ideal instrument: ``opening`` is the probe's diameter in m, ``marks`` as in ``Zeroing``."""
    skin = suction_tissue(tissue) if isinstance(tissue, str) else tissue
    skin = for_opening(skin, OPENING[instrument] if opening is None else opening)
    lowest = VACUUM[instrument]
    return Chain(
        instrument,
        (
            Delay("latency", "timing", ("command_pressure",), ("due_pressure",), delay=latency, marks=marks),
            Map(
                "command_resolution",
                "command",
                ("due_pressure",),
                ("setpoint_pressure",),
                laws.quantisation,
                (command_step,),
            ),
            Regulator("regulator", "actuator", ("setpoint_pressure",), ("line_pressure",), tau, zeta, lowest=lowest),
            Pass("hose", "interface", ("line_pressure",), ("probe_pressure",)),
            Pass("probe", "interface", ("probe_pressure",), ("skin_pressure",)),
            *tissue_operators(skin),
            Pass("manometer", "sensor", ("probe_pressure",), ("pressure_reference",)),
            Map("gauge", "sensor", ("line_pressure",), analog("pressure"), laws.affine, (0.0, 0.0)),
            Noise("gauge_noise", "sensor", analog("pressure"), ("pressure",)),
            Pass("optics", "sensor", ("bulge",), analog("raw_height")),
            Noise("optics_noise", "sensor", analog("raw_height"), ("raw_height",)),
            Zeroing("zeroing", "processing", ("raw_height", "due_pressure"), ("apex_height",), marks),
        ),
    )


def with_tissue(chain: Chain, tissue: SuctionTissue) -> Chain:
    """The chain with another tissue (as this opening meets it); effects on the tissue's operators keep their place."""
    for op in tissue_operators(tissue):
        chain = chain.tuned(op.name, parameters=op.parameters)  # type: ignore[attr-defined]
    return chain
