"""Effects of the suction instruments: each form turns one strength into knobs of the chain.

A concept of the vocabulary has a textbook form (``own=False``, tier T1) and at least one of its own (tiers T2 up).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .vocabulary import UNKNOWN

Knobs = dict[str, float]
Random = np.random.Generator


@dataclass(frozen=True)
class Form:
    """One form of an effect.

    ``knobs(strength, rng)`` gives the chain's knobs; strength runs from ``weak`` to ``strong`` (what is physically
    plausible). ``sizes`` marks strengths in metres that scale with the instrument's heights (the aspiration's are
    seven times the Cutometer's). ``steps`` lists the only strengths there are, for effects that are or are not.
    """

    concept: str
    name: str
    own: bool
    weak: float
    strong: float
    knobs: Callable[[float, Random], Knobs]
    sizes: bool = False
    steps: tuple[float, ...] = ()
    instruments: tuple[str, ...] = ("cutometer", "aspiration")

    @property
    def known(self) -> bool:
        """Whether the concept is in the public vocabulary."""
        return not self.concept.startswith(UNKNOWN)


def _one(knob: str) -> Callable[[float, Random], Knobs]:
    return lambda a, r: {knob: a}


def _sign(r: Random) -> float:
    return 1.0 if r.random() < 0.5 else -1.0


def _signed(knob: str) -> Callable[[float, Random], Knobs]:
    return lambda a, r: {knob: a * _sign(r)}


_CUT, _ASP = ("cutometer",), ("aspiration",)
_LATER: Callable[[Random], float] = lambda r: float(r.integers(1, 4))

TIMING = (
    Form("latency", "dead time", False, 1e-3, 0.8, _one("latency")),
    Form("latency", "polled", True, 4e-3, 1.5, _one("poll")),
    Form("clock_skew", "constant", False, 1e-6, 0.02, _signed("skew")),
    Form("clock_skew", "wandering", True, 1e-6, 0.05, lambda a, r: {"skew_wander": a * _sign(r), "skew_period": r.uniform(60, 200)}),
    Form("late_samples", "random", False, 1e-3, 0.5, _one("late")),
    Form("late_samples", "bursts", True, 3e-4, 0.1, lambda a, r: {"late_burst": a, "burst_length": r.integers(2, 8), "burst_depth": r.integers(1, 6)}),
    Form("dropped_samples", "repeated", False, 1e-3, 0.5, _one("drop")),
    Form("dropped_samples", "closed up", True, 3e-4, 0.1, lambda a, r: {"drop_gap": a, "gap_length": r.integers(1, 4)}),
    Form("desynchronisation", "constant", False, 5e-4, 0.6, _signed("lag_height")),
    Form("desynchronisation", "growing", True, 5e-4, 0.6, _one("lag_growing")),
    Form("jitter", "normal", False, 3e-4, 0.1, _one("jitter")),
    Form("jitter", "beating", True, 1e-3, 0.2, lambda a, r: {"beat": a, "beat_ratio": r.uniform(0.05, 0.45)}),
)

ACTUATOR = (
    Form("regulator_lag", "first order", False, 1e-3, 3.0, _one("lag")),
    Form("regulator_lag", "hose", True, 1e-3, 3.0, _one("lag_cascade")),
    Form("regulator_lag", "slow exhaust", True, 1e-3, 3.0, lambda a, r: {"lag_fall": a, "lag_ratio": r.choice([0.3, 3.0])}),
    Form("regulator_lag", "two paths", True, 5e-3, 5.0, lambda a, r: {"lag_parallel": a, "lag_share": r.uniform(0.15, 0.5)}),
    Form("slew_limit", "hard", False, 1 / 2e6, 1 / 3e3, lambda a, r: {"slew": 1 / a}),
    Form("slew_limit", "soft", True, 1 / 2e6, 1 / 3e3, lambda a, r: {"slew": 1 / a, "slew_soft": 1.0}),
    Form("overshoot", "under-damped", False, 1e-3, 0.9, _one("underdamped")),
    Form("overshoot", "lead", True, 1e-4, 0.15, _one("lead")),
    Form("leak", "linear", False, 1e-4, 8.0, _one("leak")),
    Form("leak", "orifice", True, 1e-3, 800.0, _one("leak_root")),
    Form("leak", "lifting valve", True, 1e-4, 15.0, lambda a, r: {"leak_late": a, "leak_at": r.uniform(60e2, 150e2)}),
    Form("reservoir_depletion", "sag", False, 1e-5, 0.6, lambda a, r: {"sag": a, "sag_tau": r.uniform(4, 15)}),
    Form("reservoir_depletion", "store", True, 1e-7, 3e-6, lambda a, r: {"store_use": a, "store_refill": r.uniform(15, 60), "store_capacity": r.uniform(4.6e4, 5.5e4)}),
    Form("dead_band", "dead zone", False, 1.0, 60e2, _one("band")),
    Form("dead_band", "sleeping valve", True, 10.0, 80e2, _one("sleep")),
    Form("gauge_offset", "recorded", False, 0.5, 60e2, _signed("gauge_offset")),
    Form("gauge_offset", "zero shift", True, 0.5, 60e2, lambda a, r: {"gauge_shift": a * _sign(r), "from_recording": _LATER(r)}),
    Form("gauge_offset", "in the loop", True, 0.5, 60e2, _signed("loop_offset")),
    Form("gauge_gain", "recorded", False, 1e-5, 0.3, _signed("gauge_gain")),
    Form("gauge_gain", "two slopes", True, 1e-5, 0.4, _signed("gauge_gain_high")),
)

INTERFACE = (
    Form("spring_preload", "constant", False, 10.0, 150e2, _one("preload"), instruments=_CUT),
    Form("spring_preload", "relaxing", True, 10.0, 150e2, _one("preload_fading"), instruments=_CUT),
    Form("rim_friction", "constant play", False, 2.0, 100e2, _one("stick")),
    Form("rim_friction", "Coulomb", True, 1e-4, 0.4, _one("stick_coulomb")),
    Form("rim_friction", "bristles", True, 1e-4, 0.4, lambda a, r: {"stick_bristle": a, "bristle_scale": r.uniform(10e2, 40e2)}),
    Form("rim_leak", "growing", False, 1e-4, 0.3, _one("rim_leak")),
    Form("rim_leak", "sealing", True, 1e-4, 0.9, lambda a, r: {"rim_sealing": a, "seal_at": r.uniform(30e2, 100e2)}),
    Form("probe_tilt", "seating", False, 1e-7, 1.2e-4, lambda a, r: {"tilt": a, "seat_at": r.uniform(15e2, 80e2)}, sizes=True),
    Form("probe_tilt", "rocking flat", True, 1e-7, 1.2e-4, lambda a, r: {"tilt_seating": a, "seat_at": r.uniform(15e2, 80e2)}, sizes=True),
    Form("probe_recoil", "spring", False, 1e-7, 3e-4, _one("recoil"), sizes=True),
    Form("probe_recoil", "damped", True, 1e-7, 3e-4, lambda a, r: {"recoil_damped": a, "recoil_stop": r.uniform(0.4, 1.2), "recoil_tau": r.uniform(0.05, 0.6)}, sizes=True),
)

TISSUE = (
    Form("slow_creep", "mode", False, 1e-3, 1.5, lambda a, r: {"creep": a, "creep_tau": r.uniform(30, 150)}),
    Form("slow_creep", "one way", True, 1e-3, 1.5, lambda a, r: {"creep_oneway": a, "creep_tau": r.uniform(25, 100)}),
    Form("power_law_creep", "fractional", False, 1e-4, 1.0, lambda a, r: {"power_creep": a, "alpha": r.uniform(0.1, 0.35)}),
    Form("power_law_creep", "logarithmic", True, 1e-4, 0.3, _one("log_creep")),
    Form("viscoplastic_residual", "Perzyna", False, 1e-4, 0.6, lambda a, r: {"residual": a, "yield_at": r.uniform(0.2, 0.6)}),
    Form("viscoplastic_residual", "by work", True, 1e-4, 2.0, _one("residual_work")),
    Form("preconditioning", "by number", False, 1e-3, 0.6, lambda a, r: {"first_loadings": a, "series": r.uniform(0.6, 2.0)}),
    Form("preconditioning", "by work", True, 1e-3, 0.5, lambda a, r: {"mullins": a, "softening": r.uniform(6, 30)}),
    Form("missing_deep_layer", "kink", False, 1e-3, 0.8, lambda a, r: {"deep": a, "deep_at": r.uniform(0.4, 0.9)}),
    Form("missing_deep_layer", "viscous bend", True, 1e-3, 0.8, lambda a, r: {"deep_smooth": a, "deep_at": r.uniform(0.4, 0.9)}),
    Form("strain_stiffening", "quadratic", False, 1e-4, 0.8, _one("stiffen")),
    Form("strain_stiffening", "locking", True, 1e-4, 1.5, _one("locking")),
    Form("pulse_breathing", "sine", False, 2e-8, 1e-4, lambda a, r: {"pulse": a, "pulse_hz": r.choice([r.uniform(0.9, 1.5), r.uniform(0.2, 0.35)]), "pulse_phase": r.uniform(0, 6)}, sizes=True),
    Form("pulse_breathing", "breath with wave form", True, 2e-8, 1e-4, lambda a, r: {"breath": a, "pulse_hz": r.uniform(0.2, 0.35), "pulse_phase": r.uniform(0, 3)}, sizes=True),
    Form("muscle_tone_change", "drift", False, 1e-3, 0.6, _signed("tone")),
    Form("muscle_tone_change", "change", True, 1e-3, 0.6, lambda a, r: {"tone_step": a * _sign(r), "tone_at": r.uniform(0.25, 0.75), "tone_width": r.uniform(0.5, 10)}),
)

SENSOR = (
    Form("sensor_gain", "constant", False, 1e-3, 0.3, _signed("gain"), instruments=_CUT),
    Form("sensor_gain", "from a recording on", True, 1e-3, 0.5, lambda a, r: {"gain_later": a * _sign(r), "from_recording": _LATER(r)}, instruments=_CUT),
    Form("sensor_offset", "constant", False, 1e-8, 1e-4, _signed("offset"), sizes=True),
    Form("sensor_offset", "jump", True, 2e-8, 1e-4, lambda a, r: {"offset_jump": a * _sign(r), "jump_at": r.uniform(0.1, 0.8)}, sizes=True),
    Form("sensor_drift", "linear", False, 1e-8, 1e-3, _signed("drift"), sizes=True),
    Form("sensor_drift", "warming up", True, 1e-7, 3e-4, lambda a, r: {"warm_up": a * _sign(r), "warm_tau": r.uniform(4, 20)}, sizes=True),
    Form("sensor_drift", "wandering", True, 3e-8, 1e-4, _one("walk"), sizes=True),
    Form("quadratic_error", "square", False, 1e-4, 0.4, _signed("quadratic")),
    Form("quadratic_error", "waves", True, 1e-4, 0.2, lambda a, r: {"cubic": a * _sign(r), "waves": r.uniform(0.6, 1.6)}),
    Form("sensor_saturation", "hard", False, 1 / 1e-3, 1 / 5e-5, lambda a, r: {"ceiling": 1 / a}, sizes=True),
    Form("sensor_saturation", "soft", True, 1 / 1e-3, 1 / 5e-5, lambda a, r: {"soft_ceiling": 1 / a}, sizes=True),
    Form("sensor_quantisation", "rounding", False, 3e-7, 1.5e-4, _one("coarse"), sizes=True),
    Form("sensor_quantisation", "uneven", True, 3e-7, 1.5e-4, _one("coarse_uneven"), sizes=True),
    Form("sensor_hysteresis", "play", False, 3e-8, 6e-5, _one("play_height"), sizes=True),
    Form("sensor_hysteresis", "bristles", True, 3e-8, 6e-5, _one("preisach"), sizes=True),
    Form("sensor_low_pass", "first order", False, 5e-4, 2.0, _one("low_pass")),
    Form("sensor_low_pass", "second order", True, 5e-4, 2.0, _one("low_pass_twice")),
    Form("crosstalk", "pressure into height", False, 1e-7, 2e-4, _signed("from_pressure"), sizes=True),
    Form("crosstalk", "height into pressure", True, 1.0, 1e4, _signed("from_height")),
    Form("crosstalk", "flow into height", True, 1e-7, 2e-4, _signed("from_flow"), sizes=True),
    Form("misalignment", "tilted camera", False, 0.01, 0.7, _one("askew"), instruments=_ASP),
    Form("misalignment", "foreshortened", True, 0.01, 0.7, _one("askew_foreshortened"), instruments=_ASP),
    Form("threshold_bias", "rim", False, 1e-7, 1e-4, _signed("edge"), sizes=True, instruments=_ASP),
    Form("threshold_bias", "shaded rim", True, 1e-7, 1e-4, _signed("edge_shaded"), sizes=True, instruments=_ASP),
    Form("lens_distortion", "cubic", False, 1e-4, 0.3, lambda a, r: {"barrel": a * _sign(r), "centre": r.uniform(0, 1)}, instruments=_ASP),
    Form("lens_distortion", "division", True, 1e-4, 0.3, lambda a, r: {"barrel_division": a * _sign(r), "centre": r.uniform(0, 1)}, instruments=_ASP),
    Form("scale_error", "constant", False, 1e-3, 0.3, _signed("gain")),
    Form("scale_error", "after refocusing", True, 1e-3, 0.5, lambda a, r: {"gain_later": a * _sign(r), "from_recording": _LATER(r)}),
    Form("illumination_drift", "fading", False, 1e-5, 0.2, _one("fading")),
    Form("illumination_drift", "lamp", True, 1e-5, 0.5, lambda a, r: {"lamp": a, "lamp_tau": r.uniform(2, 15)}),
)

PROCESSING = (
    Form("wrong_zeroing", "late", False, 5e-4, 1.5, _one("zero_late")),
    Form("wrong_zeroing", "once a session", True, 0.02, 1.0, _one("zero_once")),
    Form("wrong_unit", "pressure", False, 1, 1, lambda a, r: {"unit_pressure": a}, steps=(0.0980665 / 0.1, 1.01325, 1.3332, 0.75006, 0.1)),
    Form("wrong_unit", "height", True, 1, 1, lambda a, r: {"unit_height": a, "unit_only": r.integers(0, 4)}, steps=(25.0 / 25.4, 1.125, 0.9, 2.0)),
    Form("wrong_unit", "one recording", True, 1, 1, lambda a, r: {"unit_pressure": a, "unit_only": r.integers(0, 4)}, steps=(0.980665, 1.01325, 1.3332, 0.1)),
)

OUTSIDE = (
    Form("unknown_pump_ripple", "ripple", True, 1e-5, 0.1, lambda a, r: {"pump_ripple": a, "ripple_hz": r.uniform(2.0, 8.0)}),
    Form("unknown_condensate", "drops", True, 1e-4, 0.5, _one("condensate")),
    Form("unknown_adiabatic", "heat of compression", True, 1e-4, 0.3, lambda a, r: {"adiabatic": a, "adiabatic_tau": r.uniform(0.5, 3.0)}),
    Form("unknown_restless", "subject moves", True, 3e-8, 1e-4, _one("restless"), sizes=True),
    Form("unknown_sweat", "softening by sweat", True, 1e-3, 0.8, _one("sweat")),
    Form("unknown_blood", "vessels fill", True, 1e-4, 0.5, lambda a, r: {"blood": a, "blood_tau": r.uniform(2, 12)}),
    Form("unknown_hum", "interference", True, 3e-8, 1e-4, lambda a, r: {"hum": a, "hum_hz": r.uniform(2, 11), "hum_phase": r.uniform(0, 6)}, sizes=True),
    Form("unknown_fog", "fogged window", True, 1e-4, 0.5, _one("fog")),
)

FORMS = TIMING + ACTUATOR + INTERFACE + TISSUE + SENSOR + PROCESSING
