"""The regulator of a suction instrument among the nuisance: near the nominal one, of another make, or of a structure
that nobody knows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from gap.data.tolerances import Tolerance
from gap.inference.hypothesis import FROZEN
from gap.null.skin_laws import bounded_exp
from sim_devices.chain import Chain, FloatArray, Signals
from sim_devices.effects.build import PRESSURE
from sim_devices.stages import kernels
from sim_devices.stages.kernels import FREE, evaluate, low_pass, prony
from sim_devices.stages.operators import Law, Wired, after, before
from sim_devices.stages.suction import REGULATOR_TAU

LAGS, SLOW_LAGS = (0.015, 0.04, 0.1), (0.3, 1.5, 7.0)
"""s of further lags, of which a regulator has small shares; the slow ones are of an integral that is."""
VALVE_NOMINAL: Mapping[str, float] = {
    "integral_rate": 0.0,
    "setpoint_weight": 1.0,
    "suction_flow_slope": 0.0,
    "venting_flow_slope": 0.0,
    "flow_asymmetry": 0.0,
    "opened_wholly": 0.0,
    "opened_softly": 0.0,
    "integral_tracks": 0.0,
    "inertia": 0.0,
}
"""A loop about a valve, and what these are in a second order: the last four are the largest command over the error
that opens the valve as far as it goes, how far it comes to that softly, 0 to 1, the rate (1/s) at which the
integral then tracks the valve, which at 0 waits, and the valve's inertia, or that of a loop of its own."""
HEAVIEST = 4.0
"""Inertia of a valve whose own loop is damped by .25; more counts as so much."""
KEENEST = 100.0
"""1/s: an integral that tracks the valve more quickly counts as so quick."""
TIME, DAMPING, SHIFT, CLOCK = range(4)
FURTHER = slice(4, 4 + len(LAGS))
LEAD = FURTHER.stop
VALVE = slice(LEAD + 1, LEAD + 1 + len(VALVE_NOMINAL))
WEIGHED = slice(VALVE.start, VALVE.start + 2)
FLOW = slice(WEIGHED.stop, WEIGHED.stop + 3)
WHOLLY, SOFTLY, TRACKS, INERTIA = range(FLOW.stop, VALVE.stop)
SPAN = VALVE.stop
SLOW = slice(SPAN + 1, SPAN + 1 + len(SLOW_LAGS))
UNKNOWN = slice(SLOW.stop, SLOW.stop + FREE)
GAIN, ZERO, VENTED = range(UNKNOWN.stop, UNKNOWN.stop + 3)
SIZE = VENTED + 1
"""Where the nuisance (SIZE,) has the logarithm of the regulator's time and damping, how late its samples are (s) and
its clock's rate; shares of further lags, a lead (s), the loop about a valve (`WEIGHED` its controller's, `FLOW` how its
flow follows the pressure, `WHOLLY`, `SOFTLY` and `TRACKS` what it does at its end, and its `INERTIA`), the s for 300
mbar of a limited rate (below nought the set-point's), shares of slow lags, the logarithms of `kernels.free_loop`; the
gauge's gain, its zero (Pa), and by how much it reads more (Pa) while the line is vented: a zero that closes the loop
shows at one of both only. A session of several recordings adds by how much each one's zero is off that (Pa)."""


class Vent(NamedTuple):
    """How a regulator vents: to ``highest`` Pa above the air's pressure, above which a loop's integral empties; if only
    to the air's, the integral stays as it is, or begins anew when the instrument is ``armed`` for a recording. Or the
    controller ``clears`` it, while nothing is asked for, at once where its command touches nought, or stays there,
    or, in either line, once that has come to the air's pressure.
    """

    highest: float
    armed: bool = False
    clears: str = "never"


EMPTIES, STAYS, ARMED, CLEARS = Vent(5e3), Vent(0.0), Vent(0.0, armed=True), Vent(0.0, clears="unasked")
SWINGS, LANDS = Vent(5e3, clears="at air"), Vent(0.0, clears="at air")
TOUCHED, STILL = Vent(0.0, clears="touched"), Vent(0.0, clears="still")
VENTS = (EMPTIES, STAYS, ARMED, CLEARS, SWINGS, LANDS, TOUCHED, STILL)


@dataclass(frozen=True)
class FurtherLags(Wired):
    """The difference of a regulator of another structure from a second-order one: ``shares`` (share, s) of its response
    come with a further lag each, and its slope comes ``lead`` s ahead, of a set-point that is fed forward or
    weighed; below nought all of it comes with a lag of so much, as by a valve that has one."""

    shares: tuple[tuple[float, float], ...]
    lead: float

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        u = signals[self.source[0]]
        lags = [pair for pair in self.shares if pair[0]]
        made = evaluate(prony, time, u, 1.0 - sum(k for k, _ in lags), *np.ravel(lags)) if lags else u
        if self.lead > 0.0:
            made = made + self.lead * np.gradient(u, time)
        elif self.lead < 0.0:
            made = made + evaluate(low_pass, time, u, -self.lead) - u
        signals[self.target[0]] = made


