"""Effects that height and transducer force share: gain, offset, drift, curvature, clipping, steps, hysteresis, lag."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from sim_devices.chain import Chain, Effect, FloatArray, Parameter
from sim_devices.effects.build import (
    ASPIRATION,
    AT_ONCE,
    CHOICE,
    LONGEST,
    PHASE,
    ROBOT,
    Values,
    choice,
    chosen,
    effect,
    for_a_while,
    law_after,
    map_after,
    on_recorded,
    shape,
    signed,
    strength,
)
from sim_devices.stages import kernels, laws
from sim_devices.stages.operators import Map, after
from sim_devices.stages.robot import TRANSDUCERS, Linear, numbered

Law = Callable[..., Any]
HEIGHT, FORCE = "optics", "transducers"
_CHANNELS = "transducer a", "b", "c", "all three"
CHANNEL = choice("channel", 0, *_CHANNELS)
_COURSES = ("linear in time", "towards a limit, as in warming up", "to and fro")
_ANEW = "towards a limit, switched on with every recording"
ANEW_COURSE = choice("form", 1, *_COURSES, _ANEW)
WALKS = 4
"""The form of a height that walks at random."""
LATER = shape("later", "s", 0.2, 300.0, 5.0, "after the start of each recording", log=True, only=(2,), fine=AT_ONCE)
WARMING = shape("warming", "s", 0.5, 120.0, 8.0, "within which it warms up", log=True, only=(3,))


def _transducers(v: Values) -> tuple[str, ...]:
    k = chosen(v, "channel")
    return TRANSDUCERS if k == 3 else TRANSDUCERS[k : k + 1]


def _mapped(name: str, law: Law, parameters: Callable[[Chain, Values], tuple[float, ...]], robot: bool) -> Any:
    """Install a law on the height, or on the transducers that the values choose."""

    def install(chain: Chain, v: Values) -> Chain:
        names = _transducers(v) if robot else ()
        return map_after(chain, FORCE if robot else HEIGHT, name, "sensor", law, parameters(chain, v), *names)

    return install


WAYS = {2: -1.0, 3: 1.0}
"""Signs of the readings that forms of one way bend."""
_ONE_WAY = "bent where it is negative alone: a preload is used up", "bent where it is positive alone"


def _saturated(robot: bool) -> Any:
    both_ways = _mapped("sensor_saturation", laws.saturation, lambda c, v: (v["limit"], v["form"]), robot)
    one_way = _mapped(
        "sensor_saturation", laws.saturation_one_way, lambda c, v: (v["limit"], WAYS[chosen(v, "form")]), robot
    )
    return lambda chain, v: (one_way if chosen(v, "form") > 1 else both_ways)(chain, v)


def gain(name: str, robot: bool) -> Any:
    """A wrong sensitivity, always or for a while."""

    def install(chain: Chain, v: Values) -> Chain:
        if chosen(v, "form") == 2:
            each = np.diag([1.0 + v[f"error_{leg}"] for leg in "abc"])
            return after(chain, FORCE, lambda s, t: Linear(name, "sensor", s, t, tuple(each.ravel().tolist())))
        law: tuple[Law, tuple[float, ...]] = (laws.gain, (v["error"],))
        if chosen(v, "form") == 1:
            law = (laws.gain_for_a_while, (v["error"], v["moment"], v["duration"]))
        names = _transducers(v) if robot else ()
        return map_after(chain, FORCE if robot else HEIGHT, name, "sensor", *law, *names)

    return install


_SPELLS = "always", "for a while"
GAIN_SHAPE = (choice("form", 0, *_SPELLS), *for_a_while(1))
TRANSDUCER_GAINS = (
    choice("channel", 0, *_CHANNELS, only=(0, 1)),
    choice("form", 0, *_SPELLS, "always, each transducer its own"),
    *for_a_while(1),
    *(signed(f"error_{leg}", "1", 0.5, 0.1 * (1 - k), "relative", only=(2,)) for k, leg in enumerate("abc")),
)


def _offset(v: Values, amount: float) -> tuple[Law, tuple[float, ...]]:
    """The law that adds ``amount``, always or for a while."""
    if chosen(v, "form") == 1:
        return laws.offset_for_a_while, (amount, v["moment"], v["duration"])
    return laws.offset, (amount,)


def _offset_height(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 2:
        op: Any = chain["latency"]
        parameters = (v["offset"], v["later"], *op.marks)
        return map_after(chain, HEIGHT, "sensor_offset", "sensor", laws.jump_each_time, parameters)
    # Behind the zeroing: in front of it a constant would vanish.
    return map_after(chain, "zeroing", "sensor_offset", "sensor", *_offset(v, v["offset"]))


def _offset_force(chain: Chain, v: Values) -> Chain:
    chain = map_after(chain, FORCE, "sensor_offset", "sensor", *_offset(v, v["offset"]), *_transducers(v))
    k = chosen(v, "channel")
    names = numbered("axis_position") if k == 3 else numbered("axis_position")[k : k + 1]
    return map_after(chain, "position_sensors", "position_offset", "sensor", *_offset(v, v["position"]), *names)


def _hysteresis(robot: bool) -> Any:
    def install(chain: Chain, v: Values) -> Chain:
        w, form = v["width"], chosen(v, "form")
        names = _transducers(v) if robot else ()
        anchor = FORCE if robot else HEIGHT
        if form in (0, 3):
            law = kernels.play if form == 0 else kernels.soft_play
            return law_after(chain, anchor, "sensor_hysteresis", "sensor", law, (w,), *names)
        law, parameters = (kernels.prandtl, kernels.in_a_row(w)) if form == 1 else (kernels.bouc_wen, (-w, 2 * w, 2.0))
        return law_after(chain, anchor, "sensor_hysteresis", "sensor", law, parameters, *names, add=True)

    return install


def low_pass(chain: Chain, v: Values) -> Chain:
    anchor = FORCE if chain.instrument == "microrobot" else ("gauge" if chosen(v, "channel") == 1 else HEIGHT)
    if "reach" in v and chosen(v, "form") == 1:
        adaptive = (v["tau"], v["reach"])
        return law_after(chain, anchor, "sensor_low_pass", "sensor", kernels.adaptive_low_pass, adaptive)
    if chosen(v, "order") == 0:
        return law_after(chain, anchor, "sensor_low_pass", "sensor", kernels.low_pass, (v["tau"],))
    return law_after(chain, anchor, "sensor_low_pass", "sensor", kernels.second_order, (v["tau"] / 2, 1.0))


def mixed(time: FloatArray, u: FloatArray, other: FloatArray, share: float) -> FloatArray:
    """A channel with ``share`` of another added."""
    return u + share * other


def _drift(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 3:
        op: Any = chain["latency"]
        parameters = (-v["amount"], v["warming"], *op.marks)
        return map_after(chain, HEIGHT, "sensor_drift", "sensor", laws.fading_offset, parameters)
    if chosen(v, "form") == WALKS:
        return law_after(chain, HEIGHT, "sensor_drift", "sensor", kernels.random_walk, (v["walk"], v["seed"]))
    return map_after(
        chain, HEIGHT, "sensor_drift", "sensor", laws.drift, (v["amount"], v["tau"], v["form"], v["phase"])
    )


def _wandering(v: Values) -> dict[str, float]:
    """Of a height that walks at random; the other courses are no chance."""
    return {"apex_height": v["walk"]} if chosen(v, "form") == WALKS else {}


def _drift_of_each(chain: Chain, v: Values) -> Chain:
    amounts, form = {name: v["amount"] for name in _transducers(v)}, v["form"]
    if chosen(v, "form") == 3:
        amounts, form = dict(zip(TRANSDUCERS, (v["amount"], v["amount_b"], v["amount_c"]), strict=True)), 1.0
    for name, amount in amounts.items():
        parameters = (amount, v["tau"], form, v["phase"])
        chain = map_after(chain, FORCE, "sensor_drift", "sensor", laws.drift, parameters, name)
    return chain


def _flaw(scale: float) -> tuple[Parameter, ...]:
    return (
        shape("at", "m", 0.1 * scale, 4.0 * scale, 0.6 * scale, "height of the flaw", log=True, only=(1,)),
        shape("width", "m", 0.03 * scale, scale, 0.2 * scale, "of the flaw", log=True, only=(1,)),
    )


def _bent_height(scale: float) -> Any:
    def install(chain: Chain, v: Values) -> Chain:
        law: tuple[Law, tuple[float, ...]] = (laws.quadratic, (v["error"], scale))
        if chosen(v, "form") == 1:
            law = (laws.flawed, (v["error"] * scale, v["at"], v["width"]))
        if chosen(v, "form") == 2:
            law = (laws.bent_alike, (v["error"], scale, v["power"]))
        return map_after(chain, HEIGHT, "quadratic_error", "sensor", *law)

    return install


def _bent_position(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 0:
        names = _transducers(v)
        return map_after(chain, FORCE, "quadratic_error", "sensor", laws.quadratic, (v["error"], 0.5), *names)
    if chosen(v, "form") == 2:
        law = (v["error"], 0.5, v["power"])
        return map_after(chain, FORCE, "quadratic_error", "sensor", laws.bent_alike, law, *_transducers(v))
    k = chosen(v, "channel")
    sensors = numbered("axis_position")
    names = sensors if k == 3 else sensors[k : k + 1]
    return map_after(chain, "position_sensors", "quadratic_error", "sensor", laws.quadratic, (v["error"], 1e-3), *names)


def on_both(instruments: tuple[str, ...], scale: float, unit: str) -> list[Effect]:
    """Effects that height (m) and transducer force (N) share; ``scale`` is the typical reading."""
    parts = (_of_zero, _of_scale, _of_resolution)
    return [e for part in parts for e in part(instruments, scale, unit)]


def _sensor(unit: str) -> tuple[bool, tuple[Parameter, ...], str]:
    """Whether a reading in ``unit`` is the robot's, the parameter that tells its channel, and the word for it."""
    robot = unit == "N"
    return robot, (CHANNEL,) if robot else (), "force" if robot else "height"


