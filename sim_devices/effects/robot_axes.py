"""The robot's axes: trajectory generator, coil, bearings."""

from __future__ import annotations

from dataclasses import replace

from sim_devices.chain import Chain
from sim_devices.effects.build import (
    ROBOT,
    Values,
    choice,
    chosen,
    effect,
    law_before,
    shape,
    signed,
    strength,
)
from sim_devices.stages import kernels
from sim_devices.stages.axes import FORCE_LIMIT
from sim_devices.stages.friction import THIN_AT
from sim_devices.stages.operators import before
from sim_devices.stages.path import PathSpeed
from sim_devices.stages.robot import numbered, xyz

BRAKES_AT = 1e-2
"""m/s at which the drag of swirling air is stated."""
_AXIS = choice("axis", 0, "all axes", "axis 1", "axis 2", "axis 3")
_PRESLIDING = shape("presliding", "m", 0.0, 60e-6, 0.0, "distance over which it builds up; 0: at once")


def _slew_robot(chain: Chain, v: Values) -> Chain:
    rate, name, stage = 1e-3 / v["span_time"], "slew_limit", "actuator"
    if chosen(v, "form") == 2:
        chain = before(chain, "inverse_kinematics", lambda s, t: PathSpeed(name, stage, s, t, rate), *xyz("due"))
        anchor, signals = "inverse_kinematics", xyz("due")
    elif chosen(v, "form") == 3:
        limits = (rate, v["acceleration"])
        return law_before(chain, "axes", name, stage, kernels.planned, limits, *numbered("target"))
    else:
        anchor, signals = "axes", numbered("target")
        chain = law_before(chain, anchor, name, stage, kernels.rate_limit, (rate, rate), *signals)
    if chosen(v, "form") == 0:
        return chain
    return law_before(chain, anchor, "slew_rounding", stage, kernels.low_pass, (v["rounding"] / rate,), *signals)


def _drag(chain: Chain, v: Values) -> Chain:
    alone = chosen(v, "axis")
    if chosen(v, "form") == 0:
        return chain.tuned("axes", drag=v["drag"], alone=alone)
    if chosen(v, "form") == 2:
        at_once = v["braking"] * (THIN_AT / BRAKES_AT) ** v["steepness"]
        return chain.tuned("axes", thinning=at_once, thinning_power=v["steepness"], alone=alone)
    return chain.tuned("axes", thinning=v["thinning"], thinning_power=v["power"], alone=alone)


def _backlash(chain: Chain, v: Values) -> Chain:
    half, form, axis = v["gap"] / 2, chosen(v, "form"), chosen(v, "axis")
    kernel = (kernels.play, kernels.soft_play, kernels.prandtl)[form]
    parameters = kernels.of_joints(half, v["spread"]) if form == 2 else (half,)
    one = (numbered("axis")[axis - 1],) if axis else ()
    return law_before(chain, "platform", "backlash", "actuator", kernel, parameters, *one, add=form == 2)


