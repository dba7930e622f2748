"""Effects of what measures: optics and camera, transducers, position sensors."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers.microrobot import forces
from drivers.microrobot.kinematics import GEOMETRY
from sim_devices.chain import Chain, Effect, FloatArray, Signals
from sim_devices.effects.build import (
    ASPIRATION,
    CUTOMETER,
    PHASE,
    PRESSURE,
    ROBOT,
    SUCTION,
    Values,
    choice,
    chosen,
    effect,
    height_scale,
    law_after,
    map_after,
    on_recorded,
    shape,
    signed,
    strength,
)
from sim_devices.stages import kernels, laws
from sim_devices.stages.kernels import Kernel
from sim_devices.stages.operators import Map, Wired, after, before
from sim_devices.stages.robot import TRANSDUCERS, Linear, numbered

Law = Callable[..., Any]
_HEIGHT, _FORCE = "optics", "transducers"
_CHANNEL = choice("channel", 0, "transducer a", "b", "c", "all three")
_COURSE = choice("form", 1, "linear in time", "towards a limit, as in warming up", "to and fro")


def _transducers(v: Values) -> tuple[str, ...]:
    k = chosen(v, "channel")
    return TRANSDUCERS if k == 3 else TRANSDUCERS[k : k + 1]


def _mapped(name: str, law: Law, parameters: Callable[[Chain, Values], tuple[float, ...]], robot: bool) -> Any:
    """Install a law on the height, or on the transducers that the values choose."""

    def install(chain: Chain, v: Values) -> Chain:
        names = _transducers(v) if robot else ()
        return map_after(chain, _FORCE if robot else _HEIGHT, name, "sensor", law, parameters(chain, v), *names)

    return install


def _remembered(
    name: str, law: Kernel, parameters: Callable[[Chain, Values], tuple[float, ...]], robot: bool, add: bool = False
) -> Any:
    """The same for a kernel."""

    def install(chain: Chain, v: Values) -> Chain:
        names = _transducers(v) if robot else ()
        return law_after(
            chain, _FORCE if robot else _HEIGHT, name, "sensor", law, parameters(chain, v), *names, add=add
        )

    return install


def _offset(v: Values, amount: float) -> tuple[Law, tuple[float, ...]]:
    """What adds ``amount``, always or from one moment on."""
    return (laws.jump, (amount, v["moment"])) if chosen(v, "form") == 1 else (laws.offset, (amount,))


def _offset_height(chain: Chain, v: Values) -> Chain:
    # Behind the zeroing: in front of it a constant would vanish.
    return map_after(chain, "zeroing", "sensor_offset", "sensor", *_offset(v, v["offset"]))


def _offset_force(chain: Chain, v: Values) -> Chain:
    chain = map_after(chain, _FORCE, "sensor_offset", "sensor", *_offset(v, v["offset"]), *_transducers(v))
    k = chosen(v, "channel")
    names = numbered("axis_position") if k == 3 else numbered("axis_position")[k : k + 1]
    return map_after(chain, "position_sensors", "position_offset", "sensor", *_offset(v, v["position"]), *names)


def _hysteresis(robot: bool) -> Any:
    def install(chain: Chain, v: Values) -> Chain:
        w, form = v["width"], chosen(v, "form")
        names = _transducers(v) if robot else ()
        anchor = _FORCE if robot else _HEIGHT
        if form in (0, 3):
            law = kernels.play if form == 0 else kernels.soft_play
            return law_after(chain, anchor, "sensor_hysteresis", "sensor", law, (w,), *names)
        law, parameters = (
            (kernels.prandtl, (w, -w / 3, 2 * w, -w / 3, 4 * w, -w / 3))
            if form == 1
            else (kernels.bouc_wen, (-w, 2 * w, 2.0))
        )
        return law_after(chain, anchor, "sensor_hysteresis", "sensor", law, parameters, *names, add=True)

    return install


def _low_pass(chain: Chain, v: Values) -> Chain:
    anchor = _FORCE if chain.instrument == "microrobot" else ("gauge" if chosen(v, "channel") == 1 else _HEIGHT)
    if chosen(v, "order") == 0:
        return law_after(chain, anchor, "sensor_low_pass", "sensor", kernels.low_pass, (v["tau"],))
    return law_after(chain, anchor, "sensor_low_pass", "sensor", kernels.second_order, (v["tau"] / 2, 1.0))


def mixed(time: FloatArray, u: FloatArray, other: FloatArray, share: float) -> FloatArray:
    """A channel with ``share`` of another added."""
    return u + share * other


FLOW_TIME = 0.1
"""s over which a change of suction counts as flow."""


@dataclass(frozen=True)
class Flow(Wired):
    """Height (first source) plus ``gain`` (m/Pa) times what pressure (second source) has changed in `FLOW_TIME`."""

    gain: float

    def fresh(self) -> Any:
        return np.zeros(kernels.STATE), np.array([FLOW_TIME])

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        height, pressure = (signals[s] for s in self.source)
        before = np.empty(len(time))
        kernels.low_pass(state[0], time, pressure, state[1], before)
        signals[self.target[0]] = height + self.gain * (pressure - before)


def _crosstalk_suction(chain: Chain, v: Values) -> Chain:
    parameters = (-v["amount"] / PRESSURE,)
    if chosen(v, "form") == 1:
        return after(chain, _HEIGHT, lambda s, t: Flow("crosstalk", "sensor", (*s, "line_pressure"), t, *parameters))
    return map_after(chain, _HEIGHT, "crosstalk", "sensor", mixed, parameters, reading=("line_pressure",))


_ORDERED = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))


def _crosstalk_robot(chain: Chain, v: Values) -> Chain:
    pair = chosen(v, "pair")
    if pair >= len(_ORDERED):
        into, source = divmod(pair - len(_ORDERED), 3)
        parameters = (v["share"] * 1e3,)  # N/mm
        axis = numbered("axis")[source]
        return map_after(chain, _FORCE, "crosstalk", "sensor", mixed, parameters, TRANSDUCERS[into], reading=(axis,))
    into, source = _ORDERED[pair]
    other = chain["transducers"].writes[source]  # by its working name: what the transducer gives before other effects
    return map_after(chain, _FORCE, "crosstalk", "sensor", mixed, (v["share"],), TRANSDUCERS[into], reading=(other,))


def tilted_view(time: FloatArray, height: FloatArray, angle: float, hidden: float) -> FloatArray:
    """Height in a side view from ``angle`` above or below: foreshortened, its first ``hidden`` m behind the rim."""
    seen = height * math.cos(angle)
    return seen if hidden <= 0 else np.asarray(np.copysign(laws.ramp(np.abs(seen), hidden, 0.5 * hidden), seen))


def _misaligned_view(chain: Chain, v: Values) -> Chain:
    hidden = v["rim"] * abs(math.sin(v["angle"])) * 8e-3
    return map_after(chain, _HEIGHT, "misalignment", "sensor", tilted_view, (v["angle"], hidden))


def _misaligned_sensor(chain: Chain, v: Values) -> Chain:
    c, s = math.cos(v["angle"]), math.sin(v["angle"])
    turn = {
        0: (c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0),
        1: (1.0, 0.0, 0.0, 0.0, c, s, 0.0, -s, c),
        2: (c, 0.0, -s, 0.0, 1.0, 0.0, s, 0.0, c),
    }[chosen(v, "axis")]
    return before(chain, _FORCE, lambda a, b: Linear("misalignment", "sensor", a, b, turn))


def _geometry(chain: Chain, v: Values) -> Chain:
    w, h = forces.TRANSDUCER_RADIUS * (1.0 + v["w_error"]), forces.PROBE_HEIGHT * (1.0 + v["h_error"])
    return chain.tuned("transducers", matrix=tuple(np.linalg.inv(forces.matrix(w, h)).ravel()))


def weighed(
    time: FloatArray, fx: FloatArray, fy: FloatArray, fz: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray,
    weight: float, rho: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """Force on the transducers with the head's weight, which turns in their frame as the platform tilts."""
    gx, gy = (2 * a - b - c) / (3 * rho), (b - c) / (math.sqrt(3.0) * rho)
    q = np.sqrt(1.0 + gx * gx + gy * gy)
    return fx - weight * gx / q, fy - weight * gy / q, fz + weight * (1.0 / q - 1.0)


