"""The loop of a driven axis with dry friction, against integrations of its equations of motion."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from sim_devices.chain import FloatArray
from sim_devices.stages.axes import LOOP_RATE, MASS, AxisLoop
from sim_devices.stages.axis_steps import SUBSTEP

CORNERS = np.array([0.0, 0.5, 1.5, 2.5, 3.0])
WAY = 1e-3 * np.array([0.0, 0.0, 1.0, 0.0, 0.0])
Rate = Callable[[FloatArray], float]
KP, KI, KD = 3 * MASS * LOOP_RATE**2, MASS * LOOP_RATE**3, 3 * MASS * LOOP_RATE


class Gained(AxisLoop):
    """Without an integral, all but."""

    def controller(self) -> tuple[float, float, float]:
        return KP, KP / 1e6, KD


def moved(time: FloatArray, **rubbing: float) -> FloatArray:
    """Positions (n,) m of an axis that is sent to and fro."""
    loop = AxisLoop("axes", "actuator", ("target_1", "load_1"), ("axis_1",), **rubbing)
    signals = {"target_1": np.interp(time, CORNERS, WAY), "load_1": np.zeros(len(time))}
    loop.advance(loop.fresh(), time, signals)
    return signals["axis_1"]


def integrated(
    time: FloatArray, brake: Callable[[FloatArray], float], rate: Rate | None = None, weight: float = 1.0
) -> FloatArray:
    """Positions (n,) m of such an axis under a braking force, N, of its state (integral, position, speed and, with a
    ``rate`` of it, friction), whose proportional part sees ``weight`` of the target."""

    def slope(t: float, s: FloatArray) -> list[float]:
        target = np.interp(t, CORNERS, WAY)
        error = target - s[1]
        force = KP * (weight * target - s[1]) + KI * s[0] - KD * s[2] - brake(s)
        return [error, s[2], force / MASS, *([rate(s)] if rate else [])]

    out, state = np.zeros(len(time)), np.zeros(4 if rate else 3)
    for a, b in itertools.pairwise(CORNERS):
        at = (time > a + 1e-9) & (time <= b + 1e-9)
        found = solve_ivp(slope, (a, b), state, method="LSODA", dense_output=True, rtol=1e-9, atol=1e-12, max_step=2e-3)
        out[at], state = found.sol(time[at])[1], found.y[:, -1]
    return out


@given(
    st.floats(1.0, 300.0),
    st.floats(0.02, 0.2),
    st.floats(-2e-3, 8e-3),
    st.floats(0.0, 5.0),
    st.floats(0.0, 500.0),
)
def test_a_loop_is_stable_where_all_of_its_poles_are_on_the_left(
    rate: float, mass: float, lag: float, drag: float, spring: float
) -> None:
    loop = AxisLoop("axes", "actuator", (), (), rate=rate, mass=mass, lag=lag, drag=drag, spring=spring)
    kp, ki, kd = loop.controller()
    characteristic = [mass - lag * kd, kd - lag * kp + drag, kp - lag * ki + spring, ki]
    assume(abs(characteristic[0]) > 1e-9)
    rightmost = float(np.max(np.roots(characteristic).real))
    assume(abs(rightmost) > 1e-6)
    assert loop.stable == (rightmost < 0.0)


@pytest.mark.parametrize("length", [2e-6, 6e-6, 4e-5])
def test_presliding_friction_follows_dahl(length: float) -> None:
    """Dahl 1968: f' = x' (f_c - f sign x') / length, however long the steps of a log are."""
    time = np.arange(0.0, 3.0, 0.02)
    expected = integrated(time, lambda s: float(s[3]), lambda s: float(0.15 * s[2] - abs(s[2]) * s[3]) / length)
    assert np.abs(expected - moved(time)).max() > 4e-6, "friction shows"
    np.testing.assert_allclose(moved(time, coulomb=0.15, presliding=length), expected, atol=6e-7)


@pytest.mark.parametrize(("power", "strength"), [(0.3, 0.1), (0.7, 0.1), (2.0, 0.1)])
def test_grease_that_thins_and_air_that_swirls_brake_by_a_power_of_the_speed(power: float, strength: float) -> None:
    """Herschel and Bulkley 1926, without a yield stress; Rayleigh 1876."""
    time = np.arange(0.0, 3.0, 0.02)

    def brake(s: FloatArray) -> float:
        speed = np.hypot(s[2], 1e-8)  # an infinite slope at standstill is more than the reference's integrator does
        return float(strength * s[2] / speed * (speed / 1e-3) ** power)

    expected = integrated(time, brake)
    assert np.abs(expected - moved(time)).max() > 5e-5, "drag shows"
    np.testing.assert_allclose(moved(time, thinning=strength, thinning_power=power), expected, atol=4e-7)


@pytest.mark.parametrize("easing", [2e-5, 1.5e-4, 1e-3])
def test_friction_that_is_eased_about_standstill_follows_its_equation(easing: float) -> None:
    time = np.arange(0.0, 3.0, 1e-3)
    expected = integrated(time, lambda s: 0.11 * np.tanh(s[2] / easing))
    np.testing.assert_allclose(moved(time, coulomb=0.11, easing=easing), expected, atol=1.5e-6)


@pytest.mark.parametrize(
    ("rubbing", "within"),
    [
        ({"coulomb": 0.05, "thinning": 0.05}, 5e-7),
        ({"coulomb": 0.03, "stiction": 0.03, "presliding": 5e-6}, 3e-6),  # as it sticks and slips
        ({"coulomb": 0.05, "easing": 5e-5, "thinning": 0.02, "thinning_power": 2.0}, 5e-7),
    ],
    ids=["grease", "bristles", "air"],
)
def test_long_steps_of_several_frictions_lead_where_short_ones_do(rubbing: dict[str, float], within: float) -> None:
    few, many = np.arange(0.0, 3.0, 0.02), np.arange(0.0, 3.0, SUBSTEP)
    expected = np.interp(few, many, moved(many, **rubbing))
    assert np.abs(expected - moved(few)).max() > 4e-6, "friction shows"
    np.testing.assert_allclose(moved(few, **rubbing), expected, atol=within)


def test_what_sticks_breaks_away_at_the_stiction() -> None:
    """An axis at rest builds up the whole stiction before it moves: its speed in the law is its own, and not that which
    the coil would give it without friction."""
    time = np.arange(0.0, 0.9, 5e-4)
    coulomb, stiction = 0.05, 0.1
    held = np.interp(time, CORNERS, WAY)  # the error while the axis stays at rest
    integral = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(time) * (held[1:] + held[:-1]))])
    breaks = time[np.argmax(KP * held + KI * integral > coulomb + stiction)]
    for speed in (1e-4, 1e-3):
        there = moved(time, coulomb=coulomb, stiction=stiction, stribeck_speed=speed)
        assert abs(time[np.argmax(there > 1e-7)] - breaks) < 3e-3


