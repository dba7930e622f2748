"""Kernels and laws against closed forms, and in chunks."""

from __future__ import annotations

import doctest
import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from sim_devices.chain import FloatArray
from sim_devices.stages import kernels, laws
from sim_devices.stages.kernels import STATE, Kernel, evaluate

RNG = np.random.default_rng(8)
TIME = np.sort(RNG.uniform(0, 6, 300))
WAVE = np.sin(3 * TIME) * np.minimum(TIME, 1.0)
CASES: list[tuple[Kernel, tuple[float, ...]]] = [
    (kernels.low_pass, (0.3,)),
    (kernels.second_order, (0.2, 0.4)),
    (kernels.second_order, (0.2, 1.0)),
    (kernels.second_order, (0.2, 2.5)),
    (kernels.hurried, (0.2, 1.0, 3.0, 2.0)),
    (kernels.valve_loop, (0.2, 0.8, 3.0, 2.0, 0.5, 0.9, 0.4, 0.4, 0.2, 2.0, 0.0, 0.7, 0.0, 0.0, 0.5, 2.0, 0.6)),
    (kernels.sleeping_loop, (0.2, 0.8, 0.3, 0.3, 0.1)),
    (kernels.overlapping_loop, (0.2, 0.8, 0.3, 0.0)),
    (kernels.overlapping_loop, (0.2, 0.8, 0.3, 1.0)),
    (kernels.free_loop, (0.2, 0.8, 2.0, *np.linspace(-0.5, 0.5, kernels.FREE).tolist())),
    (kernels.sealing, (0.2, 0.5, 0.1)),
    (kernels.uneven_low_pass, (0.3, 0.05)),
    (kernels.adaptive_low_pass, (0.3, 0.5)),
    (kernels.limited_store, (0.3, 1.0, 0.8, 0.5, 2.0, 0.01)),
    (kernels.limited_store, (0.3, 1.0, 0.8, 0.5, 2.0, 0.2)),
    (kernels.sagging_store, (0.1, 1.0, 0.5, 2.0)),
    (kernels.worked_off, (-0.2, 1.5)),
    (kernels.emptying_store, (0.2, 1.0, 0.3, 0.5, 0.2)),
    (kernels.prony, (1.0, 0.3, 0.1, -0.2, 2.0)),
    (kernels.rate_limit, (0.5, 2.0)),
    (kernels.planned, (0.5, 2.0)),
    (kernels.play, (0.2,)),
    (kernels.soft_play, (0.2,)),
    (kernels.prandtl, kernels.of_joints(0.2, 0.5)),
    (kernels.resting, (0.2, 0.5, 1.0)),
    (kernels.prandtl, (0.1, 0.3, 0.4, 0.2)),
    (kernels.bouc_wen, (0.5, 0.2, 2.0)),
    (kernels.friction, (0.3, 0.5, 1.0, 0.05, 0.1)),
    (kernels.exposure_gain, (0.4, 1.0, 0.5, 5.0, 0.0)),
    (kernels.exposure_gain, (0.4, 1.0, 0.5, 5.0, 0.8)),
    (kernels.yield_flow, (0.4, 0.2, 0.5, 5.0)),
    (kernels.mullins, (0.3, 4.0)),
    (kernels.worked, (0.3, 0.4, 0.05, 2.0)),
    (kernels.by_loadings, (0.3, 1.5)),
    (kernels.faulty_samples, (0.05, 0.3, 1.0, 1.0)),
    (kernels.late_by_any, (0.05, 0.3, 1.0, 0.04)),
    (kernels.jittered, (0.05, 0.01, 1.0)),
    (kernels.random_walk, (0.2, 1.0)),
]


@pytest.mark.parametrize(("kernel", "parameters"), CASES)
def test_chunks_join_without_a_seam(kernel: Kernel, parameters: tuple[float, ...]) -> None:
    whole = evaluate(kernel, TIME, WAVE, *parameters)
    state, parts = np.zeros(STATE), []
    for a, b in itertools.pairwise([0, 1, 2, 120, 121, 300]):
        part = np.empty(b - a)
        kernel(state, TIME[a:b], WAVE[a:b], np.array(parameters), part)
        parts.append(part)
    np.testing.assert_allclose(np.concatenate(parts), whole, atol=1e-12)
    assert np.isfinite(whole).all()