def _of_zero(instruments: tuple[str, ...], scale: float, unit: str) -> list[Effect]:
    """Errors of its zero."""
    return _of_force_zero(scale) if unit == "N" else _of_height_zero(instruments, scale)


_CONSTANT, _WANDERS = "Constant error of {}.", "The {} reading wanders slowly with time (temperature)."
_ZERO_AGAIN = "Zero against a known state; read the zero again at the end."
_WARM = "Warm up; re-zero between recordings; record the temperature."
_AFTER, _ALONG = "after a time tau (form 2: amplitude)", (0, 1, 2)
_ALWAYS, _SINCE = "always", "from one moment on, or for a while"
_TAU = ("tau", "s", 20.0, 3000.0, 200.0)


def _of_height_zero(instruments: tuple[str, ...], scale: float) -> list[Effect]:
    return [
        effect(
            "sensor_offset", "sensor", instruments, _CONSTANT.format("height"), _ZERO_AGAIN, "accuracy 3 % (assumed)",
            (
                signed("offset", "m", 0.5 * scale, 0.1 * scale),
                choice("form", 0, _ALWAYS, _SINCE, "in every recording, some time after its start"),
                *for_a_while(1, lasting=LONGEST),
                LATER,
            ),
            _offset_height,
        ),
        effect(
            "sensor_drift", "sensor", instruments, _WANDERS.format("height"), _WARM,
            "light source and electronics; gap.md",
            (
                signed("amount", "m", 1.0 * scale, 0.2 * scale, _AFTER, only=(*_ALONG, 3)),
                shape(*_TAU, log=True, only=_ALONG),
                choice("form", 1, *_COURSES, _ANEW, "at random"),
                PHASE,
                WARMING,
                strength("walk", "m", 1e-4 * scale, 0.03 * scale, 3e-3 * scale,
                         "rms after a second; grows with the root of time", only=(WALKS,)),
                shape("seed", CHOICE, 0, 9, 1, "which course: another number, another one", only=(WALKS,)),
            ),
            _drift,
            wander=_wandering,
        ),
    ]  # fmt: skip