@pytest.mark.parametrize("more", [{}, {"slope": 1e-9}, {"coulomb": 1e-9}], ids=["exact", "substeps", "dry"])
def test_a_set_point_that_is_weighed_follows_its_equation(more: dict[str, float]) -> None:
    time = np.arange(0, 3, 1e-3)
    weighed, expected = moved(time, weight=0.7, **more), integrated(time, lambda s: 0.0, weight=0.7)
    assert weighed == pytest.approx(expected, abs=3e-8)
    assert np.abs(weighed - moved(time)).max() > 5e-6


@pytest.mark.parametrize("more", [{}, {"slope": 1e-9}, {"coulomb": 1e-9}], ids=["exact", "substeps", "dry"])
def test_a_loop_whose_integral_is_next_to_none_is_a_pd_loop(more: dict[str, float]) -> None:
    """A load then moves the axis for good, by itself over the proportional gain."""
    time = np.arange(0, 3, 1e-3)
    loop = Gained("axes", "actuator", ("target_1", "load_1"), ("axis_1",), **more)
    load = 0.1 * np.minimum(time, 1.0)  # N
    signals = {"target_1": np.interp(time, CORNERS, WAY), "load_1": load}
    loop.advance(loop.fresh(), time, signals)

    def slope(t: float, s: FloatArray) -> list[float]:
        force = KP * (np.interp(t, CORNERS, WAY) - s[0]) - KD * s[1] + 0.1 * min(t, 1.0)
        return [s[1], force / MASS]

    found = solve_ivp(slope, (0.0, 3.0), np.zeros(2), t_eval=time, rtol=1e-9, atol=1e-12, max_step=2e-4)
    assert signals["axis_1"] == pytest.approx(found.y[0], abs=3e-8)
    assert signals["axis_1"][-1] == pytest.approx(0.1 / KP, rel=1e-3)


