"""Effects of the sensors of suction instruments: optics and camera."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sim_devices.chain import Chain, FloatArray, Signals
from sim_devices.effects.any_sensor import (
    ANEW_COURSE,
    GAIN_MEANING,
    GAIN_REMEDY,
    GAIN_SHAPE,
    HEIGHT,
    LAG,
    ORDER,
    TAU,
    WARMING,
    gain,
    low_pass,
    mixed,
    on_both,
)
from sim_devices.effects.build import (
    ASPIRATION,
    CUTOMETER,
    PHASE,
    PRESSURE,
    SUCTION,
    Values,
    choice,
    chosen,
    effect,
    height_scale,
    map_after,
    on_recorded,
    shape,
    signed,
    strength,
)
from sim_devices.stages import kernels, laws
from sim_devices.stages.operators import Map, Wired, after, last_writer

LENS_REFERENCE = 2e-3
"""m from the axis of a lens at which its distortion is told."""
FLOW_TIME = 0.1
"""s for which a reading usually follows a change of suction."""


@dataclass(frozen=True)
class Flow(Wired):
    """Height (first source) plus ``gain`` (m/Pa) times the change of pressure (second source) within ``tau`` s, as by
    air that flows, or cools as it expands."""

    gain: float
    tau: float

    def fresh(self) -> Any:
        return np.zeros(kernels.STATE), np.array([self.tau])

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        height, pressure = (signals[s] for s in self.source)
        before = np.empty(len(time))
        kernels.low_pass(state[0], time, pressure, state[1], before)
        signals[self.target[0]] = height + self.gain * (pressure - before)


def _height_into_pressure(chain: Chain, share: float) -> Chain:
    """``share`` Pa/m of the height in the pressure reading: last of all, where both are there."""
    chain = on_recorded(
        chain, "pressure", lambda s, t: Map("crosstalk", "sensor", (*s, "apex_height"), t, mixed, (share,))
    )
    added = chain[last_writer(chain, "pressure")]
    return replace(chain, operators=(*(op for op in chain.operators if op is not added), added))


def _crosstalk_suction(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 2:
        return _height_into_pressure(chain, v["pressure"] / 1e-3)
    if chosen(v, "form") == 3:
        parameters: tuple[float, ...] = v["amount"] / math.tanh(PRESSURE / v["knee"]), v["knee"]
        return map_after(chain, HEIGHT, "crosstalk", "sensor", bent, parameters, reading=("line_pressure",))
    parameters = (-v["amount"] / PRESSURE,)
    if chosen(v, "form") == 1:
        flow = (*parameters, v["tau"])
        return after(chain, HEIGHT, lambda s, t: Flow("crosstalk", "sensor", (*s, "line_pressure"), t, *flow))
    return map_after(chain, HEIGHT, "crosstalk", "sensor", mixed, parameters, reading=("line_pressure",))


def bent(time: FloatArray, height: FloatArray, pressure: FloatArray, most: float, knee: float) -> FloatArray:
    """Height with a part of ``most`` m at the greatest, which grows ever less as suction does beyond a ``knee`` Pa."""
    return height - most * np.tanh(pressure / knee)


def tilted_view(time: FloatArray, height: FloatArray, angle: float, hidden: float) -> FloatArray:
    """Height in a side view from ``angle`` above or below: foreshortened, its first ``hidden`` m behind the rim."""
    seen = height * math.cos(angle)
    return seen if hidden <= 0 else np.asarray(np.copysign(laws.ramp(np.abs(seen), hidden, 0.5 * hidden), seen))


def in_perspective(time: FloatArray, height: FloatArray, angle: float, distance: float) -> FloatArray:
    """Height in a side view from ``angle`` above or below by a pinhole ``distance`` m away, negative if the dome leans
    towards it: what is farther off looks smaller (Hartley and Zisserman, *Multiple View Geometry*, 6.1)."""
    return np.asarray(height * math.cos(angle) / np.maximum(1.0 + height * math.sin(angle) / distance, 0.1))


def _misaligned_view(chain: Chain, v: Values) -> Chain:
    if form := chosen(v, "form"):
        away = v["distance"] if form == 1 else -v["distance"]
        return map_after(chain, HEIGHT, "misalignment", "sensor", in_perspective, (v["angle"], away))
    hidden = v["rim"] * abs(math.sin(v["angle"])) * 8e-3
    return map_after(chain, HEIGHT, "misalignment", "sensor", tilted_view, (v["angle"], hidden))


def about_an_axis(time: FloatArray, height: FloatArray, coefficient: float, axis: float) -> FloatArray:
    """Height (n,) m in an image that is distorted by ``coefficient`` at `LENS_REFERENCE` from an ``axis`` m above the
    rim, which is where the zero is taken."""
    return height + coefficient / LENS_REFERENCE**2 * ((height - axis) ** 3 + axis**3)


def _distorted(chain: Chain, v: Values) -> Chain:
    axis = v["axis"] if chosen(v, "form") == 1 else 0.0
    return map_after(chain, HEIGHT, "lens_distortion", "sensor", about_an_axis, (v["coefficient"], axis))


def proportional_or_saturating(time: FloatArray, u: FloatArray, bias: float, reach: float, form: float) -> FloatArray:
    """u with an error that is there as soon as there is a dome (0), or grows with it (1)."""
    return laws.through_zero(time, u, bias, reach) if form < 0.5 else u * (1.0 + bias / reach)


def fading(
    time: FloatArray, u: FloatArray, change: float, tau: float, form: float, phase: float, added: float
) -> FloatArray:
    """Height from light that changes: scaled by it, and shifted by ``added`` m times the change."""
    share = change * laws.course(time, tau, form, phase)
    return u * (1.0 + share) + added * share


def lit_anew(time: FloatArray, u: FloatArray, change: float, tau: float, added: float, *marks: float) -> FloatArray:
    """The same from light that is switched on at each of ``marks`` (s) and warms up: ``change`` more at first."""
    share = laws.fading_offset(time, np.zeros_like(u), change, tau, *marks)
    return u * (1.0 + share) + added * share


def _illumination(chain: Chain, v: Values) -> Chain:
    added = v["shift"] * height_scale(chain)
    if chosen(v, "form") == 3:
        op: Any = chain["latency"]
        parameters = (-v["change"], v["warming"], added, *op.marks)
        return map_after(chain, HEIGHT, "illumination_drift", "sensor", lit_anew, parameters)
    parameters = (v["change"], v["tau"], v["form"], v["phase"], added)
    return map_after(chain, HEIGHT, "illumination_drift", "sensor", fading, parameters)


_INTO = choice(
    "form", 0, "as suction stands", "while suction changes", "of height into the pressure reading",
    "as suction stands, ever less as it grows",
)  # fmt: skip
_KNEE = shape("knee", "Pa", 3e3, 100e3, 20e3, "suction beyond which it grows less", log=True, only=(3,))
_WITHIN = shape("tau", "s", 0.02, 3.0, FLOW_TIME, "for which it follows a change of suction", log=True, only=(1,))
_BACK = signed("pressure", "Pa", 5e3, 500.0, "that 1 mm of height adds to its reading", only=(2,))
EFFECTS = (
    effect(
        "sensor_gain", "sensor", CUTOMETER, f"{GAIN_MEANING} of height.", GAIN_REMEDY, "accuracy 3 % (assumed)",
        (signed("error", "1", 0.5, 0.1, "relative"), *GAIN_SHAPE), gain("sensor_gain", False),
    ),
    *on_both(CUTOMETER, 0.3e-3, "m"),
    *on_both(ASPIRATION, 1.5e-3, "m"),
    effect(
        *LAG, SUCTION, "The sensor's own lag or filter.", "Less filtering; the same filter on every channel.",
        "gap.md",
        (TAU, *(replace(p, only=(0,)) for p in (choice("channel", 0, "height", "pressure"), ORDER)),
         choice("form", 0, "the same at all times", "of frames, as a filter of noise that lets motion pass"),
         shape("reach", "m", 3e-6, 5e-4, 5e-5, "motion within its time that passes half as late", log=True, only=(1,))),
        low_pass,
    ),
    effect(
        "crosstalk", "sensor", CUTOMETER, "Pressure leaks into the height reading, or height into that of pressure.",
        "Record height under suction on a rigid block.", "windows and housings bend under suction",
        (signed("amount", "m", 2e-4, 3e-5, "at 300 mbar", only=(0, 1, 3)), _BACK, _INTO, _KNEE, _WITHIN),
        _crosstalk_suction,
    ),
    effect(
        "crosstalk", "sensor", ASPIRATION, "Pressure leaks into the height reading, or height into that of pressure.",
        "Record height under suction on a rigid block.", "the camera or mirror moves under suction",
        (signed("amount", "m", 1e-3, 2e-4, "at 300 mbar", only=(0, 1, 3)), _BACK, _INTO, _KNEE, _WITHIN),
        _crosstalk_suction,
    ),
    effect(
        "misalignment", "sensor", ASPIRATION, "The camera looks from above or below: part of the dome is hidden.",
        "Level the camera; image a known object.", "side view over a rim; gap.md",
        (
            strength("angle", "rad", 0.01, 0.6, 0.2),
            choice("form", 0, "from far away", "in perspective, the dome leaning away", "the same, leaning towards it"),
            shape("rim", "1", 0.0, 0.3, 0.1, "share of the opening's shade that hides the dome", only=(0,)),
            shape("distance", "m", 5e-3, 0.3, 0.04, "of the camera", log=True, only=(1, 2)),
        ),
        _misaligned_view,
    ),
    effect(
        "threshold_bias", "sensor", ASPIRATION, "Grey-value threshold set too high or too low.",
        "Set the threshold by the edge's slope; report the apex with a band.", "W sets it by eye, per site",
        (
            signed("bias", "m", 6e-4, 1e-4),
            shape("reach", "m", 0.05e-3, 3e-3, 0.4e-3, "height over which it builds up", log=True),
            choice("form", 0, "there with the dome", "in proportion to it"),
        ),
        lambda chain, v: map_after(
            chain, HEIGHT, "threshold_bias", "sensor", proportional_or_saturating, (v["bias"], v["reach"], v["form"])
        ),
    ),
    effect(
        "lens_distortion", "sensor", ASPIRATION, "Radial image distortion.",
        "Calibrate the lens with a grid.", "Brown 1966",
        (
            signed("coefficient", "1", 0.6, 0.2, "relative error at 2 mm from the axis"),
            choice("form", 0, "about the rim's height", "about an axis above the rim"),
            shape("axis", "m", 0.2e-3, 4e-3, 1e-3, "of the lens, above the rim", log=True, only=(1,)),
        ),
        _distorted,
    ),
    effect(
        "scale_error", "sensor", SUCTION, "The height's scale, its calibration in millimetres, is wrong.",
        "Measure a gauge block at the dome's place.", "0.02 mm/px (assumed)",
        (signed("error", "1", 0.5, 0.1, "relative"), *GAIN_SHAPE), gain("scale_error", False),
    ),
    effect(
        "illumination_drift", "sensor", SUCTION, "The light source fades or warms up.",
        "Warm up; normalise by the reading of the light; watch a gauge step.", "gap.md",
        (
            signed("change", "1", 0.6, 0.15, "of the light in the end (form 2: amplitude)"),
            shape("tau", "s", 20.0, 3000.0, 200.0, log=True, only=(0, 1, 2)),
            WARMING,
            shape("shift", "1", 0.0, 1.0, 0.2, "typical heights by which the reading shifts besides"),
            ANEW_COURSE,
            PHASE,
        ),
        _illumination,
    ),
)  # fmt: skip
