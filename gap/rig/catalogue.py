"""The generic effects, with their parameters: the library of any rig. Their laws are in `gap.rig.generic_laws`."""

from __future__ import annotations

import numpy as np

from gap.rig import generic_laws as laws
from gap.rig.generic import INITIAL, GenericEffect
from sim_devices.chain import Parameter


def _rel(name: str, low: float, high: float, unit: str = "signal", meaning: str = "") -> Parameter:
    return Parameter(
        name,
        unit,
        low,
        high,
        null=0.0,
        default=np.sqrt(max(low, 1e-3) * high),
        scale="log",
        meaning=meaning,
    )


FAINT = 1e-5
"""Of a signal: the least strength of what a rig integrates into a position, where it shows all the same."""


def _signed(name: str, size: float, unit: str = "signal", meaning: str = "") -> Parameter:
    return Parameter(name, unit, -size, size, null=0.0, default=0.2 * size, meaning=meaning)


def _shape(name: str, low: float, high: float, unit: str, meaning: str = "") -> Parameter:
    return Parameter(
        name,
        unit,
        low,
        high,
        null=None,
        default=np.sqrt(low * high),
        scale="log",
        meaning=meaning,
    )


def _between(name: str, low: float, high: float, meaning: str = "") -> Parameter:
    return Parameter(name, "1", low, high, null=None, default=0.5 * (low + high), meaning=meaning)