@pytest.mark.parametrize(("far", "lasts"), [(1.0, 0.25 + 1.0 / 4.0), (0.2, 2.0 * np.sqrt(0.2 / 16.0))])
def test_a_planner_arrives_in_the_least_time(far: float, lasts: float) -> None:
    """At 4 /s and 16 /s²: d / v + v / a with a stretch of full speed, 2 (d / a)^(1/2) without."""
    t = np.linspace(0.0, 1.0, 2001)
    y = evaluate(kernels.planned, t, np.where(t > 0.1, far, 0.0), 4.0, 16.0)
    arrived = t[np.flatnonzero(np.abs(y - far) < 1e-3 * far)[0]] - 0.1
    assert arrived == pytest.approx(lasts, abs=0.02)
    speed = np.gradient(y, t)
    assert np.max(speed) < 4.0 * 1.01
    assert np.max(np.abs(speed[20:] - speed[:-20])) / (20 * t[1]) < 16.0 * 1.02
    assert y[-1] == pytest.approx(far, abs=1e-9)


def test_an_eased_lag_stays_finite_however_damped() -> None:
    """Explicit steps of tau / 16 diverge from a damping of 16 on, which a fit to a slow regulator reaches."""
    t = np.linspace(0.0, 2.0, 201)
    u = np.where(t > 0.2, 1.0, 0.0)
    for damping in (1.0, 30.0):
        free = evaluate(kernels.second_order, t, u, 0.01, damping)
        assert evaluate(kernels.eased, t, u, 0.01, damping, 1e4, 1e4) == pytest.approx(free, abs=2e-3)


@pytest.mark.parametrize(
    ("kernel", "more"), [(kernels.eased, (1.0, 4.0, 4.0)), (kernels.sleeping_loop, (1.0, 0.1, 0.3, 0.1))]
)
def test_a_lag_quicker_than_any_counts_as_the_quickest(kernel, more) -> None:
    """A fit that tries 1e-8 s would take minutes: its steps are parts of the lag."""
    t = np.linspace(0.0, 0.05, 6)
    u = np.where(t > 0.01, -1.0, 0.0)
    quickest = evaluate(kernel, t, u, 1e-3, *more)
    assert evaluate(kernel, t, u, 1e-6, *more).tolist() == quickest.tolist()
    assert evaluate(kernel, t, u, 2e-3, *more).tolist() != quickest.tolist()


def test_bouc_wen_of_exponent_two_is_what_small_steps_make() -> None:
    exact = evaluate(kernels.bouc_wen, TIME, WAVE, 0.5, 0.2, 2.0)
    fine = np.linspace(TIME[0], TIME[-1], 40 * len(TIME))
    stepped = evaluate(kernels.bouc_wen, fine, np.interp(fine, TIME, WAVE), 0.5, 0.2, 2.0 + 1e-9)
    np.testing.assert_allclose(exact, np.interp(TIME, fine, stepped), atol=0.01)


def uniform() -> tuple[FloatArray, FloatArray]:
    time = np.arange(0, 6, 0.02)
    return time, np.sin(3 * time)


@pytest.mark.parametrize("tau", [0.05, 0.7])
def test_low_pass_is_exact_for_linear_pieces(tau: float) -> None:
    time, wave = uniform()
    _, expected, _ = lsim(([1.0], [tau, 1.0]), wave, time)
    np.testing.assert_allclose(evaluate(kernels.low_pass, time, wave, tau), expected, atol=1e-10)


@pytest.mark.parametrize("zeta", [0.05, 0.999, 1.0, 1.001, 4.0])
def test_second_order_is_exact_for_linear_pieces(zeta: float) -> None:
    time, wave = uniform()
    _, expected, _ = lsim(([1.0], [0.09, 0.6 * zeta, 1.0]), wave, time)
    np.testing.assert_allclose(evaluate(kernels.second_order, time, wave, 0.3, zeta), expected, atol=1e-8)


@pytest.mark.parametrize("zeta", [0.3, 1.0, 2.0])
def test_a_limit_on_the_rate_out_of_reach_changes_nothing(zeta: float) -> None:
    time, wave = uniform()
    free = evaluate(kernels.second_order, time, wave, 0.3, zeta)
    np.testing.assert_allclose(evaluate(kernels.hurried, time, wave, 0.3, zeta, 99.0, 99.0), free, atol=1e-9)


