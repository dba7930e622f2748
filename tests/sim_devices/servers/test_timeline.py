"""From executed waveforms to nodes and commands."""

from __future__ import annotations

import numpy as np
import pytest

from sim_devices.servers.timeline import JUMP, Waveform, commanded, grid


def nodes_and_values(first: int, count: int, time: list[float], values: list[float]) -> tuple[np.ndarray, np.ndarray]:
    wave = Waveform(np.array(time), np.array(values)[:, None])
    nodes = grid(first, count, 10.0, 2, wave)
    ((_, commands),) = commanded(wave, nodes, ("pressure",))
    return nodes, commands


def test_even_nodes_join_the_stretch_before() -> None:
    first, _ = nodes_and_values(0, 3, [0.0, 0.2], [0.0, 0.0])
    second, _ = nodes_and_values(3, 2, [0.2, 0.4], [0.0, 0.0])
    assert np.allclose(np.concatenate([first, second]), np.arange(9) * 0.05)


@pytest.mark.parametrize("at", [0.23, 0.25, 0.4, 0.3 + 1e-13])
def test_a_step_takes_one_jump(at: float) -> None:
    nodes, commands = nodes_and_values(3, 3, [0.2, at, at, 0.5], [0.0, 0.0, -1.0, -1.0])
    assert np.all(np.diff(nodes) > 0.2 * JUMP)
    assert np.all(commands[nodes < at - 1.5 * JUMP] == 0.0)
    assert np.all(commands[nodes > at + 0.5 * JUMP] == -1.0)
    assert np.abs(np.interp([at - 2 * JUMP, at + 2 * JUMP], nodes, commands) - [0.0, -1.0]).max() < 1e-6


def test_a_step_at_the_seam_comes_right_after_it() -> None:
    nodes, commands = nodes_and_values(3, 2, [0.2, 0.2, 0.4], [0.0, -1.0, -1.0])
    assert nodes[0] == pytest.approx(0.2, abs=1.5 * JUMP)
    assert nodes[0] > 0.2
    assert np.all(commands == -1.0)


def test_of_several_steps_at_once_only_the_ends_count() -> None:
    _, commands = nodes_and_values(3, 3, [0.2, 0.3, 0.3, 0.3, 0.3, 0.5], [0.0, 0.0, -5.0, -7.0, -1.0, -1.0])
    assert commands.min() == -1.0


def test_a_step_at_the_last_node_belongs_to_it() -> None:
    nodes, commands = nodes_and_values(3, 2, [0.2, 0.4, 0.4], [0.0, 0.0, -1.0])
    assert nodes[-1] == 0.4
    assert commands[-1] == -1.0
    assert commands[-3] == 0.0