ASYMMETRY = _between("asymmetry", -0.5, 0.5, "how much stronger it is forwards")
SLOW = (
    _shape("tau", 3e-3, 10.0, "duration", "the longest of its times"),
    _between("exponent", 0.0, 1.2, "power of time; 0 is the logarithm"),
    _between("settled", 0.0, 1.0, "how far it had settled at the beginning"),
)
GENERIC: tuple[GenericEffect, ...] = (
    GenericEffect(
        "coulomb_friction",
        "dry friction: a constant force against the motion",
        "lubricate, or compensate in the controller",
        (
            _rel("level", FAINT, 1.0),
            _shape(
                "sharpness",
                1e-3,
                0.1,
                "velocity",
                "speed over which the sign is smoothed",
            ),
            ASYMMETRY,
        ),
        laws.coulomb,
        needs="velocity",
        resists=True,
    ),
    GenericEffect(
        "coulomb_friction",
        "dry friction that holds what a net force does not overcome, of something without inertia",
        "lubricate, or compensate in the controller",
        (_rel("level", FAINT, 1.0),),
        laws.breakaway,
        needs="velocity",
        resists=True,
        of_net=True,
        form="breakaway",
    ),
    GenericEffect(
        "stribeck_friction",
        "dry friction that holds at standstill with more than it has in motion, of something without inertia",
        "stiffer drive, dither",
        (_rel("level", FAINT, 1.0), _shape("excess", 0.03, 3.0, "1")),
        laws.breakaway,
        needs="velocity",
        resists=True,
        of_net=True,
        form="stick_slip",
    ),
    GenericEffect(
        "stribeck_friction",
        "dry friction that is higher near standstill",
        "stiffer drive, dither",
        (
            _rel("level", FAINT, 1.0),
            _shape("excess", 0.1, 3.0, "1"),
            _shape("stribeck_velocity", 1e-2, 0.5, "velocity"),
            ASYMMETRY,
        ),
        laws.stribeck,
        needs="velocity",
        resists=True,
    ),
    GenericEffect(
        "stribeck_friction",
        "friction of bristles that bend before they slide, higher near standstill",
        "stiffer drive, dither",
        (
            _rel("level", FAINT, 1.0),
            _shape("excess", 0.1, 3.0, "1"),
            _shape("stribeck_velocity", 1e-2, 0.5, "velocity"),
            _shape("presliding", 1e-3, 2.0, "position"),
            ASYMMETRY,
        ),
        laws.bristles,
        needs="position",
        beside="velocity",
        resists=True,
        of_turns=True,
        form="bristles",
    ),
    GenericEffect(
        "viscous_drag",
        "a force in proportion to the speed",
        "measure the drag with the rig unloaded",
        (_signed("coefficient", 1.0, "signal/velocity"),),
        laws.viscous,
        needs="velocity",
        resists=True,
    ),
    GenericEffect(
        "quadratic_drag",
        "a force with the square of the speed",
        "measure the drag with the rig unloaded",
        (_signed("coefficient", 5.0, "signal/velocity²"),),  # a nominal resistance may be the lesser part
        laws.quadratic_drag,
        needs="velocity",
        resists=True,
    ),
    GenericEffect(
        "quadratic_drag",
        "a force with a power of the speed of about two",
        "measure the drag with the rig unloaded",
        (
            _signed("force", 1.0, meaning="at the greatest speed"),
            _shape("speed", 0.99, 1.01, "velocity", "the greatest one"),  # free parameters have units of the rig alone
            _between("exponent", 1.4, 2.6, "power of the speed"),
        ),
        laws.power_drag,
        needs="velocity",
        resists=True,
        form="power_drag",
    ),
    GenericEffect(
        "cubic_stiffness",
        "a spring that hardens or softens with travel",
        "measure the force statically over the travel",
        (_signed("coefficient", 2.0, "signal/position³"),),
        laws.cubic,
        needs="position",
        resists=True,
    ),
    GenericEffect(
        "position_dependent_gain",
        "sensitivity that varies along the travel",
        "calibrate along the travel",
        (_signed("slope", 1.0, "1/position"),),
        laws.position_gain,
        needs="position",
    ),
    GenericEffect(
        "dahl_friction",
        "friction with elastic presliding",
        "preload or exchange the bearing",
        (
            _rel("level", FAINT, 1.0),
            _shape("presliding", 1e-3, 2.0, "position"),
            ASYMMETRY,
        ),
        laws.dahl,
        needs="position",
        resists=True,
        of_turns=True,
    ),
    GenericEffect(
        "hysteresis",
        "a rate-independent loop of the signal with itself",
        "close the loop on the output, or drive with charge",
        (
            _rel("level", FAINT, 0.5),  # below zero it would run ahead of its input: no material does
            _shape("width", 0.03, 1.0, "signal", "half the travel of a loop of full height"),
            _between("exponent", 0.0, 3.0, "how much less small loops have"),
            Parameter(INITIAL, "signal", -1.0, 1.0, None, 0.0, meaning="how far it had come to its first value"),
            _shape("bend", 0.1, 30.0, "signal", "about where it saturates"),
        ),
        laws.own_hysteresis,
        of_turns=True,
    ),
    GenericEffect(
        "backlash",
        "play: the output stands still until the gap is crossed",
        "preload the joint",
        (_rel("gap", FAINT, 0.5),),
        laws.backlash,
        of_turns=True,
    ),
    GenericEffect(
        "dead_zone",
        "no response about a centre",
        "move the working point, or compensate",
        (_rel("half_width", FAINT, 0.5), _signed("centre", 1.0)),
        laws.dead_zone,
    ),
    GenericEffect(
        "delay",
        "the signal is late by a constant time",
        "stamp at the source",
        (_rel("time", 0.01, 200.0, "dt"),),
        laws.delay,
    ),
    GenericEffect(
        "delay",
        "the signal is early: the other signals come late",
        "stamp at the source",
        (_rel("time", 0.01, 200.0, "dt"),),
        laws.advance,
        form="advance",
        looks_ahead=True,
    ),
    GenericEffect(
        "low_pass",
        "a first-order lag",
        "a faster sensor or filter",
        (_rel("tau", 0.02, 500.0, "dt"),),
        laws.low_pass,
    ),
    GenericEffect(
        "low_pass",
        "a lag of second order, without overshoot",
        "a faster sensor or filter",
        (_rel("tau", 0.02, 500.0, "dt", "both its times together"),),
        laws.two_lags,
        form="second_order_low_pass",
    ),
    GenericEffect(
        "leak",
        "a held value bleeds away",
        "find and seal the leak",
        (
            _rel("share", 1e-3, 1.0, "1"),
            _shape("tau", 0.01, 3.0, "duration"),
            _shape(
                "refill",
                3e-3,
                10.0,
                "signal",
                "how far the signal moves until the leaked part is made good",
            ),
        ),
        laws.leak,
    ),
    GenericEffect(
        "creep",
        "a slow delayed response",
        "wait longer, or model the slow mode",
        (
            _rel("share", 1e-3, 3.0, "1"),
            *SLOW,
        ),
        laws.creep,
    ),
    GenericEffect(
        "creep",
        "a held value slackens: relaxation",
        "wait longer, or model the slow mode",
        (_rel("share", 1e-3, 0.95, "1"), *SLOW),
        laws.relaxation,
        form="relaxation",
    ),
    GenericEffect(
        "saturation",
        "the signal stops at an upper limit",
        "a larger range, or smaller commands",
        (Parameter("limit", "level", 0.3, 1.5, null=None, default=0.9),),
        laws.saturation,
    ),
    GenericEffect(
        "saturation",
        "the signal stops at a limit, the same both ways",
        "a larger range, or smaller commands",
        (Parameter("limit", "size", 0.3, 1.5, null=None, default=0.9),),
        laws.symmetric_saturation,
        form="symmetric_saturation",
    ),
    GenericEffect(
        "lower_saturation",
        "the signal stops at a lower limit",
        "a larger range, or smaller commands",
        (Parameter("limit", "level", -0.5, 0.7, null=None, default=0.1),),
        laws.lower_saturation,
    ),
    GenericEffect(
        "drift",
        "a slow run of the signal with time",
        "warm up, take zeros between runs",
        (_signed("rate", 0.5, "signal/duration"),),
        laws.drift,
    ),
    GenericEffect(
        "drift",
        "a slow run of the signal towards a limit, as in warming up",
        "warm up, take zeros between runs",
        (_signed("amount", 0.5), _shape("tau", 0.05, 3.0, "duration")),
        laws.warming,
        form="warming",
    ),
    GenericEffect(
        "quadratic_error",
        "a bent characteristic",
        "calibrate at more than two points",
        (
            _signed("coefficient", 0.5, "1/signal"),
            Parameter("odd", "1", 0.0, 1.0, null=None, default=0.0),
        ),
        laws.quadratic_error,
    ),
    GenericEffect(
        "quadratic_error",
        "a characteristic that is a power of the signal beyond a knee",
        "calibrate at more than two points",
        (_signed("exponent", 1.0, "1"), _shape("knee", 0.01, 1.0, "signal")),
        laws.power_error,
        form="power_error",
    ),
    GenericEffect(
        "gain",
        "wrong sensitivity",
        "calibrate",
        (_signed("error", 0.5, "1"),),
        laws.gain,
    ),
    GenericEffect(
        "offset",
        "a constant error",
        "zero the sensor",
        (_signed("value", 0.5),),
        laws.offset,
    ),
    GenericEffect(
        "quantisation",
        "coarse steps",
        "a finer converter or range",
        (_rel("step", 2e-3, 0.1),),
        laws.quantisation,
    ),
    GenericEffect(
        "slew_limit",
        "the rate of change is limited",
        "smaller or slower commands",
        (_shape("rate", 1e-3, 1.0, "rate", "of the fastest that the signal would be"),),
        laws.slew,
    ),
    GenericEffect(
        "preconditioning",
        "the first loadings differ from later ones",
        "precondition before the measurement",
        (_signed("change", 0.5, "1"), _shape("settling", 0.01, 0.5, "duration")),
        laws.preconditioning,
    ),
    GenericEffect(
        "crosstalk",
        "another signal leaks into this one",
        "shield, or calibrate the full matrix",
        (_signed("share", 0.5, "signal/other"),),
        laws.crosstalk,
        needs="other",
    ),
    GenericEffect(
        "crosstalk",
        "another signal comes through to this one, late",
        "insulate, or calibrate the full matrix",
        (_signed("share", 0.5, "signal/other"), _shape("tau", 1e-2, 2.0, "duration")),
        laws.slow_crosstalk,
        needs="other",
        form="slow_crosstalk",
    ),
)
