"""Nodes of the robot's loop."""

from __future__ import annotations

import numpy as np
import pytest

from gap.design import simulated as own
from gap.effects.load import library
from gap.inference.hypothesis import Candidate
from gap.null import robot_axes, robot_force, robot_grid
from gap.null.groups import GroupedSession
from gap.null.robot_axes import QUANTITIES, AxesBlock
from gap.null.robot_force import ForceBlock
from gap.null.robot_grid import KINK, commanded, loop_grid
from sim_devices.chain import FloatArray
from sim_devices.stages.axes import AxisLoop
from sim_devices.stages.operators import Delay, Polled


def test_a_step_begins_when_it_comes() -> None:
    """From the node before it, up to 20 ms away, the loop was simulated as on a ramp: sound robots were told a latency
    of 5 ms."""
    time, value = np.array([0.0, 1.5, 1.5, 3.0]), np.array([0.0, 0.0, 1.0, 1.0])
    grid = loop_grid(np.array([0.0, 1.5, 3.0]), time, -0.5, 3.5)
    signal = np.interp(grid, time, value)
    assert np.max(signal[grid < 1.5 - 0.5 * KINK]) == 0.0
    assert grid[grid < 1.5 - 0.5 * KINK][-1] >= 1.5 - 1.5 * KINK
    assert np.interp(1.499, grid, signal) == 0.0


def test_a_step_that_is_late_begins_when_it_is_due() -> None:
    """Delays show the command's own rows, and those of every quantity: there are nodes on both sides of when a step is
    due, though the command of another axis rests."""
    steps = np.array([0.0, 1.5, 1.5, 3.0]), np.array([0.0, 0.0, 1.0, 1.0])
    tables = {"command_x": (np.array([0.0, 3.0]), np.zeros(2)), "command_y": steps}
    late = Delay("latency", "timing", tuple(tables), ("due_x", "due_y"), delay=0.0123)
    grid = loop_grid(np.array([0.0, 1.5, 3.0]), np.unique(steps[0]), -0.5, 3.5, (late,))
    due = commanded(grid, tables, (late,))["due_y"]
    before = grid < 1.5123 - 0.5 * KINK
    assert np.max(np.abs(due[before])) < 1e-6
    assert np.min(due[grid > 1.5123 + 0.5 * KINK]) == pytest.approx(1.0, abs=1e-6)
    assert grid[before][-1] >= 1.5123 - 1.5 * KINK


@pytest.mark.parametrize("delay", [0.0, 0.84e-3, -0.84e-3])
def test_an_axis_is_right_between_the_nodes_behind_a_step(delay: float) -> None:
    """With nodes 4 ms apart a step of 0.5 mm was 30 µm off, by another amount when it was late: a sound loop was told
    jitter, and a skew of the clock that it had not."""
    steps = {"command_x": (np.array([0.0, 1.5, 1.5, 3.0]), np.array([0.0, 0.0, 5e-4, 5e-4]))}
    late = Delay("latency", "timing", ("command_x",), ("due_x",), delay=delay)
    loop = AxisLoop("axes", "actuator", ("due_x", "load"), ("axis",))
    grid = loop_grid(np.array([0.0, 1.5, 3.0]), np.array([0.0, 1.5, 3.0]), -0.5, 3.5, (late,))
    fine = np.union1d(grid, np.arange(1.4, 2.0, 1e-4))
    made = []
    for time in (grid, fine):
        signals = commanded(time, steps, (late,))
        loop.advance(loop.fresh(), time, signals)
        made.append(np.interp(fine, time, signals["axis"]))
    assert np.max(np.abs(made[0] - made[1])) < 3e-6


@pytest.mark.parametrize("delay", [0.0, 0.0123])
def test_a_curve_is_as_high_as_it_is(delay: float) -> None:
    """The chords of a sine of 1 Hz and 0.4 mm, 20 ms apart, are 0.5 µm too flat: 70 of χ² in a recording of 12 s."""
    time = np.arange(0.0, 4.0, 1e-3)
    late = Delay("latency", "timing", ("command_x",), ("due_x",), delay=delay)
    grid = np.arange(0.0, 4.0, 0.02)
    made = commanded(grid, {"command_x": (time, 4e-4 * np.sin(2 * np.pi * time))}, (late,))["due_x"]
    fine = np.linspace(0.5, 3.5, 3001)
    off = np.interp(fine, grid, made) - 4e-4 * np.sin(2 * np.pi * (fine - delay))
    means = off[:-1].reshape(-1, 20).mean(axis=1)
    assert np.max(np.abs(means)) < 0.02e-6


