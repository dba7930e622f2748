"""Effect forms of the micro-robot; each line names the concept, the form, its knob and its strengths (SI)."""

from __future__ import annotations

from .effects_suction import TIMING as SUCTION_TIMING
from .forms import Draw, Form

ROBOT = ("microrobot",)
LEG = range(0, 3)
FIBRE = (0.0, 6.28)


def _book(concept: str, name: str, knob: str, strong: float, **draws: Draw) -> Form:
    return Form(concept, name, False, knob, strong, draws, instruments=ROBOT)


def _own(concept: str, name: str, knob: str, strong: float, **draws: Draw) -> Form:
    return Form(concept, name, True, knob, strong, draws, instruments=ROBOT)


def _steps(own: bool, concept: str, name: str, knob: str, *steps: float, **draws: Draw) -> Form:
    return Form(concept, name, own, knob, max(steps), draws, steps=steps, instruments=ROBOT)


TIMING = tuple(Form(**{**f.__dict__, "instruments": ROBOT}) for f in SUCTION_TIMING if f.concept != "desynchronisation")

ACTUATOR = (
    _book("slew_limit", "hard", "1/slew", 1 / 1.5e-4),
    _own("slew_limit", "soft", "1/slew_soft", 1 / 1.5e-4),
    _book("force_saturation", "hard", "1/limit", 1 / 0.05),
    _own("force_saturation", "soft", "1/soft", 1 / 0.05),
    _book("viscous_drag", "linear", "drag", 3e3),
    _own("viscous_drag", "thinning", "thin", 5.0),
    _book("coulomb_friction", "Coulomb", "dry", 1.5),
    _own("coulomb_friction", "bristles", "dry", 1.5, friction_law=3.0, bristle=(3e-6, 4e-5)),
    _own("coulomb_friction", "one axis", "dry_one", 1.5, axis=LEG),
    _book(
        "stribeck_friction",
        "exponential",
        "stribeck",
        1.5,
        friction_law=1.0,
        stribeck_speed=(1e-4, 1e-3),
        dry_share=0.5,
    ),
    _own(
        "stribeck_friction",
        "hyperbolic",
        "stribeck",
        1.5,
        friction_law=2.0,
        stribeck_speed=(1e-4, 1e-3),
        dry_share=0.4,
    ),
    _book("backlash", "play", "backlash", 4e-4),
    _own("backlash", "soft play", "backlash_soft", 4e-4),
    _book("integral_windup", "unclamped", "1/limit", 1 / 0.05, windup=1.0),
    _own("integral_windup", "slow emptying", "1/limit", 1 / 0.05, windup=0.5),
    _book("position_dependent_force_constant", "parabola", "vary", 5.0),
    _own("position_dependent_force_constant", "one-sided", "one_sided", 2.0),
)

INTERFACE = (
    _book("glue_compliance", "elastic", "glue", 1.2e-3),
    _own("glue_compliance", "creeping", "glue_creeping", 1.2e-3),
    _book("support_slip", "slider", "slip", 0.9, slip_at=(0.2, 0.7)),
    _own("support_slip", "gradual", "slip_gradual", 0.9),
)

TISSUE = (
    _book("slow_creep", "mode", "creep", 0.6, creep_tau=(30, 150)),
    _own("slow_creep", "one way", "creep_oneway", 0.6, creep_tau=(25, 100)),
    _book("power_law_creep", "fractional", "power_creep", 0.1),
    _own("power_law_creep", "logarithmic", "log_creep", 0.1),
    _book("viscoplastic_residual", "Perzyna", "residual", 0.6),
    _own("viscoplastic_residual", "power law", "residual_power", 0.8),
    _book("preconditioning", "by number", "first_loadings", 0.5, series=(0.6, 2.0)),
    _own("preconditioning", "by direction", "mullins", 0.5, softening=(2, 8)),
    _book("missing_deep_layer", "kink", "deep", 2.0, deep_at=(0.4, 0.85)),
    _own("missing_deep_layer", "viscous bend", "deep_smooth", 2.0, deep_at=(0.4, 0.85)),
    _book("prestress_anisotropy", "cubic", "tension", 1.0, fibre=FIBRE),
    _own("prestress_anisotropy", "slack fibres", "tension_slack", 1.0, fibre=FIBRE),
    _book("sub_dermal_tether", "one-sided spring", "tether", 1.0, fibre=FIBRE, tether_slack=(0.05, 0.4)),
    _own("sub_dermal_tether", "exponential", "tether_exp", 1.0, fibre=FIBRE),
    _book("strain_stiffening", "quartic", "stiffen", 0.8),
    _own("strain_stiffening", "locking", "locking", 0.8),
    _book("pulse_breathing", "pulse", "pulse", 0.1, pulse_hz=(0.9, 1.5), pulse_phase=(0, 6)),
    _own("pulse_breathing", "breath", "breath", 0.1, pulse_hz=(0.2, 0.35), pulse_phase=(0, 3)),
    _book("muscle_tone_change", "drift", "±tone", 0.6),
    _own("muscle_tone_change", "change", "±tone_step", 0.6, tone_at=(0.25, 0.75), tone_width=(0.5, 10)),
)