def _friction(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 1:
        return chain.tuned("axes", coulomb=v["force"], easing=v["easing"], alone=chosen(v, "axis"))
    return chain.tuned("axes", coulomb=v["force"], presliding=v["presliding"], alone=chosen(v, "axis"))


def _saturation(chain: Chain, v: Values) -> Chain:
    carried = v["carried"] * v["limit"] if chosen(v, "form") == 2 else 0.0
    soft = float(chosen(v, "form") == 1)
    return chain.tuned("axes", force_limit=v["limit"], soft=soft, carried=carried, windup=soft)


def _windup(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 1:
        return chain.tuned("axes", windup=v["share"])
    return chain.tuned("axes", force_limit=v["limit"], windup=v["running"], soft=float(chosen(v, "form") == 2))


def _stribeck(chain: Chain, v: Values) -> Chain:
    chain = chain.tuned("axes", stiction=v["stiction"], stribeck_speed=v["speed"], alone=chosen(v, "axis"))
    return chain.tuned("axes", coulomb=v["stiction"] * v["coulomb_share"], presliding=v["presliding"])


EFFECTS = (
    effect(
        "slew_limit", "actuator", ROBOT,
        "The rate of axis motion is limited.",
        "Slower trajectories, or a higher limit in the controller.",
        "trajectory generators' velocity limits; gap.md",
        (
            strength("span_time", "s", 3e-4, 50.0, 6.0, "time for 1 mm of an axis"),
            choice("form", 0, "of each axis", "of each axis, rounded as by a limited jerk", "of the tip, rounded",
                   "of each axis, by a planner that limits the acceleration, too"),
            shape("acceleration", "m/s^2", 0.02, 50.0, 1.0, "of the planner", log=True, only=(3,)),
            shape("rounding", "m", 1e-6, 2e-4, 2e-5, "way over which it is rounded", log=True, only=(1, 2)),
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
        "slides and position sensors; gap.md; greases thin by shear, Herschel and Bulkley 1926; Rayleigh 1876",
        (
            strength("drag", "N s/m", 0.02, 3e3, 200.0, "per axis", only=(0,)),
            strength("thinning", "N", 1e-4, 1.0, 0.05, "at 1 mm/s, per axis", only=(1,)),
            shape("power", "1", 0.2, 0.9, 0.5, "of the speed that it grows with", only=(1,)),
            strength("braking", "N", 1e-6, 5.0, 0.1, "at 10 mm/s, per axis", only=(2,)),
            shape("steepness", "1", 1.2, 3.0, 2.0, "power of the speed that it grows with", only=(2,)),
            choice("form", 0, "in proportion to its speed", "with a power of it, as grease thins",
                   "with its square, or about so, as air swirls"),
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
            strength("force", "N", 2e-4, 5.0, 0.4, "of one axis"),
            choice("form", 0, "abrupt where motion turns", "eased about standstill, as a tanh of the speed"),
            replace(_PRESLIDING, only=(0,)),
            shape("easing", "m/s", 1e-5, 2e-3, 1.5e-4, "speed within which it is eased", log=True, only=(1,)),
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
            strength("stiction", "N", 2e-4, 5.0, 0.5, "above the kinetic friction, at standstill"),
            shape("coulomb_share", "1", 0.0, 2.0, 0.5, "kinetic friction against that"),
            shape("speed", "m/s", 5e-5, 5e-3, 5e-4, "Stribeck speed", log=True),
            _PRESLIDING,
            _AXIS,
        ),
        _stribeck, extends=("coulomb_friction",),
    ),
    effect(
        "backlash", "actuator", ROBOT,
        "Play between an axis, behind its position sensor, and the platform, which no load moves within it.",
        "Preload the pivots with stiffer springs.",
        "vee-jewel pivots held by springs (M)",
        (
            strength("gap", "m", 1e-7, 6e-4, 80e-6, "full play of one axis"),
            choice("form", 0, "sharp", "taken up gradually", "of several joints in a row"),
            _AXIS,
            shape("spread", "1", 0.0, 1.0, 0.5, "by which the joints' plays differ from their mean", only=(2,)),
        ),
        _backlash,
    ),
    effect(
        "integral_windup", "actuator", ROBOT,
        "The integral term winds up while the force is limited, and empties late.",
        "Freeze the integrator while the output is limited.",
        "Åström & Hägglund, PID Controllers",
        (
            strength("limit", "N", 0.02, FORCE_LIMIT, 0.25, "force at which the output is limited", null=FORCE_LIMIT,
                     only=(0, 2)),
            shape("running", "1", 0.2, 1.0, 1.0, "share of the integration that goes on", only=(0, 2)),
            strength("share", "1", 1e-3, 1.0, 0.3, "of the integration that goes on", only=(1,)),
            choice("form", 0, "at a limit below the coil's", "at the coil's own limit",
                   "at a soft limit below the coil's, whose rest is taken off the integral in part"),
        ),
        _windup, extends=("force_saturation",),
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
