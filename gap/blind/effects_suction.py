"""Effect forms of the suction instruments; each line names the concept, the form, its knob and its strengths (SI)."""

from __future__ import annotations

from .forms import Draw, Form

CUT, ASP = ("cutometer",), ("aspiration",)


def _book(concept: str, name: str, knob: str, strong: float, **draws: Draw) -> Form:
    return Form(concept, name, False, knob, strong, draws)


def _own(concept: str, name: str, knob: str, strong: float, **draws: Draw) -> Form:
    return Form(concept, name, True, knob, strong, draws)


def _sized(own: bool, concept: str, name: str, knob: str, strong: float, **draws: Draw) -> Form:
    """A form whose strength is a length, given for the Cutometer's heights."""
    return Form(concept, name, own, knob, strong, draws, length=True)


def _only(instruments: tuple[str, ...], form: Form) -> Form:
    return Form(**{**form.__dict__, "instruments": instruments})


def _steps(own: bool, concept: str, name: str, knob: str, *steps: float, **draws: Draw) -> Form:
    return Form(concept, name, own, knob, max(steps), draws, steps=steps)


LATER = range(1, 4)

TIMING = (
    _book("latency", "dead time", "latency", 0.8),
    _own("latency", "polled", "poll", 1.5),
    _book("clock_skew", "constant", "±skew", 0.02),
    _own("clock_skew", "wandering", "±skew_wander", 0.05, skew_period=(60, 200)),
    _book("late_samples", "random", "late", 0.5),
    _own("late_samples", "bursts", "late_burst", 0.05, burst_length=range(2, 8), burst_depth=range(1, 6)),
    _book("dropped_samples", "repeated", "drop", 0.5),
    _own("dropped_samples", "closed up", "drop_gap", 0.1, gap_length=range(1, 4)),
    _book("desynchronisation", "constant", "±lag_height", 0.6),
    _own("desynchronisation", "growing", "lag_growing", 0.6),
    _book("jitter", "normal", "jitter", 0.1),
    _own("jitter", "beating", "beat", 0.2, beat_ratio=(0.05, 0.45)),
)

ACTUATOR = (
    _book("regulator_lag", "first order", "lag", 3.0),
    _own("regulator_lag", "hose", "lag_cascade", 3.0),
    _own("regulator_lag", "uneven", "lag_fall", 3.0, lag_ratio=[0.3, 3.0]),
    _own("regulator_lag", "two paths", "lag_parallel", 5.0, lag_share=(0.15, 0.5)),
    _book("slew_limit", "hard", "1/slew", 1 / 3e3),
    _own("slew_limit", "soft", "1/slew", 1 / 3e3, slew_soft=1.0),
    _book("overshoot", "under-damped", "underdamped", 0.9),
    _own("overshoot", "lead", "lead", 0.15),
    _book("leak", "linear", "leak", 8.0),
    _own("leak", "orifice", "leak_root", 800.0),
    _own("leak", "lifting valve", "leak_late", 15.0, leak_at=(60e2, 150e2)),
    _book("reservoir_depletion", "sag", "sag", 0.6, sag_tau=(4, 15)),
    _own("reservoir_depletion", "store", "store_use", 3e-6, store_refill=(15, 60), store_margin=(1.0, 1.3)),
    _book("dead_band", "dead zone", "band", 60e2),
    _own("dead_band", "sleeping valve", "sleep", 80e2),
    _book("gauge_offset", "recorded", "±gauge_offset", 60e2),
    _own("gauge_offset", "zero shift", "±gauge_shift", 60e2, from_recording=LATER),
    _own("gauge_offset", "in the loop", "±loop_offset", 60e2),
    _book("gauge_gain", "recorded", "±gauge_gain", 0.3),
    _own("gauge_gain", "two slopes", "±gauge_gain_high", 0.4),
)

INTERFACE = (
    _only(CUT, _book("spring_preload", "constant", "preload", 150e2)),
    _only(CUT, _own("spring_preload", "relaxing", "preload_fading", 150e2)),
    _book("rim_friction", "constant play", "stick", 100e2),
    _own("rim_friction", "Coulomb", "stick_coulomb", 0.4),
    _own("rim_friction", "bristles", "stick_bristle", 0.4, bristle_scale=(10e2, 40e2)),
    _book("rim_leak", "growing", "rim_leak", 0.45),
    _own("rim_leak", "sealing", "rim_sealing", 0.9, seal_at=(30e2, 100e2)),
    _sized(False, "probe_tilt", "seating", "tilt", 1.2e-4, seat_at=(15e2, 80e2)),
    _sized(True, "probe_tilt", "rocking flat", "tilt_seating", 1.2e-4, seat_at=(15e2, 80e2)),
    _sized(False, "probe_recoil", "spring", "recoil", 3e-4),
    _sized(True, "probe_recoil", "damped", "recoil_damped", 3e-4, recoil_stop=(0.4, 1.2), recoil_tau=(0.05, 0.6)),
)

