"""Public names of the effect concepts: the generator hides them and the scorer compares them.

One name per concept, not per formula: ``regulator_lag`` is any sluggish pressure regulation, whatever its
equation. The diagnosis' effect library uses the same names (or maps its own onto these).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Stage = Literal["timing", "actuator", "interface", "tissue", "sensor", "processing"]
Instrument = Literal["cutometer", "aspiration", "microrobot"]

INSTRUMENTS: tuple[Instrument, ...] = ("cutometer", "aspiration", "microrobot")
STAGES: tuple[Stage, ...] = ("timing", "actuator", "interface", "tissue", "sensor", "processing")
UNKNOWN = "unknown"
"""Truth of a tier-T5 case: the effect is deliberately outside this vocabulary."""


@dataclass(frozen=True)
class Concept:
    """An effect concept: its name, the stage it acts in, the instruments that can have it, and its meaning."""

    name: str
    stage: Stage
    instruments: frozenset[Instrument]
    meaning: str


_ALL = "cutometer aspiration microrobot"
_SUCTION = "cutometer aspiration"
_TABLE: tuple[tuple[Stage, str, str, str], ...] = (
    ("timing", "latency", _ALL, "commands take effect late by a constant dead time"),
    ("timing", "clock_skew", _ALL, "the recording's clock runs fast or slow against the command clock"),
    ("timing", "late_samples", _ALL, "some samples are delivered late: older values under newer stamps"),
    ("timing", "dropped_samples", _ALL, "samples are lost and the last value is repeated, or the time axis closes up"),
    ("timing", "desynchronisation", _SUCTION, "height (image or optics) lags or leads the pressure channel"),
    ("timing", "jitter", _ALL, "true sampling instants scatter about the stamped ones"),
    ("actuator", "regulator_lag", _SUCTION, "pressure follows its command more slowly than nominal"),
    ("actuator", "slew_limit", _ALL, "the rate of pressure (or of axis motion) is limited"),
    ("actuator", "overshoot", _SUCTION, "under-damped pressure regulation"),
    (
        "actuator",
        "leak",
        _SUCTION,
        "flow past the regulator: pressure falls short of its command, more at high suction",
    ),
    ("actuator", "reservoir_depletion", _SUCTION, "suction sags as the vacuum store empties"),
    ("actuator", "dead_band", _SUCTION, "the valve ignores small pressure errors"),
    ("actuator", "gauge_offset", _SUCTION, "the gauge that closes the loop and is recorded reads a constant too much"),
    ("actuator", "gauge_gain", _SUCTION, "the gauge that closes the loop and is recorded has a wrong sensitivity"),
    ("actuator", "force_saturation", "microrobot", "voice-coil force (current) is limited"),
    ("actuator", "viscous_drag", "microrobot", "drag of an axis in proportion to its speed"),
    ("actuator", "coulomb_friction", "microrobot", "dry friction of an axis, constant against motion"),
    ("actuator", "stribeck_friction", "microrobot", "dry friction that is higher near standstill"),
    ("actuator", "backlash", "microrobot", "play between axis and platform"),
    ("actuator", "integral_windup", "microrobot", "the integral term winds up and empties late"),
    ("actuator", "position_dependent_force_constant", "microrobot", "coil force per ampere varies along the stroke"),
    ("interface", "spring_preload", "cutometer", "probe spring bulges the skin before the zero is taken"),
    ("interface", "rim_friction", _SUCTION, "skin sticks and slips on the probe's rim"),
    ("interface", "rim_leak", _SUCTION, "air leaks under the rim: skin sees less suction than the gauge"),
    ("interface", "probe_tilt", _SUCTION, "the probe stands askew on the skin"),
    ("interface", "probe_recoil", _SUCTION, "the probe is drawn into the skin by its own suction"),
    ("interface", "glue_compliance", "microrobot", "the glue between probe and skin yields"),
    ("interface", "support_slip", "microrobot", "skin slips under the support plate beyond a load"),
    ("tissue", "slow_creep", _ALL, "a slow relaxation mode that the nominal tissue lacks"),
    ("tissue", "power_law_creep", _ALL, "fractional (power-law) memory"),
    ("tissue", "viscoplastic_residual", _ALL, "deformation that stays after unloading"),
    ("tissue", "preconditioning", _ALL, "the first loadings differ from later ones"),
    ("tissue", "missing_deep_layer", _ALL, "a deeper layer takes part once deformation reaches it"),
    ("tissue", "prestress_anisotropy", "microrobot", "in-plane tension differs between directions"),
    ("tissue", "sub_dermal_tether", "microrobot", "a one-sided tether: stiffer one way than the opposite"),
    ("tissue", "strain_stiffening", _ALL, "stiffening with deformation beyond the nominal curve"),
    ("tissue", "pulse_breathing", _ALL, "periodic motion by heart beat or breath"),
    ("tissue", "muscle_tone_change", _ALL, "stiffness changes during the session"),
    ("sensor", "sensor_gain", "cutometer microrobot", "wrong sensitivity of height (or of one transducer)"),
    ("sensor", "sensor_offset", _ALL, "constant error of height (or of one transducer or position sensor)"),
    ("sensor", "sensor_drift", _ALL, "reading wanders slowly with time (temperature)"),
    ("sensor", "quadratic_error", _ALL, "non-linear sensor characteristic"),
    ("sensor", "sensor_saturation", _ALL, "reading stops at a limit"),
    ("sensor", "sensor_quantisation", _ALL, "coarser steps than the nominal resolution"),
    ("sensor", "sensor_hysteresis", _ALL, "reading depends on the direction of change"),
    ("sensor", "sensor_low_pass", _ALL, "the sensor's own lag or filter"),
    ("sensor", "crosstalk", _ALL, "one channel leaks into another"),
    ("sensor", "misalignment", "aspiration microrobot", "sensor axes are rotated against the instrument's"),
    ("sensor", "wrong_geometry", "microrobot", "h or w of the force matrix is not the real one"),
    ("sensor", "threshold_bias", "aspiration", "grey-value threshold set too high or too low"),
    ("sensor", "lens_distortion", "aspiration", "radial image distortion"),
    ("sensor", "scale_error", _SUCTION, "millimetres per pixel (or the height calibration) are wrong"),
    ("sensor", "illumination_drift", _SUCTION, "the light source fades or warms up"),
    ("sensor", "gravity_load", "microrobot", "the moving head's weight enters the transducers as it tilts"),
    ("processing", "matrix_sign", "microrobot", "a sign of the force matrix is wrong"),
    ("processing", "axis_swap", "microrobot", "two channels are exchanged"),
    ("processing", "wrong_zeroing", _ALL, "zero taken at the wrong moment, or at each recording anew"),
    ("processing", "wrong_unit", _ALL, "a channel converted with the wrong unit"),
)


def _instruments(words: str) -> frozenset[Instrument]:
    return frozenset(i for i in INSTRUMENTS if i in words.split())


CONCEPTS: dict[str, Concept] = {
    name: Concept(name, stage, _instruments(instruments), meaning) for stage, name, instruments, meaning in _TABLE
}


def concepts_of(instrument: Instrument) -> tuple[str, ...]:
    """Names of the effect concepts that ``instrument`` can have, in stage order."""
    return tuple(c.name for c in CONCEPTS.values() if instrument in c.instruments)


def stage_of(name: str) -> Stage:
    """Stage in which concept ``name`` acts. Raises KeyError for a name outside the vocabulary."""
    return CONCEPTS[name].stage
