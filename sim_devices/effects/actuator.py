"""Effects of actuators: pressure regulation and its gauge, voice coils and their friction."""

from __future__ import annotations

import math
from typing import Any

from sim_devices.chain import Chain, FloatArray
from sim_devices.effects.build import (
    LONGEST,
    PRESSURE,
    ROBOT,
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
from sim_devices.stages.axes import FORCE_LIMIT

BEND = PRESSURE / 2
"""Pa above which a gauge of two slopes is wrong, or a valve lifts, where nothing else is said."""
DRAWN = 500.0
"""Pa of suction from which on it draws a leak's edges together."""


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
        slope = -v["shortfall"] * PRESSURE / (PRESSURE - v["knee"])
        return map_after(chain, "regulator", "leak", "actuator", laws.bent, (slope, v["knee"]))
    parameters = (v["shortfall"], v["exponent"], PRESSURE)
    return map_after(chain, "regulator", "leak", "actuator", laws.leak, parameters)


def _depletion(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 2:
        limit = (v["draw"], PRESSURE, v["capacity"], v["bleed"], v["fill"])
        return law_after(chain, "regulator", "reservoir_depletion", "actuator", kernels.limited_store, limit)
    if chosen(v, "form") == 1:
        store = (v["sag"], PRESSURE, v["pump"] * PRESSURE, v["reserve"], v["reserve"] * v["refill"])
        return law_after(chain, "regulator", "reservoir_depletion", "actuator", kernels.emptying_store, store)
    parameters = (-v["sag"], PRESSURE, v["tau"], v["tau"] * v["refill"])
    return law_after(chain, "regulator", "reservoir_depletion", "actuator", kernels.exposure_gain, parameters)


def _dead_band(chain: Chain, v: Values) -> Chain:
    form = chosen(v, "form")
    settings = (v["band"], (1.0, 0.0, v["left"], 1.0, v["left"])[form], float(form >= 3))
    return law_before(chain, "regulator", "dead_band", "actuator", kernels.resting, settings)


def _gauge_gain(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") < 3:
        return _gauge(chain, v, v["error"], 0.0)
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


def _slew_robot(chain: Chain, v: Values) -> Chain:
    rate = 1e-3 / v["span_time"]
    targets = ("target_1", "target_2", "target_3")
    chain = law_before(chain, "axes", "slew_limit", "actuator", kernels.rate_limit, (rate, rate), *targets)
    if chosen(v, "form") == 0:
        return chain
    return law_before(chain, "axes", "slew_rounding", "actuator", kernels.low_pass, (v["rounding"],), *targets)


def _drag(chain: Chain, v: Values) -> Chain:
    alone = chosen(v, "axis")
    if chosen(v, "form") == 0:
        return chain.tuned("axes", drag=v["drag"], alone=alone)
    return chain.tuned("axes", thinning=v["thinning"], thinning_power=v["power"], alone=alone)


def _backlash(chain: Chain, v: Values) -> Chain:
    half = v["gap"] / 2
    if chosen(v, "form") == 0:
        return law_before(chain, "platform", "backlash", "actuator", kernels.play, (half,))
    return law_before(chain, "platform", "backlash", "actuator", kernels.soft_play, (half,))


def _friction(chain: Chain, v: Values) -> Chain:
    return chain.tuned("axes", coulomb=v["force"], presliding=v["presliding"], alone=chosen(v, "axis"))


def _saturation(chain: Chain, v: Values) -> Chain:
    carried = v["carried"] * v["limit"] if chosen(v, "form") == 2 else 0.0
    return chain.tuned("axes", force_limit=v["limit"], soft=float(chosen(v, "form") == 1), carried=carried)


def _stribeck(chain: Chain, v: Values) -> Chain:
    chain = chain.tuned("axes", stiction=v["stiction"], stribeck_speed=v["speed"], alone=chosen(v, "axis"))
    return chain.tuned("axes", coulomb=v["stiction"] * v["coulomb_share"], presliding=v["presliding"])


_AXIS = choice("axis", 0, "all axes", "axis 1", "axis 2", "axis 3")
_PRESLIDING = shape("presliding", "m", 0.0, 60e-6, 0.0, "distance over which it builds up; 0: at once")


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
            strength("sag", "1", 3e-4, 0.6, 0.1, "of the pressure, at 300 mbar held for long (form 1: as long again)",
                     only=(0, 1)),
            strength("draw", "1", 1e-3, 1.0, 0.05, "of the store, to 300 mbar once", only=(2,)),
            choice("form", 0, "all along", "once the store is empty, which a pump keeps from it up to some suction",
                   "suction is no larger than what the store has left"),
            shape("capacity", "Pa", 3e3, 90e3, 33e3, "suction of a full store", log=True, only=(2,)),
            shape("bleed", "1/s", 0.03, 3.0, 0.3, "what a held suction draws, of itself", log=True, only=(2,)),
            shape("fill", "s", 3.0, 300.0, 30.0, "within which a pump fills the store", log=True, only=(2,)),
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
            choice("form", 3, *CORRECTS, *(f"{how}, vented at zero" for how in CORRECTS[::2])),
            shape("left", "1", 0.05, 0.95, 0.3, "share of the band that a correction leaves", only=(2, 4)),
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
            choice("form", 0, *WHERE, "in the record, beyond a knee"),
            shape("knee", "Pa", 2e3, 25e3, BEND, "pressure beyond which the slope is wrong", only=(3,)),
        ),
        _gauge_gain,
    ),
    effect(
        "slew_limit", "actuator", ROBOT,
        "The rate of axis motion is limited.",
        "Slower trajectories, or a higher limit in the controller.",
        "trajectory generators' velocity limits; gap.md",
        (
            strength("span_time", "s", 0.2, 50.0, 6.0, "time for 1 mm of an axis"),
            choice("form", 0, "abruptly", "rounded, as a limited jerk does"),
            shape("rounding", "s", 1e-3, 0.2, 0.02, "time constant of it", log=True, only=(1,)),
        ),
        _slew_robot,
    ),
    effect(
        "force_saturation", "actuator", ROBOT,
        "Voice-coil force (current) is limited.",
        "A stronger coil or supply; slower starts.",
        "amplifier current limits; gap.md",
        (
            strength("limit", "N", 0.02, FORCE_LIMIT, 0.25, "of one axis", null=FORCE_LIMIT),
            choice("form", 0, "clipped", "approached gradually", "clipped, of a coil that carries a weight"),
            shape("carried", "1", -0.9, 0.9, 0.4, "share of the limit that holds the weight", only=(2,)),
        ),
        _saturation,
    ),
    effect(
        "viscous_drag", "actuator", ROBOT,
        "Drag of an axis that grows with its speed.",
        "Other grease; feed the speed forward.",
        "slides and position sensors; gap.md; greases thin by shear, Herschel and Bulkley 1926",
        (
            strength("drag", "N s/m", 1.0, 3e3, 200.0, "per axis", only=(0,)),
            strength("thinning", "N", 1e-3, 1.0, 0.05, "at 1 mm/s, per axis", only=(1,)),
            shape("power", "1", 0.2, 0.9, 0.5, "of the speed that it grows with", only=(1,)),
            choice("form", 0, "in proportion to its speed", "with a power of it, as grease thins"),
            _AXIS,
        ),
        _drag,
    ),
    effect(
        "coulomb_friction", "actuator", ROBOT,
        "Dry friction of an axis, constant against motion.",
        "Other bearings; friction feed-forward; dither.",
        "ALPS RDC1014 alone has up to 0.25 N; Dahl 1968 for the presliding form",
        (
            strength("force", "N", 1e-3, 5.0, 0.4, "of one axis"),
            _PRESLIDING,
            _AXIS,
        ),
        _friction,
    ),
    effect(
        "stribeck_friction", "actuator", ROBOT,
        "Dry friction that is higher near standstill.",
        "Other lubricant; dither; a faster approach.",
        "Stribeck 1902; Armstrong-Hélouvry et al. 1994; with bristles Canudas de Wit et al. 1995",
        (
            strength("stiction", "N", 1e-3, 5.0, 0.5, "above the kinetic friction, at standstill"),
            shape("coulomb_share", "1", 0.0, 2.0, 0.5, "kinetic friction against that"),
            shape("speed", "m/s", 5e-5, 5e-3, 5e-4, "Stribeck speed", log=True),
            _PRESLIDING,
            _AXIS,
        ),
        _stribeck, extends=("coulomb_friction",),
    ),
    effect(
        "backlash", "actuator", ROBOT,
        "Play between axis and platform.",
        "Preload the pivots with stiffer springs.",
        "vee-jewel pivots held by springs (M)",
        (
            strength("gap", "m", 1e-6, 6e-4, 80e-6, "full play of one axis"),
            choice("form", 0, "sharp", "taken up gradually"),
        ),
        _backlash,
    ),
    effect(
        "integral_windup", "actuator", ROBOT,
        "The integral term winds up while the force is limited, and empties late.",
        "Freeze the integrator while the output is limited.",
        "Åström & Hägglund, PID Controllers",
        (
            strength("limit", "N", 0.02, FORCE_LIMIT, 0.25, "force at which the output is limited", null=FORCE_LIMIT),
            shape("running", "1", 0.2, 1.0, 1.0, "share of the integration that goes on"),
        ),
        lambda chain, v: chain.tuned("axes", force_limit=v["limit"], windup=v["running"]),
    ),
    effect(
        "position_dependent_force_constant", "actuator", ROBOT,
        "Coil force per ampere varies along the stroke.",
        "Tabulate the force constant and divide by it.",
        "fringe field of short voice coils; gap.md",
        (
            signed("slope", "1/m", 2000.0, 300.0, "relative change per metre of travel"),
            shape("curvature", "1/m**2", 0.0, 2e5, 0.0, "relative loss per square metre"),
        ),
        lambda chain, v: chain.tuned("axes", slope=v["slope"], curvature=-v["curvature"]),
    ),
)  # fmt: skip
