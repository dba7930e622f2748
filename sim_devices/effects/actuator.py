"""Effects of actuators: pressure regulation and its gauge, voice coils and their friction."""

from __future__ import annotations

import math
from typing import Any

from sim_devices.chain import Chain, FloatArray
from sim_devices.effects.build import (
    DRAWN,
    LONGEST,
    PRESSURE,
    SUCTION,
    Values,
    choice,
    chosen,
    effect,
    for_a_while,
    law_after,
    law_before,
    map_after,
    shape,
    signed,
    strength,
)
from sim_devices.stages import kernels, laws
from sim_devices.stages.suction import Regulator

BEND = PRESSURE / 2
"""Pa above which a gauge of two slopes is wrong, or a valve lifts, where nothing else is said."""


def _regulator_lag(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 1:
        op: Any = chain["regulator"]
        return chain.tuned("regulator", tau=math.hypot(op.tau, v["tau"] / 2))
    if chosen(v, "form") == 2:
        slow = (1.0 - v["share"], v["share"], v["tau"])
        return law_after(chain, "regulator", "regulator_lag", "actuator", kernels.prony, slow)
    if chosen(v, "form") == 5:
        return law_after(chain, "regulator", "regulator_lag", "actuator", kernels.second_order, (v["tau"] / 2, 1.0))
    if chosen(v, "form") > 2:
        # Suction is negative: it grows downwards.
        times = (0.0, v["tau"]) if chosen(v, "form") == 3 else (v["tau"], 0.0)
        return law_after(chain, "regulator", "regulator_lag", "actuator", kernels.uneven_low_pass, times)
    return law_after(chain, "regulator", "regulator_lag", "actuator", kernels.low_pass, (v["tau"],))


def _slew_suction(chain: Chain, v: Values) -> Chain:
    rate = PRESSURE / v["span_time"]
    rates = (rate * v["release"], rate)  # suction is negative: rising pressure is release
    if chosen(v, "form") > 0:
        return chain.tuned("regulator", rates=rates, eased=chosen(v, "form") == 2)
    return law_before(chain, "regulator", "slew_limit", "actuator", kernels.rate_limit, rates)


def _overshoot(chain: Chain, v: Values) -> Chain:
    op: Any = chain["regulator"]
    log = math.log(max(v["overshoot"], 1e-12))
    zeta, tau = -log / math.hypot(math.pi, log), op.tau * v["slowness"]
    form = chosen(v, "form")
    if form == 0:
        return chain.tuned("regulator", tau=tau, zeta=zeta)
    if form == 1:
        return law_after(chain, "regulator", "overshoot", "actuator", kernels.second_order, (tau, zeta))
    return law_after(chain, "regulator", "overshoot", "actuator", kernels.lead, (2 * v["overshoot"], 2 * tau))


def leak_for_a_while(
    time: FloatArray, u: FloatArray, share: float, exponent: float, reference: float, moment: float, duration: float
) -> FloatArray:
    """A leak (`laws.leak`) that is open for a while."""
    return u + laws.spell(time, moment, duration) * (laws.leak(time, u, share, exponent, reference) - u)


def _leak(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 2:
        # Leaked suction is missing at once; an integrating regulator makes up for it.
        repaired = (1.0 - v["shortfall"], v["shortfall"], v["repair"])
        return law_after(chain, "regulator", "leak", "actuator", kernels.prony, repaired)
    if chosen(v, "form") == 4:
        return law_after(chain, "regulator", "leak", "actuator", kernels.sealing, (v["shortfall"], v["seal"], DRAWN))
    if chosen(v, "form") == 3:
        spell = (v["shortfall"], v["exponent"], PRESSURE, v["moment"], v["duration"])
        return map_after(chain, "regulator", "leak", "actuator", leak_for_a_while, spell)
    if chosen(v, "form") == 1:
        valve = (v["shortfall"], v["knee"], v["power"], PRESSURE)
        return map_after(chain, "regulator", "leak", "actuator", laws.lifted, valve)
    parameters = (v["shortfall"], v["exponent"], PRESSURE)
    return map_after(chain, "regulator", "leak", "actuator", laws.leak, parameters)


def _depletion(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 3:
        drawn = (v["sag"], PRESSURE, v["bleed"], v["fill"])
        return law_after(chain, "regulator", "reservoir_depletion", "actuator", kernels.sagging_store, drawn)
    if chosen(v, "form") == 2:
        limit = (v["draw"], PRESSURE, v["capacity"], v["bleed"], v["fill"], v["soft"])
        return law_after(chain, "regulator", "reservoir_depletion", "actuator", kernels.limited_store, limit)
    if chosen(v, "form") == 1:
        store = (v["sag"], PRESSURE, v["pump"] * PRESSURE, v["reserve"], v["reserve"] * v["refill"])
        return law_after(chain, "regulator", "reservoir_depletion", "actuator", kernels.emptying_store, store)
    parameters = (-v["sag"], PRESSURE, v["tau"], v["tau"] * v["refill"], 0.0)
    return law_after(chain, "regulator", "reservoir_depletion", "actuator", kernels.exposure_gain, parameters)


def _dead_band(chain: Chain, v: Values) -> Chain:
    form, known = chosen(v, "form"), chain["regulator"]
    if form >= 5 and isinstance(known, Regulator) and known.second_order:
        if form > 5:
            return chain.tuned("regulator", laps=(v["band"], float(form == 7)))
        return chain.tuned("regulator", sleeps=(v["band"], v["left"], v["patience"]))
    settings = (v["band"], (1.0, 0.0, v["left"], 1.0, v["left"], v["left"], 1.0, 1.0)[form], float(form >= 3))
    return law_before(chain, "regulator", "dead_band", "actuator", kernels.resting, settings)


def _gauge_gain(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") < 3:
        return _gauge(chain, v, v["error"], 0.0)
    if chosen(v, "form") > 5:
        warming = (v["error"], v["tau"], 1.0)
        chain = map_after(chain, "regulator", "misread", "actuator", laws.without_gain_drift, warming)
        return map_after(chain, "gauge", "gauge_warming", "actuator", laws.gain_drift, warming)
    if chosen(v, "form") > 3:
        growing = (v["error"], PRESSURE, v["power"])
        if chosen(v, "form") == 5:  # the loop makes the reading what a sound one would make the pressure
            chain = map_after(chain, "regulator", "misread", "actuator", laws.unbent_alike, growing)
        return map_after(chain, "gauge", "gauge_bend", "actuator", laws.bent_alike, growing)
    return map_after(chain, "gauge", "gauge_bend", "actuator", laws.bent, (v["error"], v["knee"]))


def _gauge_offset(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") < 3:
        return _gauge(chain, v, 0.0, v["offset"])
    if chosen(v, "form") == 4:
        warming = (v["offset"], v["tau"], 1.0)
        return map_after(chain, "gauge", "gauge_drift", "actuator", laws.drift, warming)
    shift = (v["offset"], v["moment"], v["duration"])
    return map_after(chain, "gauge", "gauge_shift", "actuator", laws.offset_for_a_while, shift)


def _gauge(chain: Chain, v: Values, error: float, amount: float) -> Chain:
    """A gauge that closes the loop moves the true pressure, one that is recorded the reading."""
    form = chosen(v, "form")
    if form != 1:
        chain = map_after(chain, "command_resolution", "misread", "actuator", laws.misread, (error, amount))
    if form != 2:
        known: Any = chain["gauge"]
        chain = chain.tuned("gauge", parameters=(known.parameters[0] + error, known.parameters[1] + amount))
    return chain


CORRECTS = ("corrects down to the band", "corrects wholly", "corrects in part")
WHERE = ("in the loop and in the record", "in the record only", "in the loop only")
GAUGE = choice("form", 0, *WHERE)


EFFECTS = (
    effect(
        "regulator_lag", "actuator", SUCTION,
        "Pressure follows its command more slowly than nominal.",
        "Shorter hoses, a faster valve or more integral gain; record the pressure at the probe.",
        "hoses and valves; W and F assume rise times without measuring them",
        (
            strength("tau", "s", 1e-3, 3.0, 0.3, "time constant beyond the nominal regulator's"),
            choice("form", 0, "a first-order lag behind the regulator", "a slower second-order regulator",
                   "a share of the flow lags", "while suction grows only", "while suction falls only",
                   "a second-order lag behind it"),
            shape("share", "1", 0.05, 0.95, 1 / 3, "that lags", only=(2,)),
        ),
        _regulator_lag,
    ),
    effect(
        "slew_limit", "actuator", SUCTION,
        "The rate of pressure is limited.",
        "A stronger pump, a wider valve; or command ramps that the pump can follow.",
        "F assumed 1e5 mbar/s; pumps reach far less",
        (
            strength("span_time", "s", 2e-3, 10.0, 1.0, "time for 300 mbar of suction"),
            shape("release", "1", 0.1, 10.0, 1.0, "how much faster pressure comes back", log=True),
            choice("form", 0, "of what the regulator is asked for", "of the pressure itself",
                   "of the pressure itself, approached gradually"),
        ),
        _slew_suction,
    ),
    effect(
        "overshoot", "actuator", SUCTION,
        "Under-damped pressure regulation.",
        "Less integral gain, or a damped reservoir.",
        "second-order regulation; gap.md",
        (
            strength("overshoot", "1", 5e-3, 0.8, 0.25, "of a step"),
            shape("slowness", "1", 0.05, 4.0, 1.0, "time constant against the nominal one", log=True),
            choice("form", 0, "of the regulator", "a resonance behind it", "a lead behind it"),
        ),
        _overshoot,
    ),
    effect(
        "leak", "actuator", SUCTION,
        "Flow past the regulator: pressure falls short of its command, more at high suction.",
        "Tighten the line; hold a pressure with the pump off and watch it fall.",
        "orifice and laminar leak laws; gap.md",
        (
            strength("shortfall", "1", 3e-4, 0.6, 0.1, "of 300 mbar at 300 mbar"),
            shape("exponent", "1", -0.5, 1.5, 0.7, "-0.5 orifice, 0 laminar, above: a leak that opens", only=(0, 3)),
            choice("form", 0, "a power of suction", "a valve that lifts at some pressure",
                   "made up for by an integrating regulator", "open for a while",
                   "that suction closes, each time anew"),
            shape("knee", "Pa", 2e3, 25e3, BEND, "at which the valve lifts", only=(1,)),
            shape("power", "1", 0.5, 2.5, 1.0, "of what it lets through beyond that", only=(1,)),
            shape("repair", "s", 0.3, 20.0, 1.5, "within which it is made up for", log=True, only=(2,)),
            shape("seal", "s", 0.1, 20.0, 1.5, "within which it closes", log=True, only=(4,)),
            *for_a_while(3),
        ),
        _leak,
    ),
    effect(
        "reservoir_depletion", "actuator", SUCTION,
        "Suction sags as the vacuum store empties.",
        "A larger reservoir, a pump that runs, pauses to refill.",
        "the aspiration device's air reservoir (W)",
        (
            strength("sag", "1", 3e-4, 0.6, 0.1, "of the pressure, at 300 mbar held for long (form 1: as long again; "
                     "form 3: by one rise to 300 mbar)", only=(0, 1, 3)),
            strength("draw", "1", 1e-3, 1.0, 0.05, "of the store, to 300 mbar once", only=(2,)),
            choice("form", 0, "all along", "once the store is empty, which a pump keeps from it up to some suction",
                   "suction is no larger than what the store has left", "by what rises and holds have drawn"),
            shape("capacity", "Pa", 3e3, 90e3, 33e3, "suction of a full store", log=True, only=(2,)),
            shape("bleed", "1/s", 3e-3, 3.0, 0.1, "drawn by held suction, of one rise to it", log=True, only=(2, 3)),
            shape("fill", "s", 3.0, 300.0, 30.0, "within which a pump fills the store", log=True, only=(2, 3)),
            shape("soft", "Pa", 10.0, 10e3, 100.0, "that a valve needs between store and line", log=True, only=(2,)),
            shape("reserve", "s", 0.1, 20.0, 2.0, "how long the store keeps 300 mbar", log=True, only=(1,)),
            shape("pump", "1", 0.02, 1.2, 0.2, "of 300 mbar, what the pump keeps alone", log=True, only=(1,)),
            shape("tau", "s", 2.0, 300.0, 30.0, "time to empty", log=True, only=(0,)),
            shape("refill", "1", 0.05, 5.0, 0.5, "time to refill against time to empty", log=True, only=(0, 1)),
        ),
        _depletion,
    ),
    effect(
        "dead_band", "actuator", SUCTION,
        "The valve ignores small pressure errors.",
        "A finer valve, or integral action.",
        "on-off and proportional valves; gap.md",
        (
            strength("band", "Pa", 5.0, 8e3, 1e3, "half width of the ignored error"),
            choice("form", 3, *CORRECTS, *(f"{how}, vented at zero" for how in CORRECTS[::2]),
                   "it sleeps until the pressure itself is off by the band, vented at zero",
                   "a spool laps over its port, vented at zero", "the same with a rounded edge, and not vented"),
            shape("left", "1", 0.05, 0.95, 0.3, "share of the band that a correction leaves", only=(2, 4, 5)),
            shape("patience", "s", 0.0, 0.5, 0.0, "within that share before the valve sleeps", only=(5,)),
        ),
        _dead_band,
    ),
    effect(
        "gauge_offset", "actuator", SUCTION,
        "A pressure gauge reads a constant too much.",
        "Zero the gauge in open air; compare with a manometer.",
        "null shift of pressure sensors; gap.md",
        (
            signed("offset", "Pa", 5e3, 1e3, "reading minus truth"),
            choice("form", 0, *WHERE, "in the record only, from one moment on, or for a while",
                   "in the record only, towards a limit, as in warming up"),
            *for_a_while(3, lasting=LONGEST),
            shape("tau", "s", 3.0, 600.0, 60.0, "within which it warms up", log=True, only=(4,)),
        ),
        _gauge_offset,
    ),
    effect(
        "gauge_gain", "actuator", SUCTION,
        "A pressure gauge has a wrong sensitivity.",
        "Calibrate at two pressures with a manometer tap.",
        "span error of pressure sensors; gap.md",
        (
            signed("error", "1", 0.4, 0.1, "relative error of the reading"),
            choice("form", 0, *WHERE, "in the record, beyond a knee", "in the record, ever more as suction grows",
                   "in the loop and in the record, ever more as suction grows",
                   "in the loop and in the record, as it warms up"),
            shape("knee", "Pa", 2e3, 25e3, BEND, "pressure beyond which the slope is wrong", only=(3,)),
            shape("power", "1", 0.2, 4.0, 2.0, "of suction over 300 mbar, of the error", only=(4, 5)),
            shape("tau", "s", 10.0, 1000.0, 150.0, "within which it warms up", log=True, only=(6,)),
        ),
        _gauge_gain,
    ),
)  # fmt: skip