def test_a_limited_rate_is_kept_and_then_caught_up() -> None:
    time = np.arange(0.0, 4.0, 0.002)
    out = evaluate(kernels.hurried, time, (time > 0.1).astype(float), 0.04, 1.0, 0.8, 0.8)
    assert np.max(np.diff(out)) <= 0.8 * 0.002 + 1e-12
    rising = (time > 0.3) & (time < 1.0)
    np.testing.assert_allclose(np.diff(out)[rising[1:]], 0.8 * 0.002, rtol=1e-6)
    assert out[-1] == pytest.approx(1.0, abs=1e-6)


def test_a_limit_that_is_approached_bends_the_rise_and_lets_slow_changes_pass() -> None:
    time = np.arange(0.0, 4.0, 0.002)
    step = (time > 0.1).astype(float)
    out = evaluate(kernels.eased, time, step, 0.04, 1.0, 0.8, 0.8)
    assert np.max(np.diff(out)) < 0.8 * 0.002
    assert out[-1] == pytest.approx(1.0, abs=1e-6)
    slow = 0.01 * np.sin(time)
    np.testing.assert_allclose(
        evaluate(kernels.eased, time, slow, 0.04, 1.0, 0.8, 0.8),
        evaluate(kernels.second_order, time, slow, 0.04, 1.0), atol=2e-6,
    )  # fmt: skip
    coarse = evaluate(kernels.eased, time[::20], step[::20], 0.04, 1.0, 0.8, 0.8)
    assert np.max(np.abs(coarse - out[::20])) < 0.03  # a step between two samples is a ramp there


def test_an_uneven_lag_is_each_of_its_lags_one_way() -> None:
    time = np.arange(0.0, 3.0, 0.01)
    step = (time >= 0.5).astype(float)
    up = evaluate(kernels.uneven_low_pass, time, step, 0.3, 0.05)
    np.testing.assert_allclose(up, evaluate(kernels.low_pass, time, step, 0.3), atol=1e-12)
    down = evaluate(kernels.uneven_low_pass, time, -step, 0.3, 0.05)
    np.testing.assert_allclose(down, -evaluate(kernels.low_pass, time, step, 0.05), atol=1e-12)


def test_a_store_gives_all_it_has_and_then_sags() -> None:
    time = np.arange(0.0, 20.0, 0.01)
    load = np.where(time < 12, -2.0, -0.2)
    out = evaluate(kernels.emptying_store, time, load, 0.1, 1.0, 0.5, 3.0, 0.1)
    whole = time < 2.0  # 1.5 of 1.0 · 3 s are missing each second
    np.testing.assert_allclose(out[whole], load[whole])
    late = (time > 2.1) & (time < 12)
    np.testing.assert_allclose(out[late] / load[late], 1 - 0.1 * (time[late] * 0.5 - 1.0), atol=2e-3)
    np.testing.assert_allclose(out[time > 14], -0.2, atol=1e-6)