def prior_widths(
    own: Mapping[str, Mapping[str, Tolerance]],
    shift: float,
    width: Callable[[Tolerance], float],
    opened: slice = slice(0),
) -> FloatArray:
    """Prior widths (SIZE,) by an instrument's ``own`` tolerances, of which ``width`` takes one; ``shift`` s is how late
    a sound channel may be. What makes a regulator another than a second order is frozen, but for the part ``opened``:
    a loop about a valve, one of an even flow whose set-point is weighed, or a structure that nobody knows."""
    regulator = own["regulator"]
    out = np.full(SIZE, FROZEN)
    out[[TIME, DAMPING]] = width(regulator["time"]), width(regulator["damping"])
    out[[SHIFT, CLOCK]] = shift, own["clock_skew"]["rate"].value
    out[FURTHER], out[LEAD] = width(regulator["further_lags"]), width(regulator["lead"])
    if opened == VALVE:
        out[VALVE] = [width(regulator[f"valve_{name}"]) for name in VALVE_NOMINAL]
    if opened == WEIGHED:
        out[WEIGHED] = [width(regulator[f"weighed_{name}"]) for name in list(VALVE_NOMINAL)[:2]]
    if opened == UNKNOWN:
        out[UNKNOWN], out[SLOW] = width(regulator["unknown_slopes"]), width(regulator["further_lags"])
    out[[GAIN, ZERO]] = own["gauge_gain"]["error"].value, own["gauge_offset"]["offset"].value
    out[VENTED] = out[ZERO]
    return out


def steps(sampling: float) -> FloatArray:
    """Steps (GAIN,) of differences for the Jacobian; ``sampling`` s is the sampling period."""
    out = np.full(GAIN, 1e-3)
    out[[SHIFT, CLOCK, LEAD]] = 0.05 * sampling, 1e-6, 1e-4
    return out


def regulated(chain: Chain, c: FloatArray, largest: float, vent: Vent) -> Chain:
    """The nominal chain with the regulator at a nuisance vector (SIZE,); ``largest`` Pa is asked for at most, and it
    vents as ``vent`` has it."""
    tau, zeta = REGULATOR_TAU * bounded_exp(c[TIME]), bounded_exp(c[DAMPING])
    chain = chain.tuned("regulator", tau=tau, zeta=zeta, highest=vent.highest)
    if np.any(np.abs(c[VALVE]) > FROZEN):
        *loop, wholly, softly, tracks, inertia = c[VALVE] + list(VALVE_NOMINAL.values())
        ends = largest / max(wholly, 1e-9), float(np.clip(softly, 0.0, 1.5)), float(np.clip(tracks, 0.0, KEENEST))
        valve = *loop, *ends, float(np.clip(inertia, 0.0, HEAVIEST))
        armed = chain["latency"].marks if vent.armed else ()  # type: ignore[attr-defined]
        chain = chain.tuned("regulator", valve=valve, armed=armed, clears=vent.clears)
    if np.any(np.abs(c[UNKNOWN]) > FROZEN):
        chain = chain.tuned("regulator", unknown=(largest, *c[UNKNOWN].tolist()))
    if abs(span := float(c[SPAN])) > FROZEN:
        chain = _limited(chain, PRESSURE / span)
    shares, lead = (*c[FURTHER].tolist(), *c[SLOW].tolist()), float(c[LEAD])
    if not lead and not any(shares):
        return chain
    lags = tuple(zip(shares, (*LAGS, *SLOW_LAGS), strict=True))
    return after(chain, "regulator", lambda s, t: FurtherLags("further_lags", "actuator", s, t, lags, lead))


def _limited(chain: Chain, rate: float) -> Chain:
    """The chain with a pressure's rate limited to ``rate`` Pa/s, or, of a negative one, with its set-point's."""
    if rate > 0.0:
        return chain.tuned("regulator", rates=(rate, rate))
    limits = -rate, -rate
    return before(chain, "regulator", lambda s, t: Law("limited", "command", s, t, kernels.rate_limit, limits))


def opened_flow(c: FloatArray, largest: float) -> float:
    """Pa/s that the valve of a nuisance vector (SIZE,) gives to an empty chamber where it is opened wholly."""
    per_error = 1.0 / (2.0 * REGULATOR_TAU * bounded_exp(c[TIME]) * bounded_exp(c[DAMPING]))
    lean = c[FLOW][-1]
    return float(per_error * (1.0 + lean) * largest / max(c[WHOLLY], 1e-9))


def quantities(c: FloatArray, sd: FloatArray) -> Mapping[str, tuple[float, str]]:
    """The regulator's and gauge's parameters at a nuisance vector (SIZE,) under a prior of widths ``sd`` (SIZE,): value
    and unit. A structure that nobody knows has no time and damping of its own."""
    out: dict[str, tuple[float, str]] = {}
    if sd[UNKNOWN.start] <= FROZEN:
        out["regulator_time"] = (REGULATOR_TAU * float(np.exp(c[TIME])), "s")
        out["regulator_damping"] = (float(np.exp(c[DAMPING])), "1")
    out["regulator_lead"] = (float(c[LEAD]), "s")
    lags = [*zip(LAGS, c[FURTHER], sd[FURTHER], strict=True), *zip(SLOW_LAGS, c[SLOW], sd[SLOW], strict=True)]
    out |= {f"regulator_lag_{1e3 * lag:.0f}_ms": (float(share), "1") for lag, share, width in lags if width > FROZEN}
    valve = zip(VALVE_NOMINAL.items(), c[VALVE], sd[VALVE], strict=True)
    out |= {
        f"regulator_{name}": (float(x) + plain, "1/s" if name.startswith("integral") else "1")
        for (name, plain), x, width in valve
        if width > FROZEN
    }
    if sd[SPAN] > FROZEN:
        out["regulator_span_time" if c[SPAN] > 0.0 else "regulator_setpoint_span_time"] = (abs(float(c[SPAN])), "s")
    return out | {
        "sampling_shift": (float(c[SHIFT]), "s"),
        "clock_rate": (float(c[CLOCK]), "s/s"),
        "gauge_gain_error": (float(c[GAIN]), "1"),
        "gauge_zero": (float(c[ZERO]), "Pa"),
        "gauge_zero_more_while_vented": (float(c[VENTED]), "Pa"),
    }
