"""Effects that any rig can have, acting on one of its signals through a *tap*.

A model calls ``tap("force", values, velocity=v)`` where something could act; the nominal chain returns the values
unchanged. Taps are causal and keep a state, so a model may call them on whole series or sample by sample inside its
own integration loop.

Forms: Coulomb/Stribeck after Armstrong-Hélouvry, Dupont & Canudas de Wit, Automatica 30 (1994) 1083; Dahl after P.
Dahl, AIAA J. 14 (1976) 1675; Bouc-Wen after Y. Wen, J. Eng. Mech. Div. 102 (1976) 249; play (backlash) after
Krasnosel'skii & Pokrovskii.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numba
import numpy as np

from gap.hypothesis import FloatArray
from sim_devices.chain import Parameter

State = dict[str, float]


@dataclass(frozen=True)
class GenericEffect:
    """``act(state, time, values, related, p)`` returns the changed values; ``needs`` names the related signal it acts
    with.

    Parameters of unit ``signal`` have priors relative to the range of the signal, ``velocity`` and ``position``
    relative to those of the related one; they are scaled when the effect meets its rig.
    """

    name: str
    meaning: str
    remedy: str
    parameters: tuple[Parameter, ...]
    act: Callable[[State, FloatArray, FloatArray, Mapping[str, FloatArray], Mapping[str, float]], FloatArray]
    needs: str = ""


def _rel(name: str, low: float, high: float, unit: str = "signal", meaning: str = "") -> Parameter:
    return Parameter(name, unit, low, high, null=0.0, default=np.sqrt(low * high), scale="log", meaning=meaning)


def _signed(name: str, size: float, unit: str = "signal", meaning: str = "") -> Parameter:
    return Parameter(name, unit, -size, size, null=0.0, default=0.2 * size, meaning=meaning)


def _shape(name: str, low: float, high: float, unit: str, meaning: str = "") -> Parameter:
    return Parameter(name, unit, low, high, null=None, default=np.sqrt(low * high), scale="log", meaning=meaning)


def _join(state: State, key: str, values: FloatArray) -> float:
    """The value before this chunk: kept from the last one, else the first of this."""
    return state.get(key, float(values[0]))


def _coulomb(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return y + p["level"] * np.tanh(related["velocity"] / p["sharpness"])


def _stribeck(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    v = related["velocity"]
    excess = p["excess"] * np.exp(-np.square(v / p["stribeck_velocity"]))
    return y + p["level"] * (1 + excess) * np.tanh(v / (0.1 * p["stribeck_velocity"]))


def _viscous(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return y + p["coefficient"] * related["velocity"]


def _quadratic_drag(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return y + p["coefficient"] * related["velocity"] * np.abs(related["velocity"])


def _cubic(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return y + p["coefficient"] * related["position"] ** 3


def _position_gain(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return y * (1 + p["slope"] * related["position"])


@numba.njit(cache=True)
def _dahl_kernel(x: FloatArray, x_before: float, z: float, presliding: float) -> tuple[FloatArray, float]:
    """Dahl's first-order presliding law in displacement: dz/dx = (1 − z sgn dx)/presliding, exact per step."""
    out = np.empty_like(x)
    last = x_before
    for i in range(x.size):
        step = x[i] - last
        if step > 0:
            z = 1.0 - (1.0 - z) * np.exp(-step / presliding)
        elif step < 0:
            z = -1.0 + (1.0 + z) * np.exp(step / presliding)
        out[i] = z
        last = x[i]
    return out, z