def test_gaps_and_jumps_are_harmless() -> None:
    time = np.array([0.0, 1.0, 1.0 + 1e-9, 1.3, 4000.0, 4000.1])
    wave = np.array([0.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    out = evaluate(kernels.second_order, time, wave, 0.1, 1.0)
    np.testing.assert_allclose(out, [0, 0, 0, 1 - 4 * np.exp(-3.0), 1, 1], atol=1e-6)
    out = evaluate(kernels.low_pass, time, wave, 0.1)
    np.testing.assert_allclose(out, [0, 0, 0, 1 - np.exp(-3.0), 1, 1], atol=1e-6)


def test_prony_is_the_sum_of_its_lags() -> None:
    lags = [evaluate(kernels.low_pass, TIME, WAVE, tau) for tau in (0.1, 2.0)]
    expected = 0.7 * WAVE + 0.3 * lags[0] - 0.2 * lags[1]
    np.testing.assert_allclose(evaluate(kernels.prony, TIME, WAVE, 0.7, 0.3, 0.1, -0.2, 2.0), expected, atol=1e-12)


def test_hysteresis_stays_within_its_width_and_costs_energy() -> None:
    time = np.arange(0, 20, 0.01)
    wave = np.sin(2 * np.pi * time / 5)
    for kernel, parameters, within in [
        (kernels.bouc_wen, (0.5, 0.2, 2.0), 0.5),
        (kernels.prandtl, (0.1, 0.3, 0.4, 0.2), 0.5),
        (kernels.friction, (0.5, 0.5, 1.0, 0.05, 0.0), 0.5),
    ]:
        force = evaluate(kernel, time, wave, *parameters)
        assert np.abs(force).max() <= within + 1e-12
        cycle = time >= 15
        assert np.trapezoid(force[cycle], wave[cycle]) > 0.5 * 4 * within * 0.5


def test_friction_reduces_to_coulomb_and_dahl() -> None:
    time, wave = uniform()
    moving = np.sign(np.diff(wave))
    coulomb = evaluate(kernels.friction, time, wave, 0.3, 0.3, 1.0, 0.0, 0.0)
    np.testing.assert_allclose(coulomb[1:], 0.3 * moving)
    ramp = np.linspace(0, 1, 50)
    dahl = evaluate(kernels.friction, ramp, ramp, 0.3, 0.3, 1.0, 0.2, 0.0)
    np.testing.assert_allclose(dahl, 0.3 * (1 - np.exp(-ramp / 0.2)), atol=1e-12)


def test_each_loading_that_is_over_softens() -> None:
    time = np.arange(0.0, 40.0, 0.1)
    load = np.maximum(np.sin(2 * np.pi * time / 10.0), 0.0)
    gain = evaluate(kernels.by_loadings, time, load, 0.3, 1.5) / np.where(load > 0, load, 1.0)
    peaks = gain[np.isclose(time % 10.0, 2.5)]
    np.testing.assert_allclose(peaks, 1.0 + 0.3 * (1.0 - np.exp(-np.arange(4) / 1.5)))


def test_skin_is_softer_below_the_greatest_load_and_by_work() -> None:
    load = np.concatenate([np.linspace(0.0, 1.0, 101), np.linspace(1.0, 0.0, 101), np.linspace(0.0, 1.5, 151)])
    time = np.linspace(0.0, 35.0, len(load))
    virgin = evaluate(kernels.worked, time, load, 0.4, 1.0, 0.05, 10.0) / np.maximum(load, 1e-9)
    np.testing.assert_allclose(virgin[1:101], 1.0)
    np.testing.assert_allclose(virgin[[150, 252]], 1.4, rtol=1e-6)  # at half of it, going down and up again
    np.testing.assert_allclose(virgin[305:], 1.0)
    worked = evaluate(kernels.worked, time, load, 0.4, 0.0, 0.05, 10.0) / np.maximum(load, 1e-9)
    half = [50, 150, 252]
    done = np.array([np.trapezoid(load[: k + 1], time[: k + 1]) for k in half])
    np.testing.assert_allclose(worked[half], 1.0 - 0.4 * np.expm1(-done / 10.0), rtol=2e-3)


def test_random_faults_hit_the_asked_share_whatever_the_grid() -> None:
    stamps = np.arange(4000) * 0.01
    wave = np.cumsum(RNG.standard_normal(4000))
    late = evaluate(kernels.faulty_samples, stamps, wave, 0.01, 0.2, 3.0, 0.0)
    assert 0.17 < np.mean(late != wave) < 0.23
    dense = np.sort(np.concatenate([stamps, stamps + 0.004]))
    again = evaluate(kernels.faulty_samples, dense, np.interp(dense, stamps, wave), 0.01, 0.2, 3.0, 0.0)
    np.testing.assert_allclose(again[::2], late)
    by_any = stamps[1:] - evaluate(kernels.late_by_any, stamps, 2.0 * stamps, 0.01, 0.2, 1.0, 0.03)[1:] / 2
    assert 0.17 < np.mean(by_any > 1e-12) < 0.23
    assert np.mean(by_any[by_any > 1e-12]) == pytest.approx(0.03, rel=0.1)
    scatter = evaluate(kernels.jittered, stamps, 2.0 * stamps, 0.01, 0.003, 1.0)[1:] / 2 - stamps[1:]
    assert np.std(scatter) == pytest.approx(0.003, rel=0.05)
    assert abs(scatter.mean()) < 3e-4


def test_laws() -> None:
    u, t = np.linspace(-2, 2, 9), np.linspace(0, 1, 9)
    held = laws.misread(t, u, 0.2, 0.1)
    np.testing.assert_allclose(laws.affine(t, held, 0.2, 0.1)[u < 0], u[u < 0])  # the gauge shows what was commanded
    np.testing.assert_allclose(held[u >= 0], u[u >= 0])  # vented, nothing is held
    np.testing.assert_allclose(laws.saturation(t, u, 1.0), np.clip(u, -1, 1))
    assert np.abs(laws.saturation(t, 100 * u, 1.0, 1.0)).max() <= 1.0
    np.testing.assert_allclose(laws.dead_zone(t, u, 0.5), [-1.5, -1, -0.5, 0, 0, 0, 0.5, 1, 1.5])
    np.testing.assert_allclose(laws.leak(t, u, 0.1, 0.0, 1.0), 0.9 * u)
    np.testing.assert_allclose(laws.coulomb(t, u, 0.3, 0.0), 0.3 * np.sign(u))
    assert laws.stribeck(t, np.array([1e-6]), 0.3, 0.2, 0.1, 0.0)[0] == pytest.approx(0.5)
    assert (np.diff(laws.stiffening(t, u, 3.0, 2.0, 0.5)) > 0).all()
    assert laws.ramp(np.zeros(1), 0.4, 0.1)[0] == 0.0
    slope = np.gradient(laws.layered(t, np.linspace(0, 2, 200), 3.0, 0.5, 0.02), 2 / 199)
    assert slope[5] == pytest.approx(1.0, abs=1e-3)
    assert slope[-5] == pytest.approx(0.25, abs=1e-3)


def test_the_example_in_the_module_is_true() -> None:
    result = doctest.testmod(kernels)
    assert result.attempted
    assert not result.failed


def test_a_leak_closes_within_its_time_whenever_suction_comes_back() -> None:
    t = np.arange(0.0, 10.0, 0.01)
    suction = -1e4 * ((t >= 1.0) & (t < 4.0) | (t >= 6.0))
    lost = 1.0 - evaluate(kernels.sealing, t, suction, 0.1, 1.5, 500.0)[suction < 0] / suction[suction < 0]
    since = np.where(t < 4.0, t - 1.0, t - 6.0)[suction < 0]
    np.testing.assert_allclose(lost, 0.1 * np.exp(-since / 1.5), atol=1e-3)  # a step of 10 ms


def test_a_valve_falls_asleep_only_where_it_has_been_right_for_a_while() -> None:
    """On a slow ramp it lags by more than its share of the band: it stays awake, and follows. After a rest at the end
    of one it sleeps until the next has gone by the band."""
    time = np.arange(0.0, 12.0, 1e-3)
    asked = -np.interp(time, [1.0, 4.0, 8.0, 11.0], [0.0, 6e3, 6e3, 9e3])
    made = evaluate(kernels.sleeping_loop, time, asked, 0.05, 1.0, 600.0, 0.1, 0.3)
    follows = evaluate(kernels.second_order, time, asked, 0.05, 1.0)
    ramp, held, later = time < 4.0, (time > 7.0) & (time < 8.5), (time > 9.0) & (time < 11.0)
    np.testing.assert_allclose(made[ramp], follows[ramp], atol=5.0)
    assert np.ptp(made[held]) < 5.0
    np.testing.assert_allclose(made[later], follows[later], atol=60.0)


def test_a_valve_that_sleeps_corrects_when_the_pressure_itself_is_off() -> None:
    """Against Euler's rule with a tenth of the step."""
    tau, zeta, band, left, h = 0.04, 1.0, 450.0, 0.25, 2e-4
    corners = np.array([0.0, 1.0, 6.0, 8.0, 9.0, 12.0, 14.0])
    time = np.arange(0.0, 14.0, h)
    asked = -np.interp(time, corners, np.array([0.0, 0.0, 6e3, 6e3, 5.7e3, 0.0, 0.0]))
    expected, y, rate, awake = np.empty(len(time)), 0.0, 0.0, True
    for k, u in enumerate(asked):
        expected[k] = y
        off = abs(u - y)
        awake = u > -1.0 or off > band or (awake and off >= left * band)
        rate += h * ((u - y if awake else 0.0) - 2 * zeta * tau * rate) / tau**2
        y = y + h * rate
        if y > 0.0:
            y = rate = 0.0
    made = evaluate(kernels.sleeping_loop, time[::50], asked[::50], tau, zeta, band, left, 0.0)
    off = np.abs(made - expected[::50])
    assert np.median(off) < 5.0
    assert np.mean(off < 0.2 * band) > 0.95
    assert np.max(off) < 1.2 * band


@pytest.mark.parametrize("rounded", [False, True])
def test_a_spool_that_laps_over_its_port_leaves_the_last_of_an_error(rounded: bool) -> None:
    """Against an independent integrator: with a sharp edge it rests where the port is shut, with a rounded one it
    creeps on, ever more slowly."""
    tau, zeta, band = 0.05, 0.9, 600.0
    time = np.linspace(0.0, 8.0, 801)
    corners, levels = [0.0, 1.0, 1.5, 5.0, 5.5, 8.0], [0.0, 0.0, -20e3, -20e3, -12e3, -12e3]

    def rates(at: float, y: np.ndarray) -> list[float]:
        asked = float(np.interp(at, corners, levels))
        e = asked - y[0]
        seen = e - (band * np.tanh(e / band) if rounded else np.clip(e, -band, band))
        vented = not rounded and asked > -1.0
        return [y[1], ((e if vented else seen) - 2 * zeta * tau * y[1]) / tau**2]

    expected = solve_ivp(rates, (0.0, 8.0), [0.0, 0.0], t_eval=time, max_step=1e-3, rtol=1e-8, atol=1e-3).y[0]
    made = evaluate(kernels.overlapping_loop, time, np.interp(time, corners, levels), tau, zeta, band, float(rounded))
    np.testing.assert_allclose(made, expected, atol=20.0)
    at_rest = made[time > 4.5][0] + 20e3
    assert (0.0 < at_rest < 0.6 * band) if rounded else at_rest == pytest.approx(band, rel=0.05)


def test_suction_through_a_valve_is_smooth_and_ends_at_nought() -> None:
    """An empty store whose valve needs 35 mbar put the line 24 mbar above the air's pressure."""
    asked = -np.concatenate([np.linspace(0.0, 40e3, 200), np.full(200, 40e3), np.linspace(40e3, 0.0, 200)])
    time = np.linspace(0.0, 60.0, len(asked))
    emptied = evaluate(kernels.limited_store, time, asked, 0.9, 30e3, 20e3, 0.5, 300.0, 3.5e3)
    assert np.all((emptied <= 0.0) & (emptied >= asked))
    full = evaluate(kernels.limited_store, time, asked, 1e-9, 30e3, 40e3, 0.0, 300.0, 3.5e3)
    assert full[300] == pytest.approx(
        -40e3 + 3.5e3 * np.log(2.0), abs=1.0
    )  # where the store has just what is asked for
    assert np.max(np.abs(np.diff(full))) < 400.0


@pytest.mark.parametrize("load", [0.2, 1.0, 3.0])
def test_exposure_comes_to_the_load_or_to_one(load: float) -> None:
    """w' = q - w, or q (1 - w), in units of the time it takes."""
    time = np.linspace(0.0, 8.0, 400)
    for end, expected in ((0.0, load * (1.0 - np.exp(-time / 2.0))), (1.0, 1.0 - np.exp(-load * time / 2.0))):
        gain = evaluate(kernels.exposure_gain, time, np.full(400, load), 0.3, 1.0, 2.0, 5.0, end) / load
        np.testing.assert_allclose(gain, 1.0 + 0.3 * expected, rtol=1e-9)


def test_an_adaptive_filter_lets_motion_pass_and_is_late_at_rest() -> None:
    """Against an independent integrator: tau y' = (u - y) (1 + ((u - y) / reach)²)."""
    time, tau, reach = np.arange(0.0, 4.0, 1e-3), 0.3, 0.5

    def u(t: float) -> float:
        return float(np.sin(3.0 * t)) * t

    def slope(t: float, y: FloatArray) -> FloatArray:
        away = u(t) - y
        return away * (1.0 + (away / reach) ** 2) / tau

    expected = solve_ivp(slope, (0.0, 4.0), [0.0], t_eval=time, rtol=1e-8, atol=1e-10).y[0]
    found = evaluate(kernels.adaptive_low_pass, time, np.array([u(t) for t in time]), tau, reach)
    np.testing.assert_allclose(found, expected, atol=4e-3)
    plain = evaluate(kernels.low_pass, time, np.array([u(t) for t in time]), tau)
    assert np.max(np.abs(plain - expected)) > 0.2


def test_a_random_walk_grows_with_the_root_of_time() -> None:
    time = np.arange(0.0, 400.0, 0.02)
    ends = []
    for seed in range(6):
        walked = evaluate(kernels.random_walk, time, np.zeros(len(time)), 0.3, float(seed))
        ends += [float(np.mean(np.square(walked[n:] - walked[:-n])) / (n * 0.02)) for n in (50, 500)]
    assert np.sqrt(np.mean(ends)) == pytest.approx(0.3, rel=0.15)
    one, other = (evaluate(kernels.random_walk, time, np.zeros(len(time)), 0.3, s) for s in (1.0, 2.0))
    assert np.abs(np.corrcoef(np.diff(one[::10]), np.diff(other[::10]))[0, 1]) < 0.1