def test_looks_that_begin_anew_are_nodes() -> None:
    looks = Polled("polled", "timing", ("u",), ("v",), period=0.2, phase=0.5, marks=(0.0, 1.05))
    grid = loop_grid(np.array([0.0, 3.0]), np.array([0.0, 3.0]), -0.5, 3.5, (looks,))
    for moment in (0.1, 0.9, 1.15, 2.95):
        assert np.min(np.abs(grid - moment)) < 0.1 * KINK


def test_a_clock_is_the_same_as_an_effect_and_as_a_tolerance() -> None:
    """A quartz 160 ppm off was worth 100 of χ² less as an effect than as a strained tolerance: what is delayed missed
    the corners of motion along y, and read a sine between the nodes of its chords."""
    skew = library("microrobot")["clock_skew[form=1]"]
    legs = [own.direction_cycles(a, 0.0, 1.2e-3, 8.0, 1) for a in (0.0, 0.5 * np.pi)]
    legs += [own.Leg(waving_tables(0.8), 12.0)]
    session = GroupedSession(own.robot_session(np.random.default_rng(3), legs=legs), QUANTITIES)
    axes = AxesBlock(session, {"clock_skew[form=1]": skew})
    candidate = Candidate("clock_skew[form=1]", "clock_skew", "timing", skew.parameters, ("axes",))
    strained = axes.prior_mean.copy()
    strained[4] = -1.6e-4
    tolerated = axes.evaluate(strained, {}, want_jacobian=False).residual
    acting = axes.evaluate(axes.prior_mean, {candidate: {"rate": 1.6e-4}}, want_jacobian=False).residual
    assert np.sum(np.square(tolerated - acting)) < 1.0


def waving_tables(frequency: float) -> dict[str, tuple[FloatArray, FloatArray]]:
    """The tip on a circle that swells and fades in 12 s, at a frequency in Hz."""
    time = np.arange(0.0, 12.0, 0.01)
    swelling = 1.2e-3 * np.sin(np.pi * time / 12.0) ** 2
    turn = 2 * np.pi * frequency * time
    return {
        f"probe_{a}": (time, share * swelling * wave)
        for a, share, wave in zip("xyz", (0.8, 0.5, 0.3), (np.sin(turn), 1.0 - np.cos(turn), np.sin(turn)), strict=True)
    }


def moving_tables() -> dict[str, tuple[FloatArray, FloatArray]]:
    """The tip goes to and fro with the least jerk (Flash and Hogan 1985), in .12 s each, and holds in between."""
    time = np.arange(0.0, 12.0, 2.5e-3)
    parts = [np.clip((time - begin) / 0.12, 0.0, 1.0) for begin in (1.0, 3.5, 6.0, 8.5)]
    ways = [s**3 * (10.0 - 15.0 * s + 6.0 * s**2) for s in parts]
    x, y = ways[0] - 2.0 * ways[1] + ways[2], ways[2] - ways[3]
    return {"probe_x": (time, 0.8e-3 * x), "probe_y": (time, 0.6e-3 * y), "probe_z": (time, np.zeros(len(time)))}


@pytest.mark.parametrize(
    "tables",
    [*(waving_tables(frequency) for frequency in (0.1, 0.25, 0.8, 1.5)), moving_tables()],
    ids=["0.1 Hz", "0.25 Hz", "0.8 Hz", "1.5 Hz", "quick moves between holds"],
)
def test_curved_motion_is_simulated_finely_enough(
    tables: dict[str, tuple[FloatArray, FloatArray]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else commands seen now and then, whose grid is finer, explain a part of the error; skin that follows a sine of
    1.5 Hz by nodes 0.1 s apart was 30 times the noise off, and so was an axis that moves within .12 s by nodes .05 s
    apart, as the holds between need no more."""
    recordings = own.robot_session(np.random.default_rng(8), [], legs=[own.Leg(tables, 12.0)])
    session = GroupedSession(recordings, QUANTITIES)

    def predicted() -> tuple[np.ndarray, np.ndarray]:
        axes = AxesBlock(session, {})
        force = ForceBlock(session, {}, axes)
        return axes._predict(axes.prior_mean, {}) / axes.sigma, -force.evaluate(force.prior_mean, {}).residual

    usual = predicted()
    monkeypatch.setattr(robot_axes, "LOOP_STEP", 0.25 * robot_grid.LOOP_STEP)
    monkeypatch.setattr(robot_axes, "LOOP_TURN", 0.25 * robot_grid.LOOP_TURN)
    monkeypatch.setattr(robot_force, "SHEET_STEP", 0.25 * robot_force.SHEET_STEP)
    monkeypatch.setattr(robot_force, "SHEET_TURN", 0.25 * robot_force.SHEET_TURN)
    for coarse, fine, most in zip(usual, predicted(), (0.01, 0.03), strict=True):
        assert np.mean(np.square(fine - coarse)) < most