def _dahl(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    x = np.ascontiguousarray(related["position"], dtype=float)
    z, state["z"] = _dahl_kernel(x, _join(state, "x", x), state.get("z", 0.0), p["presliding"])
    state["x"] = float(x[-1])
    return y + p["level"] * z


def _own_hysteresis(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    """Bouc-Wen with the signal as its own displacement: the rate-independent loop of piezos, valves and gauges."""
    y = np.ascontiguousarray(y, dtype=float)
    z, state["z"] = _dahl_kernel(y, _join(state, "y", y), state.get("z", 0.0), p["width"])
    state["y"] = float(y[-1])
    return y - p["level"] * z


@numba.njit(cache=True)
def _play_kernel(x: FloatArray, half: float, y: float) -> FloatArray:
    out = np.empty_like(x)
    for i in range(x.size):
        y = min(max(y, x[i] - half), x[i] + half)
        out[i] = y
    return out


def _backlash(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    y = np.ascontiguousarray(y, dtype=float)
    out = _play_kernel(y, 0.5 * p["gap"], _join(state, "out", y))
    state["out"] = float(out[-1])
    return out


def _dead_zone(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    x = y - p["centre"]
    return p["centre"] + np.sign(x) * np.maximum(np.abs(x) - p["half_width"], 0.0)


def _delay(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return np.interp(time - p["time"], time, y)


@numba.njit(cache=True)
def _relax_kernel(time: FloatArray, y: FloatArray, tau: float, t0: float, y0: float, z: float) -> FloatArray:
    """First-order lag, exact for piecewise linear input on any time grid."""
    out = np.empty_like(y)
    last_t, last_y = t0, y0
    for i in range(y.size):
        dt = time[i] - last_t
        if dt > 0:
            e = np.exp(-dt / tau)
            slope = (y[i] - last_y) / dt
            z = y[i] - slope * tau + (z - last_y + slope * tau) * e
        out[i] = z
        last_t, last_y = time[i], y[i]
    return out


def _lagged(state: State, time: FloatArray, y: FloatArray, tau: float, rest: float | None = None) -> FloatArray:
    y = np.ascontiguousarray(y, dtype=float)
    first = float(y[0]) if rest is None else rest
    out = _relax_kernel(time, y, tau, state.get("t", float(time[0])), state.get("y", first), state.get("z", first))
    state.update(t=float(time[-1]), y=float(y[-1]), z=float(out[-1]))
    return out


def _low_pass(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return _lagged(state, time, y, p["tau"])


def _leak(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    """What is held bleeds away: a share of the signal's change is lost with a time constant."""
    rest = state.setdefault("rest", float(y[0]))
    return y - p["share"] * (_lagged(state, time, y, p["tau"], rest) - rest)


def _creep(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    """Delayed response: logarithmic in time, as a bank of three lags per two decades about ``tau``."""
    total = np.zeros_like(y)
    for k, factor in enumerate((0.15, 1.0, 7.0)):
        inner: State = {n: state[f"{n}{k}"] for n in ("t", "y", "z") if f"{n}{k}" in state}
        total += _lagged(inner, time, y, p["tau"] * factor) / 3.0
        state.update({f"{n}{k}": v for n, v in inner.items()})
    return y + p["share"] * total


def _saturation(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return np.minimum(y, p["limit"])


def _lower_saturation(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return np.maximum(y, p["limit"])


def _drift(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return y + p["rate"] * (time - state.setdefault("t0", float(time[0])))


def _quadratic_error(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return y + p["coefficient"] * y * np.abs(y) if p["odd"] > 0.5 else y + p["coefficient"] * y * y


def _gain(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return y * (1 + p["error"])


def _offset(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return y + p["value"]


def _quantisation(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return p["step"] * np.round(y / p["step"])


@numba.njit(cache=True)
def _slew_kernel(time: FloatArray, x: FloatArray, rate: float, t0: float, y: float) -> FloatArray:
    out = np.empty_like(x)
    last = t0
    for i in range(x.size):
        reach = rate * (time[i] - last)
        y = y + min(max(x[i] - y, -reach), reach)
        out[i] = y
        last = time[i]
    return out


def _slew(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    y = np.ascontiguousarray(y, dtype=float)
    out = _slew_kernel(time, y, p["rate"], state.get("t", float(time[0])), _join(state, "out", y))
    state.update(t=float(time[-1]), out=float(out[-1]))
    return out


def _preconditioning(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    """The response of the first loadings differs and settles with time under test."""
    return y * (1 + p["change"] * np.exp(-(time - state.setdefault("t0", float(time[0]))) / p["settling"]))


def _crosstalk(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return y + p["share"] * related["other"]


GENERIC: tuple[GenericEffect, ...] = (
    GenericEffect(
        "coulomb_friction",
        "dry friction: a constant force against the motion",
        "lubricate, or compensate in the controller",
        (_rel("level", 1e-3, 1.0), _shape("sharpness", 1e-3, 0.1, "velocity", "speed over which the sign is smoothed")),
        _coulomb,
        needs="velocity",
    ),
    GenericEffect(
        "stribeck_friction",
        "dry friction that is higher near standstill",
        "stiffer drive, dither",
        (_rel("level", 1e-3, 1.0), _shape("excess", 0.1, 3.0, "1"), _shape("stribeck_velocity", 1e-2, 0.5, "velocity")),
        _stribeck,
        needs="velocity",
    ),
    GenericEffect(
        "viscous_drag",
        "a force in proportion to the speed",
        "measure the drag with the rig unloaded",
        (_signed("coefficient", 1.0, "signal/velocity"),),
        _viscous,
        needs="velocity",
    ),
    GenericEffect(
        "quadratic_drag",
        "a force with the square of the speed",
        "measure the drag with the rig unloaded",
        (_signed("coefficient", 1.0, "signal/velocity²"),),
        _quadratic_drag,
        needs="velocity",
    ),
    GenericEffect(
        "cubic_stiffness",
        "a spring that hardens or softens with travel",
        "measure the force statically over the travel",
        (_signed("coefficient", 2.0, "signal/position³"),),
        _cubic,
        needs="position",
    ),
    GenericEffect(
        "position_dependent_gain",
        "sensitivity that varies along the travel",
        "calibrate along the travel",
        (_signed("slope", 1.0, "1/position"),),
        _position_gain,
        needs="position",
    ),
    GenericEffect(
        "dahl_friction",
        "friction with elastic presliding",
        "preload or exchange the bearing",
        (_rel("level", 1e-3, 1.0), _shape("presliding", 1e-3, 0.3, "position")),
        _dahl,
        needs="position",
    ),
    GenericEffect(
        "hysteresis",
        "a rate-independent loop of the signal with itself",
        "close the loop on the output, or drive with charge",
        (_signed("level", 0.5), _shape("width", 0.02, 1.0, "signal")),
        _own_hysteresis,
    ),
    GenericEffect(
        "backlash",
        "play: the output stands still until the gap is crossed",
        "preload the joint",
        (_rel("gap", 1e-3, 0.5),),
        _backlash,
    ),
    GenericEffect(
        "dead_zone",
        "no response about a centre",
        "move the working point, or compensate",
        (_rel("half_width", 3e-3, 0.5), _signed("centre", 1.0)),
        _dead_zone,
    ),
    GenericEffect(
        "delay",
        "the signal is late by a constant time",
        "stamp at the source",
        (_rel("time", 0.2, 200.0, "dt"),),
        _delay,
    ),
    GenericEffect(
        "low_pass", "a first-order lag", "a faster sensor or filter", (_rel("tau", 0.5, 500.0, "dt"),), _low_pass
    ),
    GenericEffect(
        "leak",
        "what is held bleeds away",
        "find and seal the leak",
        (_rel("share", 5e-3, 1.0, "1"), _shape("tau", 0.01, 3.0, "duration")),
        _leak,
    ),
    GenericEffect(
        "creep",
        "a slow delayed response",
        "wait longer, or model the slow mode",
        (_rel("share", 5e-3, 1.0, "1"), _shape("tau", 3e-3, 0.5, "duration")),
        _creep,
    ),
    GenericEffect(
        "saturation",
        "the signal stops at an upper limit",
        "a larger range, or smaller commands",
        (Parameter("limit", "level", 0.3, 1.0, null=None, default=0.9),),
        _saturation,
    ),
    GenericEffect(
        "lower_saturation",
        "the signal stops at a lower limit",
        "a larger range, or smaller commands",
        (Parameter("limit", "level", 0.0, 0.7, null=None, default=0.1),),
        _lower_saturation,
    ),
    GenericEffect(
        "drift",
        "a slow run of the signal with time",
        "warm up, take zeros between runs",
        (_signed("rate", 0.5, "signal/duration"),),
        _drift,
    ),
    GenericEffect(
        "quadratic_error",
        "a bent characteristic",
        "calibrate at more than two points",
        (_signed("coefficient", 0.5, "1/signal"), Parameter("odd", "1", 0.0, 1.0, null=None, default=0.0)),
        _quadratic_error,
    ),
    GenericEffect("gain", "wrong sensitivity", "calibrate", (_signed("error", 0.5, "1"),), _gain),
    GenericEffect("offset", "a constant error", "zero the sensor", (_signed("value", 0.5),), _offset),
    GenericEffect(
        "quantisation", "coarse steps", "a finer converter or range", (_rel("step", 2e-3, 0.1),), _quantisation
    ),
    GenericEffect(
        "slew_limit",
        "the rate of change is limited",
        "smaller or slower commands",
        (_rel("rate", 1e-2, 1.0, "rate"),),
        _slew,
    ),
    GenericEffect(
        "preconditioning",
        "the first loadings differ from later ones",
        "precondition before the measurement",
        (_signed("change", 0.5, "1"), _shape("settling", 0.01, 0.5, "duration")),
        _preconditioning,
    ),
    GenericEffect(
        "crosstalk",
        "another signal leaks into this one",
        "shield, or calibrate the full matrix",
        (_signed("share", 0.5, "signal/other"),),
        _crosstalk,
        needs="other",
    ),
)
