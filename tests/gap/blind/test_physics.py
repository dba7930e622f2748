"""The generator's own physics against closed forms and published ranges."""

from __future__ import annotations

import numpy as np
import pytest

from gap.blind import controllers, robot, robot_tissue, signals, suction, tissue
from gap.blind.instants import taken
from gap.blind.robot_axes import Loop, loops
from gap.blind.robot_kinematics import (
    PIVOTS,
    TIP,
    axes_for,
    force_matrix,
    tip,
    tip_and_tilt,
)
from gap.blind.session import suction_session

STEP = 2.5e-3


def grid(seconds: float) -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(0, seconds, STEP)
    return t, np.full(t.size, STEP)


def test_regulator_follows_a_ramp_as_two_equal_lags_do(subjects):
    s = subjects["cutometer"].session
    r = next(r for r in s.recordings if r.condition.startswith("ramp"))
    p = suction.chamber_suction(s, {}, np.random.default_rng(0))
    onset, slope = r.start + r.onset, r.corners[2][1] / (r.corners[2][0] - r.corners[1][0])
    t = onset + np.linspace(0.01, 5, 200)
    x = (t - onset) * controllers.OMEGA
    exact = slope / controllers.OMEGA * (x - 2 + (x + 2) * np.exp(-x))
    assert np.interp(t, s.t, p) == pytest.approx(exact, abs=2.0)


def test_lag_is_exact_for_a_ramp():
    t, dt = grid(3.0)
    assert signals.lag(t, dt, 0.3) == pytest.approx(t - 0.3 * (1 - np.exp(-t / 0.3)), abs=1e-12)


def test_power_law_memory_grows_as_its_power():
    t = np.concatenate([[0.0, 1e-6], np.geomspace(1e-2, 300, 2000)])
    step = np.where(t > 0, 1.0, 0.0)
    creep = signals.power_law_memory(step, np.diff(t, prepend=-1e-6), 0.25)
    inside = (t > 0.3) & (t < 100)
    slope = np.polyfit(np.log(t[inside]), np.log(creep[inside]), 1)[0]
    assert slope == pytest.approx(0.25, abs=0.03)


def test_play_and_bristle_make_loops_that_do_not_depend_on_rate():
    t, _ = grid(4.0)
    x = np.sin(np.pi * t)
    y = signals.play(x, 0.2)
    assert y.max() == pytest.approx(0.8, abs=1e-3)
    assert np.ptp(x - y) == pytest.approx(0.4, abs=1e-9)
    assert signals.bristle(x, 0.05)[::4][-50:] == pytest.approx(signals.bristle(x[::4], 0.05)[-50:], abs=0.05)


def test_coarsened_adds_only_the_error_beyond_the_nominal_rounding():
    x = np.linspace(0, 1, 1001)
    assert signals.coarsened(x, 0.01, 0.0, 0.0, noisy=False) == pytest.approx(x)
    rounded = signals.coarsened(x, 0.01, 0.0, 0.0, noisy=True)
    assert rounded * 100 == pytest.approx(np.round(rounded * 100))


def test_conventional_skin_creeps_to_its_limit():
    _, dt = grid(200.0)
    p = tissue.draw("cutometer", np.random.default_rng(1))
    s = np.full(dt.size, 300e2)
    s[0] = 0.0
    h = tissue.conventional(s, dt, p)
    assert h[-1] / p["amplitude"] == pytest.approx(1 + p["fast"] + p["slow"], rel=1e-6)
    assert h[1] / p["amplitude"] == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize(("instrument", "low", "high"), [("cutometer", 0.1e-3, 0.6e-3), ("aspiration", 0.5e-3, 3.5e-3)])
@pytest.mark.parametrize("law", list(tissue.LAWS))
def test_heights_are_in_the_published_range(instrument: str, low: float, high: float, law: str):
    rng = np.random.default_rng(11)
    for _ in range(6):
        p = tissue.draw(instrument, rng)
        _, dt = grid(12.0)
        levels = (150e2, 450e2) if instrument == "cutometer" else (66e2, 200e2)
        heights = [tissue.LAWS[law](np.where(np.arange(dt.size) > 40, s, 0.0), dt, p).max() for s in levels]
        assert 0.8 * low < heights[0] < heights[1] < 1.15 * high


