"""Laws of generic effects on a signal: causal, with a state, on whole series or sample by sample.

Forms: Coulomb/Stribeck after Armstrong-Hélouvry, Dupont & Canudas de Wit, Automatica 30 (1994) 1083; Dahl after
P. Dahl, AIAA J. 14 (1976) 1675; play (backlash) after Krasnoselskii and Pokrovskii; a signal's own hysteresis by many
plays, after Prandtl and Ishlinskii; creep by many lags, after Findley, Lai and Onaran, "Creep and Relaxation of
Nonlinear Viscoelastic Materials". All take ``(state, time, values, related, p)`` and return the changed values; time,
values and related signals are arrays (n,), or floats where a model calls its tap for a single sample.
"""

from __future__ import annotations

from bisect import bisect
from collections.abc import Callable, Mapping
from typing import Any

import numba
import numpy as np

from sim_devices.chain import FloatArray

Signal = Any
"""An array (n,), or a float: one sample."""
State = dict[str, Any]
Related = Mapping[str, Signal]
Values = Mapping[str, float]
STOPS, STOPS_PER_DECADE = 11, 6
LAGS, LAGS_PER_DECADE = 11, 2


def _remembering(
    kernel: Callable[..., FloatArray],
    state: State,
    size: int,
    time: Signal,
    y: Signal,
    *constants: Any,
) -> Signal:
    """A kernel over the values ``y``, with a memory of ``size`` numbers that lasts; they are NaN before the first."""
    if "memory" not in state:
        state["memory"] = np.full(size, np.nan)
    if isinstance(y, float):
        return float(kernel(np.array([time]), np.array([y]), state["memory"], *constants)[0])
    return kernel(time, np.ascontiguousarray(y, dtype=float), state["memory"], *constants)


def _lopsided(direction: Signal, p: Mapping[str, float]) -> Signal:
    """A direction of motion, -1 … 1, that counts by ``asymmetry`` more forwards and less backwards."""
    return direction * (1 + p["asymmetry"] * direction)