def _gravity(chain: Chain, v: Values) -> Chain:
    weight = 9.80665 * v["mass"] * (1.0 if chosen(v, "pointing") == 0 else -1.0)
    parameters = (weight, GEOMETRY.axis_radius)

    def make(source: tuple[str, ...], target: tuple[str, ...]) -> Wired:
        return Map("gravity_load", "sensor", (*source, *numbered("axis")), target, weighed, parameters)

    return before(chain, _FORCE, make)


def proportional_or_saturating(time: FloatArray, u: FloatArray, bias: float, reach: float, form: float) -> FloatArray:
    """u with an error that is there as soon as there is a dome (0), or grows with it (1)."""
    return laws.through_zero(time, u, bias, reach) if form < 0.5 else u * (1.0 + bias / reach)


def fading(
    time: FloatArray, u: FloatArray, change: float, tau: float, form: float, phase: float, added: float
) -> FloatArray:
    """Height from light that changes: scaled by it, and shifted by ``added`` m times the change."""
    share = change * laws.course(time, tau, form, phase)
    return u * (1.0 + share) + added * share


def _illumination(chain: Chain, v: Values) -> Chain:
    parameters = (v["change"], v["tau"], v["form"], v["phase"], v["shift"] * height_scale(chain))
    return map_after(chain, _HEIGHT, "illumination_drift", "sensor", fading, parameters)