def test_platform_satisfies_its_six_constraints():
    target = np.random.default_rng(0).uniform(-1.4e-3, 1.4e-3, (20, 3))
    q = axes_for(target)
    assert tip(q) == pytest.approx(target, abs=1e-11)
    moved, normal = tip_and_tilt(q, PIVOTS, TIP)
    for k in range(len(q)):
        centre = moved[k] + [0, 0, TIP] - TIP * normal[k]
        arms = np.column_stack([PIVOTS, q[k]]) - centre
        arms /= np.linalg.norm(arms, axis=1, keepdims=True)
        assert arms @ normal[k] == pytest.approx(0, abs=1e-12)
        assert [arms[0] @ arms[1], arms[1] @ arms[2], arms[2] @ arms[0]] == pytest.approx([-0.5] * 3, abs=1e-12)


def test_pushing_into_skin_compresses_all_three_transducers():
    legs = np.linalg.solve(force_matrix(), [0.0, 0.0, -1.2])
    assert legs == pytest.approx([0.4] * 3)


def loop(**effects: float) -> Loop:
    idle = dict.fromkeys(Loop._fields, 0.0) | {"stribeck_speed": 1e-3, "bristle": 1e-5, "cog_pitch": 1e-3}
    sound = {"mass": robot.MASS, "kp": robot.KP, "ki": robot.KI, "kd": robot.KD, "drag": robot.DRAG}
    return Loop(**(idle | sound | effects))


def test_loop_error_under_a_growing_load_is_the_integral_terms():
    n, rate = 4000, 0.2
    load = np.zeros((n, 3))
    load[:, 0] = rate * np.arange(n) * 5e-3
    still = np.zeros((n, 3))
    q = loops(still, load, still, np.zeros((3, 3)), 1.25e-3, loop(), np.zeros(3), np.zeros((2, 3)))
    assert q[-1, 0] == pytest.approx(rate / robot.KI, rel=1e-3)
    assert np.all(q[:, 1:] == 0)


def test_dry_friction_holds_a_load_below_its_bound():
    n = 400
    still, load = np.zeros((n, 3)), np.full((n, 3), 0.3)
    free = loop(kp=0.0, ki=0.0, kd=0.0)
    assert np.all(loops(still, load, still, np.zeros((3, 3)), 1.25e-3, free, np.full(3, 0.31), np.zeros((2, 3))) == 0)
    assert loops(still, load, still, np.zeros((3, 3)), 1.25e-3, free, np.full(3, 0.2), np.zeros((2, 3)))[-1, 0] > 1e-3


@pytest.mark.parametrize("law", list(robot_tissue.LAWS))
def test_robot_forces_and_losses_are_in_the_reported_range(subjects, with_law, law: str):
    subject = with_law(subjects["microrobot"], law)
    recorded = subject.record({})
    for k, r in enumerate(subject.session.recordings):
        if r.specimen != "skin" or not r.condition.startswith("slow"):
            continue
        u = np.stack([recorded[c][k] for c in robot.PROBE], axis=1) @ r.direction
        f = -np.stack([recorded[c][k] for c in robot.FORCE], axis=1) @ r.direction
        last = slice(2100, 3100)
        work = np.diff(u[last]) * 0.5 * (f[last][1:] + f[last][:-1])
        assert 0.3 < f.max() < 2.0
        assert 0.08 < work.sum() / work[work > 0].sum() < 0.55


def test_reference_recordings_show_no_skin(subjects):
    for instrument, answer in (("cutometer", "apex_height"), ("microrobot", "force_x")):
        subject = subjects[instrument]
        recorded = subject.record({})
        for k, r in enumerate(subject.session.recordings):
            reference = r.specimen != "skin"
            assert (np.abs(recorded[answer][k]).max() < 1e-12) == reference or not reference


def test_delivered_samples_are_nominal_without_knobs():
    stamps = np.arange(50) / 100.0
    nominal = taken(stamps, 0.01, 0, {}, np.random.default_rng(0))
    assert np.array_equal(nominal.main, stamps)
    assert np.array_equal(nominal.row, np.arange(50))
    dropped = taken(stamps, 0.01, 0, {"drop": 0.5}, np.random.default_rng(0))
    assert np.all(np.diff(dropped.row) >= 0)
    assert np.all(dropped.row <= np.arange(50))


def test_sessions_have_repeats_levels_and_two_waveforms():
    for seed in range(5):
        s = suction_session("cutometer", np.random.default_rng(seed), reference=bool(seed % 2))
        skin = [r for r in s.recordings if r.specimen == "skin"]
        assert max(r.repeat for r in skin) >= 2
        assert {"hold", "ramp"} <= {r.condition.split()[0] for r in skin}
        assert len({r.condition for r in skin if r.condition.startswith("hold")}) == 3
        starts = [r.start for r in s.recordings]
        assert starts == sorted(starts)