def _of_force_zero(scale: float) -> list[Effect]:
    return [
        effect(
            "sensor_offset", "sensor", ROBOT, _CONSTANT.format("force or position"), _ZERO_AGAIN,
            "datasheet: null ±15 mV, shift ±0.5 mV over 2 to 40 °C",
            (
                signed("offset", "N", 0.5 * scale, 0.1 * scale),
                signed("position", "m", 3e-4, 0.0, "of the position sensor of the same number"),
                CHANNEL,
                choice("form", 0, _ALWAYS, _SINCE),
                *for_a_while(1, lasting=LONGEST),
            ),
            _offset_force,
        ),
        effect(
            "sensor_drift", "sensor", ROBOT, _WANDERS.format("force"), _WARM, "datasheet: 5.5 % / 25 °C, null shift",
            (
                signed("amount", "N", 1.0 * scale, 0.2 * scale, _AFTER),
                shape(*_TAU, log=True),
                replace(CHANNEL, only=_ALONG),
                choice("form", 1, *_COURSES, "towards a limit, each transducer its own"),
                PHASE,
                *(signed(f"amount_{leg}", "N", scale, 0.2 * scale * share, "of its own", only=(3,))
                  for leg, share in zip("bc", (-0.5, 0.7), strict=True)),
            ),
            _drift_of_each,
        ),
    ]  # fmt: skip