def _on_both(instruments: tuple[str, ...], scale: float, unit: str) -> list[Effect]:
    """Effects that height (m) and transducer force (N) share; ``scale`` is the typical reading."""
    robot = unit == "N"
    which = (_CHANNEL,) if robot else ()
    what = "force" if robot else "height"
    return [
        effect(
            "sensor_offset", "sensor", instruments,
            f"Constant error of {what}{' or position' if robot else ''}.",
            "Zero against a known state; read the zero again at the end.",
            "datasheet: null ±15 mV, shift ±0.5 mV over 2 to 40 °C" if robot else "accuracy 3 % (assumed)",
            (
                signed("offset", unit, 0.5 * scale, 0.1 * scale),
                *((signed("position", "m", 3e-4, 0.0, "of the position sensor of the same number"), _CHANNEL)
                  if robot else ()),
                choice("form", 0, "always", "from one moment on"),
                shape("moment", "s", 1.0, 3000.0, 3.0, "when it jumps", log=True, only=(1,)),
            ),
            _offset_force if robot else _offset_height,
        ),
        effect(
            "sensor_drift", "sensor", instruments,
            f"The {what} reading wanders slowly with time (temperature).",
            "Warm up; re-zero between recordings; record the temperature.",
            "datasheet: 5.5 % / 25 °C, null shift" if robot else "light source and electronics; gap.md",
            (
                signed("amount", unit, 1.0 * scale, 0.2 * scale, "after a time tau (form 2: amplitude)"),
                shape("tau", "s", 20.0, 3000.0, 200.0, log=True),
                *which,
                _COURSE,
                PHASE,
            ),
            _mapped("sensor_drift", laws.drift, lambda c, v: (v["amount"], v["tau"], v["form"], v["phase"]), robot),
        ),
        effect(
            "quadratic_error", "sensor", instruments,
            f"Non-linear characteristic of the {what} sensor.",
            "Calibrate at three points or more.",
            "datasheet: linearity ±1.5 % of span" if robot else "calibration curve of the optics",
            (signed("error", "1", 0.5, 0.12, f"relative, at {scale:g} {unit}"), *which),
            _mapped("quadratic_error", laws.quadratic, lambda c, v: (v["error"], scale), robot),
        ),
        effect(
            "sensor_saturation", "sensor", instruments,
            f"The {what} reading stops at a limit.",
            "Another range; reject clipped samples.",
            "gap.md",
            (
                strength("limit", unit, 0.05 * scale, 30 * scale, 0.4 * scale, null=30 * scale),
                *which,
                choice("form", 0, "clipped", "bent"),
            ),
            _mapped("sensor_saturation", laws.saturation, lambda c, v: (v["limit"], v["form"]), robot),
        ),
        effect(
            "sensor_quantisation", "sensor", instruments,
            f"Coarser steps of {what} than the nominal resolution.",
            "A finer converter, a range that fits, dither.",
            "paper: 6 mN, 50 µm" if robot else "0.01 mm (assumed)",
            (strength("step", unit, 0.003 * scale, 0.6 * scale, 0.08 * scale),),
            _quantised(robot),
        ),
        effect(
            "sensor_hysteresis", "sensor", instruments,
            f"The {what} reading depends on the direction of change.",
            "Approach each value from one side; another sensor.",
            "Prandtl 1928, Bouc 1967, Dahl 1968, Wen 1976 for the forms",
            (
                strength("width", unit, 0.002 * scale, 0.4 * scale, 0.05 * scale, "half width"),
                *which,
                choice("form", 0, "play", "Prandtl-Ishlinskii", "Bouc-Wen", "Dahl"),
            ),
            _hysteresis(robot),
        ),
    ]  # fmt: skip