def test_a_coil_meets_its_limit_by_the_force_that_a_weighed_set_point_asks_for() -> None:
    time = np.arange(0, 3, 1e-3)
    free = moved(time, weight=0.0)
    # Proportional and integral part are newtons there, and nearly cancel.
    assert moved(time, weight=0.0, force_limit=0.02) == pytest.approx(free, abs=1e-12)


@pytest.mark.parametrize("running", [0.25, 1.0])
def test_an_integral_tracks_what_a_coil_gives_that_is_limited_softly(running: float) -> None:
    """Against an independent integrator, with back-calculation as in Åström and Hägglund."""
    time, limit = np.arange(0, 3, 1e-3), 5e-3

    def slope(t: float, s: FloatArray) -> list[float]:
        error = np.interp(t, CORNERS, WAY) - s[1]
        force = KP * error + KI * s[0] - KD * s[2]
        given = limit * np.tanh(force / limit)
        return [error - (1.0 - running) * (force - given) / KP, s[2], given / MASS]

    made = moved(time, force_limit=limit, soft=1.0, windup=running)
    expected = solve_ivp(slope, (0, 3), [0.0] * 3, t_eval=time, max_step=1e-3, rtol=1e-8, atol=1e-12).y[1]
    free = moved(time)
    assert np.max(np.abs(made - expected)) < 0.1 * np.max(np.abs(free - expected))


@pytest.mark.parametrize("more", [{}, {"slope": 1e-9}], ids=["exact", "substeps"])
def test_acceleration_that_is_fed_forward_kicks_where_the_target_turns(more: dict[str, float]) -> None:
    """As a force Ka r'' of a target whose corners are rounded within 1 ms."""
    time, width, share = np.arange(0, 3, 2.5e-4), 1e-3, 0.6
    slopes = np.append(np.diff(WAY) / np.diff(CORNERS), 0.0)

    def slope(t: float, s: FloatArray) -> list[float]:
        turned = np.diff(slopes, prepend=0.0)[:-1] * (np.abs(t - CORNERS[:-1]) < 0.5 * width) / width
        target = np.interp(t, CORNERS, WAY)
        force = KP * (target - s[1]) + KI * s[0] - KD * s[2] + share * MASS * turned.sum()
        return [target - s[1], s[2], force / MASS]

    found = solve_ivp(slope, (0.0, 3.0), np.zeros(3), t_eval=time, rtol=1e-8, atol=1e-12, max_step=2e-4)
    fed = moved(time, thrust=share * MASS, **more)
    assert np.abs(fed - moved(time)).max() > 2e-6
    assert fed == pytest.approx(found.y[1], abs=3e-7)


def carded(time: FloatArray, jump: float) -> FloatArray:
    """Positions (n,) m of an axis whose card of 2 kHz takes the derivative of the error, filtered by .3 ms, and whose
    coil gives 10 N at most, sent by ``jump`` m at 0.1 s."""
    cycle, fine = 5e-4, 1e-5
    x = v = integral = rate = force = last = 0.0
    path = []
    for k in range(int(time[-1] / fine) + 2):
        if k % round(cycle / fine) == 0:
            error = (jump if k * fine >= 0.1 - 1e-9 else 0.0) - x
            rate += cycle / (cycle + 3e-4) * ((error - last) / cycle - rate)
            last = error
            asked = KP * error + integral + KD * rate
            integral += KI * error * cycle if abs(asked) < 10.0 else 0.0
            force = min(max(asked, -10.0), 10.0)
        path.append(x)
        v += fine * force / MASS
        x += fine * v
    return np.interp(time, fine * np.arange(len(path)), path)


@pytest.mark.parametrize("jump", [0.2e-3, 0.7e-3, -1.4e-3])
def test_a_coil_at_its_limit_kicks_where_the_target_jumps(jump: float) -> None:
    """Of a sound robot of an outside author with steps of .7 mm the axes were 15 sigma off behind each."""
    time = np.arange(1000) * 2.5e-4

    def off(kick: float) -> float:
        loop = AxisLoop("axes", "actuator", ("target_1", "load_1"), ("axis_1",), fed=KD, kick=kick)
        signals = {"target_1": np.where(time > 0.1 + 1e-9, jump, 0.0), "load_1": np.zeros(len(time))}
        loop.advance(loop.fresh(), time, signals)
        return float(np.max(np.abs(signals["axis_1"] - carded(time, jump))[time > 0.103]))

    best = min(off(kick) for kick in np.geomspace(5e-4, 3e-3, 15))
    assert best < 0.12 * abs(jump)  # the rest is the card's, whose delay and gains a diagnosis fits
    assert best < 0.35 * off(0.0)