def _of_scale(instruments: tuple[str, ...], scale: float, unit: str) -> list[Effect]:
    """Errors of its characteristic."""
    robot, which, what = _sensor(unit)
    other = "of a position sensor, at 1 mm" if robot else "a flaw at one height"
    # Of a camera it is the lens's distortion.
    stroke = () if instruments == ASPIRATION else ("bent, of either sign alike: near the end of its stroke",)
    return [
        effect(
            "quadratic_error", "sensor", instruments,
            f"Non-linear characteristic of the {what} sensor.",
            "Calibrate at three points or more.",
            "datasheet: linearity ±1.5 % of span" if robot else "calibration curve of the optics",
            (
                signed("error", "1", 0.5, 0.12, f"relative, at {scale:g} {unit}"),
                *which,
                choice("form", 0, "bent", other, *stroke),
                *(() if robot else _flaw(scale)),
                *([shape("power", "1", 1.3, 5.0, 2.0, "of the share of the range", only=(2,))] if stroke else []),
            ),
            _bent_position if robot else _bent_height(scale),
        ),
        effect(
            "sensor_saturation", "sensor", instruments,
            f"The {what} reading stops at a limit.",
            "Another range; reject clipped samples.",
            "gap.md",
            (
                strength("limit", unit, 0.05 * scale, 30 * scale, 0.4 * scale, null=30 * scale),
                *which,
                choice("form", 0, "clipped", "bent", *(_ONE_WAY if robot else ())),
            ),
            _saturated(robot),
        ),
    ]  # fmt: skip


def _of_resolution(instruments: tuple[str, ...], scale: float, unit: str) -> list[Effect]:
    """Readings that come in steps, or depend on the way to them."""
    robot, which, what = _sensor(unit)
    return [
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
                strength("width", unit, 0.0001 * scale, 0.4 * scale, 0.05 * scale, "half width"),
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


GAIN_MEANING, GAIN_REMEDY = "Wrong sensitivity", "Calibrate with a known height or weight."
LAG = ("sensor_low_pass", "sensor")
TAU = strength("tau", "s", 5e-5, 3.0, 0.2)
ORDER = choice("order", 0, "first order", "second order")