def coulomb(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    return y + p["level"] * _lopsided(np.tanh(related["velocity"] / p["sharpness"]), p)


def breakaway(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    """The part of a net force ``y`` beyond the level (Karnopp 1985, without inertia); nought of a lesser force."""
    held = p["level"] * (1 + p.get("excess", 0.0) * (related["velocity"] == 0.0))
    moves = np.abs(y) > held
    return moves * (y - p["level"] * np.sign(y))


def stribeck(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    v = related["velocity"]
    excess = p["excess"] * np.exp(-np.square(v / p["stribeck_velocity"]))
    return y + p["level"] * (1 + excess) * _lopsided(np.tanh(v / (0.1 * p["stribeck_velocity"])), p)


def viscous(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    return y + p["coefficient"] * related["velocity"]


def quadratic_drag(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    return y + p["coefficient"] * related["velocity"] * np.abs(related["velocity"])


def power_drag(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    v = related["velocity"]
    return y + p["force"] * np.sign(v) * np.abs(v / p["speed"]) ** p["exponent"]


def cubic(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    x = related["position"]
    return y + p["coefficient"] * x * x * x


def position_gain(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    return y * (1 + p["slope"] * related["position"])


@numba.njit(cache=True, error_model="numpy")
def _dahl_kernel(time: FloatArray, x: FloatArray, memory: FloatArray, presliding: float) -> FloatArray:
    """Dahl's first-order presliding law in displacement: dz/dx = (1 − z sgn dx)/presliding, exact per step."""
    out = np.empty_like(x)
    if np.isnan(memory[0]):
        memory[0], memory[1] = x[0], 0.0
    last, z = memory[0], memory[1]
    for i in range(x.size):
        step = x[i] - last
        if step > 0:
            z = 1.0 - (1.0 - z) * np.exp(-step / presliding)
        elif step < 0:
            z = -1.0 + (1.0 + z) * np.exp(step / presliding)
        out[i] = z
        last = x[i]
    memory[0], memory[1] = last, z
    return out


def dahl(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    z = _remembering(_dahl_kernel, state, 2, time, related["position"], p["presliding"])
    return y + p["level"] * _lopsided(z, p)


def bristles(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    """Bristles that bend as Dahl's, with Stribeck's level (LuGre without their damping; Canudas de Wit et al. 1995)."""
    excess = p["excess"] * np.exp(-np.square(related["velocity"] / p["stribeck_velocity"]))
    z = _remembering(_dahl_kernel, state, 2, time, related["position"], p["presliding"])
    return y + p["level"] * (1 + excess) * _lopsided(z, p)


@numba.njit(cache=True, error_model="numpy")
def _stops_kernel(
    time: FloatArray,
    y: FloatArray,
    memory: FloatArray,
    bounds: FloatArray,
    weights: FloatArray,
    initial: float,
) -> FloatArray:
    """Weighted sum of stops (signal − play), each within its bound; they begin as after a move of ``initial`` to the
    first value."""
    out = np.empty_like(y)
    if np.isnan(memory[0]):
        memory[0] = y[0]
        memory[1:] = np.minimum(np.maximum(initial, -bounds), bounds)
    last = memory[0]
    for i in range(y.size):
        total = 0.0
        for k in range(bounds.size):
            memory[k + 1] = min(max(memory[k + 1] + y[i] - last, -bounds[k]), bounds[k])
            total += weights[k] * memory[k + 1]
        out[i] = total
        last = y[i]
    memory[0] = last
    return out


def own_hysteresis(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    """The rate-independent loop of piezos, magnets and gauges: many plays of a signal that saturates about ``bend``.

    They are up to a half ``width``, of shares ∝ that to the ``exponent``: the less, the fuller are small loops. Every
    loop inside another closes; those over twice ``width`` have the full height, twice ``level``. The part in proportion
    to the signal is left out: the generalised form of Al Janaideh, Rakheja and Su, IEEE/ASME Trans. Mechatronics 16
    (2011) 734, less a gain.
    """
    if "bank" not in state:
        bounds = p["width"] * 10.0 ** (-np.arange(STOPS) / STOPS_PER_DECADE)
        weights = bounds ** (p["exponent"] - 1.0)
        weights /= np.sum(weights * bounds)
        state["bank"], state["total"] = (bounds, weights, p["initial"]), float(weights.sum())
    bent = p["bend"] * np.tanh(y / p["bend"])
    loop = _remembering(_stops_kernel, state, STOPS + 1, time, bent, *state["bank"])
    return y + p["level"] * (state["total"] * (bent - y) - loop)


@numba.njit(cache=True, error_model="numpy")
def _play_kernel(time: FloatArray, x: FloatArray, memory: FloatArray, half: float) -> FloatArray:
    out = np.empty_like(x)
    y = x[0] if np.isnan(memory[0]) else memory[0]
    for i in range(x.size):
        y = min(max(y, x[i] - half), x[i] + half)
        out[i] = y
    memory[0] = y
    return out


def backlash(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    return _remembering(_play_kernel, state, 1, time, y, 0.5 * p["gap"])


def dead_zone(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    x = y - p["centre"]
    return p["centre"] + np.sign(x) * np.maximum(np.abs(x) - p["half_width"], 0.0)


def delay(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    """Straight lines between samples; before the first of them its value."""
    times, values = state.setdefault("past", ([], []))
    if not isinstance(y, float):
        times.extend(time.tolist())
        values.extend(y.tolist())
        return np.interp(time - p["time"], times, values)
    times.append(time)
    values.append(y)
    then = time - p["time"]
    k = bisect(times, then)
    if k in (0, len(times)):
        return values[min(k, len(times) - 1)]
    share = (then - times[k - 1]) / (times[k] - times[k - 1])
    return values[k - 1] + share * (values[k] - values[k - 1])


def advance(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    """Straight lines between samples of a whole series; after the last of them its value. A single sample stays."""
    return y if isinstance(y, float) else np.interp(time + p["time"], time, y)


@numba.njit(cache=True, error_model="numpy")
def _lags_kernel(
    time: FloatArray,
    y: FloatArray,
    memory: FloatArray,
    taus: FloatArray,
    weights: FloatArray,
    settled: float,
) -> FloatArray:
    """Weighted sum of first-order lags, exact for piecewise linear input on any time grid; they begin at ``settled``
    times the first value."""
    out = np.empty_like(y)
    if np.isnan(memory[0]):
        memory[0], memory[1], memory[2:] = time[0], y[0], settled * y[0]
    last_t, last_y = memory[0], memory[1]
    for i in range(y.size):
        dt = time[i] - last_t
        total = 0.0
        for k in range(taus.size):
            z = memory[k + 2]
            if dt > 0:
                e = np.exp(-dt / taus[k])
                slope = (y[i] - last_y) / dt
                z = y[i] - slope * taus[k] + (z - last_y + slope * taus[k]) * e
                memory[k + 2] = z
            total += weights[k] * z
        out[i] = total
        last_t, last_y = time[i], y[i]
    memory[0], memory[1] = last_t, last_y
    return out


def low_pass(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    if "bank" not in state:
        state["bank"] = np.array([p["tau"]]), np.ones(1), 1.0
    return _remembering(_lags_kernel, state, 3, time, y, *state["bank"])


def _slow(state: State, time: Signal, y: Signal, p: Values) -> Signal:
    """A signal through lags from ``tau`` down five decades, of shares ∝ their time to the ``exponent``: 0 creeps
    with the logarithm of time, 0.1 to 0.5 with that power of it, 1 and more nearly as a single exponential. It begins
    ``settled`` so far under the first value: 0 where that was put on then."""
    if "bank" not in state:
        shorter = 10.0 ** (-np.arange(LAGS) / LAGS_PER_DECADE)
        weights = shorter ** p["exponent"]
        state["bank"] = p["tau"] * shorter, weights / weights.sum(), p["settled"]
    return _remembering(_lags_kernel, state, LAGS + 2, time, y, *state["bank"])


def creep(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    return y + p["share"] * _slow(state, time, y, p)


def relaxation(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    """A ``share`` of the response goes again, however often it moves: a generalised Maxwell body."""
    return y - p["share"] * _slow(state, time, y, p)


@numba.njit(cache=True, error_model="numpy")
def _leak_kernel(
    time: FloatArray,
    y: FloatArray,
    memory: FloatArray,
    share: float,
    tau: float,
    refill: float,
) -> FloatArray:
    """The leaked part, z: dz/dt = (share y − z)/tau − |dy/dt| z/refill, exact for the mean y of a step."""
    out = np.empty_like(y)
    if np.isnan(memory[0]):
        memory[0], memory[1], memory[2] = time[0], y[0], 0.0
    last_t, last_y, z = memory[0], memory[1], memory[2]
    for i in range(y.size):
        bled = 1.0 - np.exp(-(time[i] - last_t) / tau)
        z = (z + (0.5 * share * (y[i] + last_y) - z) * bled) * np.exp(-np.abs(y[i] - last_y) / refill)
        out[i] = z
        last_t, last_y = time[i], y[i]
    memory[0], memory[1], memory[2] = last_t, last_y, z
    return out


def two_lags(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    half = {"tau": 0.5 * p["tau"]}
    first = low_pass(state.setdefault("first", {}), time, y, related, half)
    return low_pass(state.setdefault("second", {}), time, first, related, half)


def leak(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    """The held value bleeds away, the faster the more there is, until a move of ``refill`` makes good for it."""
    return y - _remembering(_leak_kernel, state, 3, time, y, p["share"], p["tau"], p["refill"])


def saturation(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    return np.minimum(y, p["limit"])


def symmetric_saturation(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    return np.minimum(np.maximum(y, -p["limit"]), p["limit"])


def lower_saturation(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    return np.maximum(y, p["limit"])


def _since_begin(state: State, time: Signal) -> Signal:
    """Time since the recording's first sample, s."""
    if "t0" not in state:
        state["t0"] = time if isinstance(time, float) else float(time[0])
    return time - state["t0"]


def drift(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    return y + p["rate"] * _since_begin(state, time)


def warming(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    return y + p["amount"] * (1.0 - np.exp(-_since_begin(state, time) / p["tau"]))


def quadratic_error(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    return y + p["coefficient"] * y * np.abs(y) if p["odd"] > 0.5 else y + p["coefficient"] * y * y


def power_error(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    return y * (1.0 + np.abs(y) / p["knee"]) ** p["exponent"]


def gain(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    return y * (1 + p["error"])


def offset(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    return y + p["value"]


def quantisation(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    return p["step"] * np.round(y / p["step"])


@numba.njit(cache=True, error_model="numpy")
def _slew_kernel(time: FloatArray, x: FloatArray, memory: FloatArray, rate: float) -> FloatArray:
    out = np.empty_like(x)
    if np.isnan(memory[0]):
        memory[0], memory[1] = time[0], x[0]
    last, y = memory[0], memory[1]
    for i in range(x.size):
        reach = rate * (time[i] - last)
        y = y + min(max(x[i] - y, -reach), reach)
        out[i] = y
        last = time[i]
    memory[0], memory[1] = last, y
    return out


def slew(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    return _remembering(_slew_kernel, state, 2, time, y, p["rate"])


def preconditioning(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    """The response of the first loadings differs and settles with time under test."""
    return y * (1 + p["change"] * np.exp(-_since_begin(state, time) / p["settling"]))


def crosstalk(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    return y + p["share"] * related["other"]


def slow_crosstalk(state: State, time: Signal, y: Signal, related: Related, p: Values) -> Signal:
    """A share of another signal behind a lag of ``tau``, counted from its first value."""
    if "from" not in state:
        other = related["other"]
        state["from"] = float(other) if isinstance(other, float) else float(other[0])
        state["bank"] = np.array([p["tau"]]), np.ones(1), 1.0
    late = _remembering(_lags_kernel, state, 3, time, related["other"], *state["bank"])
    return y + p["share"] * (late - state["from"])
