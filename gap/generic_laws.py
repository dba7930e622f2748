"""What generic effects do to a signal: causal, with a state, on whole series or sample by sample.

Forms: Coulomb/Stribeck after Armstrong-Hélouvry, Dupont & Canudas de Wit, Automatica 30 (1994) 1083; Dahl after
P. Dahl, AIAA J. 14 (1976) 1675; Bouc-Wen after Y. Wen, J. Eng. Mech. Div. 102 (1976) 249; play (backlash) after
Krasnoselskii and Pokrovskii. All take ``(state, time, values, related, p)`` and return the changed values.
"""

from __future__ import annotations

from collections.abc import Mapping

import numba
import numpy as np

from gap.hypothesis import FloatArray

State = dict[str, float]


def _join(state: State, key: str, values: FloatArray) -> float:
    """The value before this chunk: kept from the last one, else the first of this."""
    return state.get(key, float(values[0]))


def coulomb(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return y + p["level"] * np.tanh(related["velocity"] / p["sharpness"])


def stribeck(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    v = related["velocity"]
    excess = p["excess"] * np.exp(-np.square(v / p["stribeck_velocity"]))
    return y + p["level"] * (1 + excess) * np.tanh(v / (0.1 * p["stribeck_velocity"]))


def viscous(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return y + p["coefficient"] * related["velocity"]


def quadratic_drag(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return y + p["coefficient"] * related["velocity"] * np.abs(related["velocity"])


def cubic(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return y + p["coefficient"] * related["position"] ** 3


def position_gain(
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


def dahl(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    x = np.ascontiguousarray(related["position"], dtype=float)
    z, state["z"] = _dahl_kernel(x, _join(state, "x", x), state.get("z", 0.0), p["presliding"])
    state["x"] = float(x[-1])
    return y + p["level"] * z


def own_hysteresis(
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


def backlash(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    y = np.ascontiguousarray(y, dtype=float)
    out = _play_kernel(y, 0.5 * p["gap"], _join(state, "out", y))
    state["out"] = float(out[-1])
    return out


def dead_zone(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    x = y - p["centre"]
    return p["centre"] + np.sign(x) * np.maximum(np.abs(x) - p["half_width"], 0.0)


def delay(
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


def low_pass(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return _lagged(state, time, y, p["tau"])


def leak(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    """What is held bleeds away: a share of the signal's change is lost with a time constant."""
    rest = state.setdefault("rest", float(y[0]))
    return y - p["share"] * (_lagged(state, time, y, p["tau"], rest) - rest)


def creep(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    """Delayed response: logarithmic in time, as a bank of three lags per two decades about ``tau``."""
    total = np.zeros_like(y)
    for k, factor in enumerate((0.15, 1.0, 7.0)):
        inner: State = {n: state[f"{n}{k}"] for n in ("t", "y", "z") if f"{n}{k}" in state}
        total += _lagged(inner, time, y, p["tau"] * factor) / 3.0
        state.update({f"{n}{k}": v for n, v in inner.items()})
    return y + p["share"] * total


def saturation(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return np.minimum(y, p["limit"])


def lower_saturation(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return np.maximum(y, p["limit"])


def drift(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return y + p["rate"] * (time - state.setdefault("t0", float(time[0])))


def quadratic_error(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return y + p["coefficient"] * y * np.abs(y) if p["odd"] > 0.5 else y + p["coefficient"] * y * y


def gain(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return y * (1 + p["error"])


def offset(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return y + p["value"]


def quantisation(
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


def slew(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    y = np.ascontiguousarray(y, dtype=float)
    out = _slew_kernel(time, y, p["rate"], state.get("t", float(time[0])), _join(state, "out", y))
    state.update(t=float(time[-1]), out=float(out[-1]))
    return out


def preconditioning(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    """The response of the first loadings differs and settles with time under test."""
    return y * (1 + p["change"] * np.exp(-(time - state.setdefault("t0", float(time[0]))) / p["settling"]))


def crosstalk(
    state: State, time: FloatArray, y: FloatArray, related: Mapping[str, FloatArray], p: Mapping[str, float]
) -> FloatArray:
    return y + p["share"] * related["other"]