SENSOR = (
    _book("sensor_gain", "one transducer", "±leg_gain", 0.4, leg=LEG),
    _own("sensor_gain", "all transducers", "±leg_gains", 0.4, leg=LEG),
    _book("sensor_offset", "constant", "±offset", 0.3, leg=LEG),
    _own("sensor_offset", "jump", "±offset_jump", 0.3, leg=LEG, jump_at=(0.1, 0.8)),
    _book("sensor_drift", "linear", "±drift", 0.2, leg=LEG),
    _own("sensor_drift", "warming up", "±warm_up", 0.3, leg=LEG, warm_tau=(20, 100)),
    _book("quadratic_error", "square", "±leg_square", 0.3),
    _own("quadratic_error", "position scale", "±scale_waves", 2e-4, axis=LEG, wave_phase=(0, 6)),
    _book("sensor_saturation", "top", "1/ceiling", 1 / 0.05),
    _own("sensor_saturation", "preload used up", "1/unloaded", 1 / 0.08),
    _book("sensor_quantisation", "transducers", "leg_coarse", 0.3),
    _own("sensor_quantisation", "uneven", "leg_coarse_uneven", 0.3),
    _own("sensor_quantisation", "position", "axis_coarse", 3e-4),
    _book("sensor_hysteresis", "play", "leg_play", 0.1),
    _own("sensor_hysteresis", "bristles", "leg_bristle", 0.1),
    _book("sensor_low_pass", "first order", "low_pass", 2.0),
    _own("sensor_low_pass", "second order", "low_pass_twice", 2.0),
    _book("crosstalk", "transducer to transducer", "±leg_into_leg", 0.4, leg=LEG),
    _own("crosstalk", "position into transducer", "±axis_into_leg", 0.3, leg=LEG),
    _book("misalignment", "about the axis", "±turned", 0.4),
    _own("misalignment", "leaning", "±leaning", 0.4),
    _book("wrong_geometry", "h", "±h_error", 0.4),
    _own("wrong_geometry", "w", "±w_error", 0.4),
    _book("gravity_load", "head mass", "head_mass", 0.15),
    _own("gravity_load", "overhanging head", "head_overhang", 0.15),
)

PROCESSING = (
    _steps(False, "matrix_sign", "one element", "matrix_sign", 1.0, row=range(0, 2), leg=[0.0, 2.0]),
    _steps(True, "matrix_sign", "one row", "row_sign", 1.0, row=LEG),
    _steps(False, "axis_swap", "transducers", "legs_swapped", 1.0),
    _steps(True, "axis_swap", "axes", "axes_swapped", 1.0),
    _book("wrong_zeroing", "tared under load", "tare_late", 3.0),
    _own("wrong_zeroing", "each recording anew", "tare_each", 3.0),
    _steps(False, "wrong_unit", "grams", "unit_force", 1.0197, 0.980665, 9.80665, 0.224809),
    _steps(True, "wrong_unit", "one recording", "unit_force", 1.0197, 0.980665, 9.80665, unit_only=range(0, 4)),
    _steps(True, "wrong_unit", "probe", "unit_probe", 25 / 25.4, 2.0, 10.0),
)

OUTSIDE = (
    _own("unknown_cable_drag", "elastic and dry", "cable", 0.2, leg=LEG),
    _own("unknown_cogging", "detent force", "cogging", 1.0, cog_pitch=(4e-4, 2e-3)),
    _own("unknown_flexure", "arm bends", "flexure", 1e-3),
    _own("unknown_binding", "slides bind under load", "binding", 2.0),
    _own("unknown_restless", "subject moves", "restless", 3e-4),
    _own("unknown_expansion", "frame warms", "expansion", 5e-4),
    _own("unknown_coil_heating", "force constant fades", "heating", 20.0),
    _own("unknown_hum", "interference", "hum", 0.1, leg=LEG, hum_hz=(2, 20)),
)

FORMS = TIMING + ACTUATOR + INTERFACE + TISSUE + SENSOR + PROCESSING