def _quantised(robot: bool) -> Any:
    def install(chain: Chain, v: Values) -> Chain:
        for signal in TRANSDUCERS if robot else ("apex_height",):
            chain = on_recorded(
                chain, signal, lambda s, t: Map("sensor_quantisation", "sensor", s, t, laws.quantisation, (v["step"],))
            )
        return chain

    return install


_GAIN_MEANING, _GAIN_REMEDY = "Wrong sensitivity", "Calibrate with a known height or weight."
_LAG = ("sensor_low_pass", "sensor")
_INTO = choice("form", 0, "as suction stands", "while suction changes")
_TAU = strength("tau", "s", 3e-4, 3.0, 0.2)
_ORDER = choice("order", 0, "first order", "second order")

EFFECTS = (
    effect(
        "sensor_gain", "sensor", CUTOMETER, f"{_GAIN_MEANING} of height.", _GAIN_REMEDY, "accuracy 3 % (assumed)",
        (signed("error", "1", 0.5, 0.1, "relative"),),
        _mapped("sensor_gain", laws.gain, lambda c, v: (v["error"],), False),
    ),
    effect(
        "sensor_gain", "sensor", ROBOT, f"{_GAIN_MEANING} of one transducer, or all.", _GAIN_REMEDY,
        "datasheet: 0.10 to 0.14 mV/g",
        (signed("error", "1", 0.5, 0.12, "relative"), _CHANNEL),
        _mapped("sensor_gain", laws.gain, lambda c, v: (v["error"],), True),
    ),
    *_on_both(CUTOMETER, 0.3e-3, "m"),
    *_on_both(ASPIRATION, 1.5e-3, "m"),
    *_on_both(ROBOT, 0.5, "N"),
    effect(
        *_LAG, SUCTION, "The sensor's own lag or filter.", "Less filtering; the same filter on every channel.",
        "gap.md", (_TAU, choice("channel", 0, "height", "pressure"), _ORDER), _low_pass,
    ),
    effect(
        *_LAG, ROBOT, "The transducers' own lag or filter.", "Less filtering; the same filter on every channel.",
        "gap.md", (_TAU, _ORDER), _low_pass,
    ),
    effect(
        "crosstalk", "sensor", CUTOMETER, "Pressure leaks into the height reading.",
        "Record height under suction on a rigid block.", "windows and housings bend under suction",
        (signed("amount", "m", 2e-4, 3e-5, "at 300 mbar"), _INTO), _crosstalk_suction,
    ),
    effect(
        "crosstalk", "sensor", ASPIRATION, "Pressure leaks into the height reading.",
        "Record height under suction on a rigid block.", "the camera or mirror moves under suction",
        (signed("amount", "m", 1e-3, 2e-4, "at 300 mbar"), _INTO), _crosstalk_suction,
    ),
    effect(
        "crosstalk", "sensor", ROBOT, "One transducer leaks into another.",
        "Load one transducer at a time and fill in the matrix.", "frame stiffness; gap.md",
        (
            signed("share", "1", 0.5, 0.15, "of a position: N/mm"),
            choice(
                "pair", 0, "b into a", "c into a", "a into b", "c into b", "a into c", "b into c",
                *(f"position {k} into {leg}" for leg in "abc" for k in "123"),
            ),
        ),
        _crosstalk_robot,
    ),
    effect(
        "misalignment", "sensor", ASPIRATION, "The camera looks from above or below: part of the dome is hidden.",
        "Level the camera; image a known object.", "side view over a rim; gap.md",
        (
            strength("angle", "rad", 0.01, 0.6, 0.2),
            shape("rim", "1", 0.0, 0.3, 0.1, "share of the opening's shade that hides the dome"),
        ),
        _misaligned_view,
    ),
    effect(
        "misalignment", "sensor", ROBOT, "The force sensor's axes are turned against the instrument's.",
        "Align on a reference load in x.", "the frame is seated by a magnet (M)",
        (signed("angle", "rad", 0.6, 0.15), choice("axis", 0, "about z", "about x", "about y")),
        _misaligned_sensor,
    ),
    effect(
        "wrong_geometry", "sensor", ROBOT, "h or w of the force matrix is not the real one.",
        "Measure h and w; calibrate with a lateral load.", "h is assumed (devices.md)",
        (
            signed("h_error", "1", 0.5, 0.15, "real h against assumed"),
            signed("w_error", "1", 0.5, 0.0, "real w against assumed"),
        ),
        _geometry,
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
            chain, _HEIGHT, "threshold_bias", "sensor", proportional_or_saturating, (v["bias"], v["reach"], v["form"])
        ),
    ),
    effect(
        "lens_distortion", "sensor", ASPIRATION, "Radial image distortion.",
        "Calibrate the lens with a grid.", "Brown 1966",
        (signed("coefficient", "1", 0.6, 0.2, "relative error at 2 mm from the axis"),),
        lambda chain, v: map_after(
            chain, _HEIGHT, "lens_distortion", "sensor", laws.cubic, (v["coefficient"], 2e-3)
        ),
    ),
    effect(
        "scale_error", "sensor", SUCTION, "Millimetres per pixel (or the height calibration) are wrong.",
        "Image a gauge block at the dome's place.", "0.02 mm/px (assumed)",
        (signed("error", "1", 0.5, 0.1, "relative"),),
        _mapped("scale_error", laws.gain, lambda c, v: (v["error"],), False),
    ),
    effect(
        "illumination_drift", "sensor", SUCTION, "The light source fades or warms up.",
        "Warm up; normalise by a background; watch a reference in the image.", "gap.md",
        (
            signed("change", "1", 0.6, 0.15, "of the light in the end (form 2: amplitude)"),
            shape("tau", "s", 20.0, 3000.0, 200.0, log=True),
            shape("shift", "1", 0.0, 1.0, 0.2, "typical heights by which the reading shifts besides"),
            _COURSE,
            PHASE,
        ),
        _illumination,
    ),
    effect(
        "gravity_load", "sensor", ROBOT, "The moving head's weight enters the transducers as it tilts.",
        "Weigh the head, subtract its turning weight; counterbalance.", "head mass unknown",
        (strength("mass", "kg", 1e-3, 0.3, 0.05), choice("pointing", 0, "tip down", "tip up")),
        _gravity,
    ),
)  # fmt: skip
