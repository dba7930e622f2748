"""Forms that only laboratories of the wide style have: spells, bursts, one axis, one channel, any direction."""

from __future__ import annotations

from .effects_suction import CUT
from .forms import Draw, Form

SUCTION, ROBOT = ("cutometer", "aspiration"), ("microrobot",)
_SPELL: dict[str, Draw] = {"spell_in": range(0, 6), "spell_at": (0.05, 0.6), "spell_for": (0.8, 8.0)}
_LEG, _ROUND = range(0, 3), (0.0, 6.28)
_LOST: dict[str, Draw] = {"lost_in": range(0, 6), "lost_at": (0.0, 0.6)}


def _form(instruments: tuple[str, ...], concept: str, name: str, knob: str, strong: float, **draws: Draw) -> Form:
    return Form(concept, name, True, knob, strong, draws, instruments=instruments)


def _length(concept: str, name: str, knob: str, strong: float, **draws: Draw) -> Form:
    return Form(concept, name, True, knob, strong, draws, length=True)


SUCTION_FORMS = (
    _form(SUCTION, "dropped_samples", "a burst", "lost_run", 0.5, **_LOST),
    _form(SUCTION, "dropped_samples", "a burst of frames", "lost_frames", 0.5, **_LOST),
    _form(SUCTION, "leak", "for a while", "leak_spell", 0.3, **_SPELL),
    _form(SUCTION, "leak", "repaired in holds", "leak_repaired", 0.3, repair=(0.4, 3.0)),
    _form(SUCTION, "rim_leak", "for a while", "rim_spell", 0.5, **_SPELL),
    _form(SUCTION, "rim_leak", "a hose that loses", "hose_loss", 0.4, hose_tau=(0.05, 1.0)),
    _form(SUCTION, "overshoot", "late feedback", "late_steps", 16.0),
    _form(SUCTION, "gauge_offset", "for a while", "±gauge_spell", 60e2, **_SPELL),
    _form(SUCTION, "muscle_tone_change", "for a while", "±tone_spell", 0.5, **_SPELL),
    _length("pulse_breathing", "pulse without time", "pulse_wander", 1e-4,
            pulse_hz=(0.9, 1.5), wander=(0.02, 0.15), pulse_phase=(0, 6)),
    _length("pulse_breathing", "breath without time", "pulse_wander", 1e-4,
            pulse_hz=(0.2, 0.35), wander=(0.02, 0.15), pulse_phase=(0, 6)),
    _form(SUCTION, "scale_error", "for a while", "±gain_spell", 0.4, **_SPELL),
    _form(CUT, "sensor_gain", "for a while", "±gain_spell", 0.4, **_SPELL),
    _form(SUCTION, "quadratic_error", "at one height", "±scratch", 0.2, scratch_at=(0.3, 1.2)),
)  # fmt: skip

ROBOT_FORMS = (
    _form(ROBOT, "dropped_samples", "a burst", "lost_run", 0.5, **_LOST),
    _form(ROBOT, "viscous_drag", "one axis", "drag_one", 3e3, axis=_LEG),
    _form(ROBOT, "stribeck_friction", "one axis", "stribeck_one", 1.5, axis=_LEG, friction_law=1.0,
          stribeck_speed=(1e-4, 1e-3)),
    _form(ROBOT, "force_saturation", "carrying the weight", "1/limit", 1 / 0.5, weight=(0.1, 0.4)),
    _form(ROBOT, "prestress_anisotropy", "for a while", "tension_spell", 1.0, fibre=_ROUND, **_SPELL),
    _form(ROBOT, "muscle_tone_change", "for a while", "±tone_spell", 0.5, **_SPELL),
    _form(ROBOT, "pulse_breathing", "pulse without time", "pulse_wander", 0.1, pulse_hz=(0.9, 1.5),
          wander=(0.02, 0.15), pulse_phase=(0, 6)),
    _form(ROBOT, "pulse_breathing", "breath without time", "pulse_wander", 0.1, pulse_hz=(0.2, 0.35),
          wander=(0.02, 0.15), pulse_phase=(0, 6)),
    _form(ROBOT, "sensor_gain", "for a while", "±gain_spell", 0.5, leg=_LEG, **_SPELL),
    _form(ROBOT, "sensor_drift", "all legs", "±drift_all", 0.2, cross_seed=range(0, 1000)),
    _form(ROBOT, "crosstalk", "six terms", "±cross_matrix", 0.4, cross_seed=range(0, 1000)),
    _form(ROBOT, "misalignment", "about any axis", "±rotated", 0.4, axis_up=(-1.5, 1.5), axis_around=_ROUND),
    Form("wrong_unit", "one computed channel", True, "force_factor", 9.80665, {"one_channel": _LEG},
         steps=(0.5, 2.0, 9.80665, 0.224809), instruments=ROBOT),
    Form("wrong_unit", "one coordinate", True, "probe_factor", 10.0, {"one_channel": _LEG},
         steps=(25 / 25.4, 2.0, 10.0), instruments=ROBOT),
    Form("matrix_sign", "one computed channel", True, "force_factor", -1.0, {"one_channel": _LEG},
         steps=(-1.0,), instruments=ROBOT),
    _form(ROBOT, "wrong_zeroing", "one computed channel", "±force_zero", 0.5, one_channel=_LEG),
)  # fmt: skip

FORMS = SUCTION_FORMS + ROBOT_FORMS
