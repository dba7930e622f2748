"""Effects of the micro-robot's force sensor: its transducers, their frame, and the geometry behind their matrix."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from drivers.microrobot import forces
from drivers.microrobot.kinematics import GEOMETRY
from sim_devices.chain import Chain, FloatArray
from sim_devices.effects.any_sensor import (
    FORCE,
    GAIN_MEANING,
    GAIN_REMEDY,
    LAG,
    ORDER,
    TAU,
    TRANSDUCER_GAINS,
    gain,
    low_pass,
    mixed,
    on_both,
)
from sim_devices.effects.build import ROBOT, Values, choice, chosen, effect, map_after, signed, strength
from sim_devices.stages.operators import Map, Wired, after, before
from sim_devices.stages.robot import TRANSDUCERS, Linear, numbered

_ORDERED = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))


_SIX = tuple(f"{'abc'[source]}_into_{'abc'[into]}" for into, source in _ORDERED)


def _crosstalk_robot(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 1:
        matrix = np.eye(3)
        for (into, source), name in zip(_ORDERED, _SIX, strict=True):
            matrix[into, source] = v[name]
        return after(chain, FORCE, lambda s, t: Linear("crosstalk", "sensor", s, t, tuple(matrix.ravel().tolist())))
    pair = chosen(v, "pair")
    if pair >= len(_ORDERED):
        into, source = divmod(pair - len(_ORDERED), 3)
        parameters = (v["share"] * 1e3,)  # N/mm
        axis = numbered("axis")[source]
        return map_after(chain, FORCE, "crosstalk", "sensor", mixed, parameters, TRANSDUCERS[into], reading=(axis,))
    into, source = _ORDERED[pair]
    other = chain["transducers"].writes[source]  # by its working name: the transducer's output before other effects
    return map_after(chain, FORCE, "crosstalk", "sensor", mixed, (v["share"],), TRANSDUCERS[into], reading=(other,))


def _misaligned_sensor(chain: Chain, v: Values) -> Chain:
    if chosen(v, "form") == 1:
        turned = Rotation.from_rotvec([v["about_x"], v["about_y"], v["about_z"]]).as_matrix().T
        matrix = tuple(turned.ravel().tolist())
        return before(chain, FORCE, lambda a, b: Linear("misalignment", "sensor", a, b, matrix))
    c, s = math.cos(v["angle"]), math.sin(v["angle"])
    turn = {
        0: (c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0),
        1: (1.0, 0.0, 0.0, 0.0, c, s, 0.0, -s, c),
        2: (c, 0.0, -s, 0.0, 1.0, 0.0, s, 0.0, c),
    }[chosen(v, "axis")]
    return before(chain, FORCE, lambda a, b: Linear("misalignment", "sensor", a, b, turn))


def _geometry(chain: Chain, v: Values) -> Chain:
    w, h = forces.TRANSDUCER_RADIUS * (1.0 + v["w_error"]), forces.PROBE_HEIGHT * (1.0 + v["h_error"])
    return chain.tuned("transducers", matrix=tuple(np.linalg.inv(forces.matrix(w, h)).ravel()))


def weighed(
    time: FloatArray, fx: FloatArray, fy: FloatArray, fz: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray,
    weight: float, rho: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """Force on the transducers with the head's weight, which turns in their frame as the platform tilts.

    Its parts along the platform's axes, less the one that was tared.
    """
    gx, gy = (2 * a - b - c) / (3 * rho), (b - c) / (math.sqrt(3.0) * rho)
    q = np.sqrt(1.0 + gx * gx + gy * gy)
    return fx + weight * gx / q, fy + weight * gy / q, fz + weight * (1.0 / q - 1.0)


def _gravity(chain: Chain, v: Values) -> Chain:
    weight = 9.80665 * v["mass"] * (1.0 if chosen(v, "pointing") == 0 else -1.0)
    parameters = (weight, GEOMETRY.axis_radius)

    def make(source: tuple[str, ...], target: tuple[str, ...]) -> Wired:
        return Map("gravity_load", "sensor", (*source, *numbered("axis")), target, weighed, parameters)

    return before(chain, FORCE, make)


EFFECTS = (
    effect(
        "sensor_gain", "sensor", ROBOT, f"{GAIN_MEANING} of one transducer, or all.", GAIN_REMEDY,
        "datasheet: 0.10 to 0.14 mV/g",
        (signed("error", "1", 0.5, 0.12, "relative", only=(0, 1)), *TRANSDUCER_GAINS), gain("sensor_gain", True),
    ),
    *on_both(ROBOT, 0.5, "N"),
    effect(
        *LAG, ROBOT, "The transducers' own lag or filter.", "Less filtering; the same filter on every channel.",
        "gap.md", (TAU, ORDER), low_pass,
    ),
    effect(
        "crosstalk", "sensor", ROBOT, "One transducer leaks into another.",
        "Load one transducer at a time and fill in the matrix.", "frame stiffness; gap.md",
        (
            signed("share", "1", 0.5, 0.15, "of a position: N/mm", only=(0,)),
            choice(
                "pair", 0, "b into a", "c into a", "a into b", "c into b", "a into c", "b into c",
                *(f"position {k} into {leg}" for leg in "abc" for k in "123"), only=(0,),
            ),
            choice("form", 0, "one pair", "all six terms between transducers"),
            *(signed(name, "1", 0.5, 0.05 * (k - 2.5), only=(1,)) for k, name in enumerate(_SIX)),
        ),
        _crosstalk_robot,
    ),
    effect(
        "misalignment", "sensor", ROBOT, "The force sensor's axes are turned against the instrument's.",
        "Align on a reference load in x.", "the frame is seated by a magnet (M)",
        (
            signed("angle", "rad", 0.6, 0.15, only=(0,)),
            choice("axis", 0, "about z", "about x", "about y", only=(0,)),
            choice("form", 0, "about one axis", "about any"),
            *(signed(f"about_{k}", "rad", 0.6, 0.1, only=(1,)) for k in "xyz"),
        ),
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
        "gravity_load", "sensor", ROBOT, "The moving head's weight enters the transducers as it tilts.",
        "Weigh the head, subtract its turning weight; counterbalance.", "head mass unknown",
        (strength("mass", "kg", 1e-3, 0.3, 0.05), choice("pointing", 0, "tip down", "tip up")),
        _gravity,
    ),
)  # fmt: skip