TISSUE = (
    _book("slow_creep", "mode", "creep", 1.5, creep_tau=(30, 150)),
    _own("slow_creep", "one way", "creep_oneway", 1.5, creep_tau=(25, 100)),
    _book("power_law_creep", "fractional", "power_creep", 1.0, alpha=(0.1, 0.35)),
    _own("power_law_creep", "logarithmic", "log_creep", 0.3),
    _book("viscoplastic_residual", "Perzyna", "residual", 0.6, yield_at=(0.2, 0.6)),
    _own("viscoplastic_residual", "by work", "residual_work", 2.0),
    _book("preconditioning", "by number", "first_loadings", 0.6, series=(0.6, 2.0)),
    _own("preconditioning", "by work", "mullins", 0.5, softening=(6, 30)),
    _book("missing_deep_layer", "kink", "deep", 0.8, deep_at=(0.4, 0.9)),
    _own("missing_deep_layer", "viscous bend", "deep_smooth", 0.8, deep_at=(0.4, 0.9)),
    _book("strain_stiffening", "quadratic", "stiffen", 0.8),
    _own("strain_stiffening", "locking", "locking", 1.5),
    _sized(False, "pulse_breathing", "pulse", "pulse", 1e-4, pulse_hz=(0.9, 1.5), pulse_phase=(0, 6)),
    _sized(False, "pulse_breathing", "breath", "pulse", 1e-4, pulse_hz=(0.2, 0.35), pulse_phase=(0, 6)),
    _sized(True, "pulse_breathing", "wave form", "breath", 1e-4, pulse_hz=(0.2, 0.35), pulse_phase=(0, 3)),
    _book("muscle_tone_change", "drift", "±tone", 0.6),
    _own("muscle_tone_change", "change", "±tone_step", 0.6, tone_at=(0.25, 0.75), tone_width=(0.5, 10)),
)

SENSOR = (
    _only(CUT, _book("sensor_gain", "constant", "±gain", 0.3)),
    _only(CUT, _own("sensor_gain", "from a recording on", "±gain_later", 0.5, from_recording=LATER)),
    _sized(False, "sensor_offset", "constant", "±offset", 1e-4),
    _sized(True, "sensor_offset", "jump", "±offset_jump", 1e-4, jump_at=(0.1, 0.8)),
    _sized(False, "sensor_drift", "linear", "±drift", 1e-3),
    _sized(True, "sensor_drift", "warming up", "±warm_up", 3e-4, warm_tau=(4, 20)),
    _sized(True, "sensor_drift", "wandering", "walk", 1e-4),
    _book("quadratic_error", "square", "±quadratic", 0.4),
    _own("quadratic_error", "waves", "±waves", 0.2, wave_number=(0.6, 1.6)),
    _sized(False, "sensor_saturation", "hard", "1/ceiling", 1 / 5e-5),
    _sized(True, "sensor_saturation", "soft", "1/soft_ceiling", 1 / 5e-5),
    _sized(False, "sensor_quantisation", "rounding", "coarse", 1.5e-4),
    _sized(True, "sensor_quantisation", "uneven", "coarse_uneven", 1.5e-4),
    _sized(False, "sensor_hysteresis", "play", "play_height", 6e-5),
    _sized(True, "sensor_hysteresis", "bristles", "preisach", 6e-5),
    _book("sensor_low_pass", "first order", "low_pass", 2.0),
    _own("sensor_low_pass", "second order", "low_pass_twice", 2.0),
    _sized(False, "crosstalk", "pressure into height", "±from_pressure", 2e-4),
    _own("crosstalk", "height into pressure", "±from_height", 1e4),
    _sized(True, "crosstalk", "flow into height", "±from_flow", 2e-4),
    _only(ASP, _book("misalignment", "tilted camera", "askew", 0.7)),
    _only(ASP, _own("misalignment", "foreshortened", "askew_foreshortened", 0.7)),
    _only(ASP, _sized(False, "threshold_bias", "rim", "±edge", 1e-4)),
    _only(ASP, _sized(True, "threshold_bias", "shaded rim", "±edge_shaded", 1e-4)),
    _only(ASP, _book("lens_distortion", "cubic", "±barrel", 0.3, centre=(0, 1))),
    _only(ASP, _own("lens_distortion", "division", "±barrel_division", 0.3, centre=(0, 1))),
    _book("scale_error", "constant", "±gain", 0.3),
    _own("scale_error", "after refocusing", "±gain_later", 0.5, from_recording=LATER),
    _book("illumination_drift", "fading", "fading", 0.2),
    _own("illumination_drift", "lamp", "lamp", 0.5, lamp_tau=(2, 15)),
)

PROCESSING = (
    _book("wrong_zeroing", "late", "zero_late", 1.5),
    _own("wrong_zeroing", "averaged too long", "zero_mean", 3.0),
    _steps(False, "wrong_unit", "pressure", "unit_pressure", 0.980665, 1.01325, 1.33322, 0.75006, 0.1),
    _steps(True, "wrong_unit", "height", "unit_height", 25 / 25.4, 1.125, 0.9, 2.0, unit_only=range(0, 4)),
    _steps(
        True, "wrong_unit", "one recording", "unit_pressure", 0.980665, 1.01325, 1.33322, 0.1, unit_only=range(0, 4)
    ),
)

OUTSIDE = (
    _own("unknown_pump_ripple", "ripple", "pump_ripple", 0.1, ripple_hz=(2.0, 8.0)),
    _own("unknown_condensate", "drops", "condensate", 0.5),
    _own("unknown_adiabatic", "heat of compression", "adiabatic", 0.3, adiabatic_tau=(0.5, 3.0)),
    _sized(True, "unknown_restless", "subject moves", "restless", 1e-4),
    _own("unknown_sweat", "softening by sweat", "sweat", 0.8),
    _own("unknown_blood", "vessels fill", "blood", 0.5, blood_tau=(2, 12)),
    _sized(True, "unknown_hum", "interference", "hum", 1e-4, hum_hz=(2, 11), hum_phase=(0, 6)),
    _own("unknown_fog", "fogged window", "fog", 0.5),
)

FORMS = TIMING + ACTUATOR + INTERFACE + TISSUE + SENSOR + PROCESSING
