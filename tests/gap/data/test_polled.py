"""Ripple of commands that a controller looks at now and then."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from gap.data.polled import looks_at_commands, ripple_of
from gap.data.signatures import HUM, find

NAMES = ("axis_position_1", "axis_position_2", "axis_position_3")
TIME = np.arange(0.0, 20.0, 1e-3)


def followed(recording, interval: float, seed: int, hum: float = 0.0, rate: int = 10):
    """Three axes that follow sines within 8 ms, sampled at 100 Hz with 10 µm of noise; a command is held for
    ``interval`` s."""
    rng, streams = np.random.default_rng(seed), {}
    seen = np.floor((TIME + 0.37 * interval) / interval) * interval - 0.37 * interval if interval else TIME
    for k, name in enumerate(NAMES):
        command = 1.5e-3 * np.sin(2 * np.pi * (0.15 + 0.1 * k) * seen + k) * (seen > 3.0)
        way = lfilter([1.0 - np.exp(-1 / 8.0)], [1.0, -np.exp(-1 / 8.0)], command)
        way = way + hum * np.sin(2 * np.pi * 31.0 * TIME)
        streams[name] = way[::rate] + 1e-5 * rng.normal(size=len(way[::rate]))
    return recording(streams, TIME[::rate])


@pytest.mark.parametrize(("interval", "seen"), [(0.0408, 24.5), (0.0181, 44.75)])  # the latter by its alias
def test_a_ripple_that_goes_with_the_speed_is_a_controllers_look(recording, interval: float, seen: float) -> None:
    session = [followed(recording, interval, k) for k in range(4)]
    assert looks_at_commands(session, NAMES) == pytest.approx(seen, abs=0.1)
    marks = find(session)
    assert [s.effect for s in marks if s.certain] == ["latency"]
    assert not [s for s in marks if s.effect == HUM]


@pytest.mark.parametrize("hum", [0.0, 4e-6])
def test_neither_noise_nor_a_pump_is_one(recording, hum: float) -> None:
    assert looks_at_commands([followed(recording, 0.0, k, hum) for k in range(4)], NAMES) is None


@pytest.mark.parametrize("every", [20, 100])
def test_steps_of_a_staircase_are_no_looks(recording, every: int) -> None:
    """Steps every 2 s and the answers to them leave lines at each multiple of half a hertz: friction at the rim was
    told a latency for sure, and a sound session at 10 Hz, whose differences reach farther, jitter."""
    rng, session = np.random.default_rng(5), []
    levels = 1e2 * np.array([0, 60, 140, 220, 300, 220, 140, 60, 0])
    for _ in range(4):
        table = np.repeat(levels, 2), np.repeat(2.05 + 2.0 * np.arange(8), 2)
        corners = np.concatenate([[0.0], table[1], [20.0]])
        way = np.interp(TIME, corners + 1e-9 * np.arange(len(corners)), table[0])
        for tau in (60.0, 12.0):
            way = lfilter([1.0 - np.exp(-1 / tau)], [1.0, -np.exp(-1 / tau)], way)
        means = way.reshape(-1, every).mean(axis=1)  # stamped where they begin
        stream = {"pressure": -means + 30.0 * rng.normal(size=len(means))}
        session.append(recording(stream, TIME[::every], {"pressure": (corners, -table[0])}))
    assert ripple_of([(r.streams["pressure"].time, r.streams["pressure"].value) for r in session]) is not None
    assert looks_at_commands(session, ("pressure",)) is None


def test_nothing_is_told_of_channels_that_rest_or_are_short(recording) -> None:
    rng = np.random.default_rng(0)
    rests = [{n: rng.normal(size=len(TIME[::10])) for n in NAMES} for _ in range(3)]
    assert looks_at_commands([recording(rest, TIME[::10]) for rest in rests], NAMES) is None
    assert looks_at_commands([recording({n: v[:50] for n, v in rests[0].items()}, TIME[:500:10])], NAMES) is None


@pytest.mark.parametrize("own", [False, True])
def test_rare_looks_are_told_and_their_interval_to_a_millionth(own: bool) -> None:
    """Five looks a second at the command of a regulator of 40 ms, whose gauge is read a hundred times a second: its
    fourth differences show noise only, those of means over four samples a line. All by one clock, or each recording
    by its own."""
    rng, paths, interval = np.random.default_rng(3), [], 0.2003
    for begin in (0.0, 60.0, 131.7, 240.1):
        time = np.arange(0.0, 30.0, 1e-3)
        since = time + (0.0 if own else begin)
        seen = np.floor(since / interval) * interval - (since - time)
        command = 1.0e4 * (1.0 - np.cos(0.6 * np.clip(seen - 2.0, 0.0, None)))
        pressure = lfilter([1.0 - np.exp(-1 / 40.0)], [1.0, -np.exp(-1 / 40.0)], command)[::10]
        paths.append((begin + time[::10], pressure + 50.0 * rng.normal(size=len(pressure))))
    ripple = ripple_of(paths)
    assert ripple is not None
    assert ripple.frequency == pytest.approx(1.0 / interval, abs=0.02)
    assert ripple.intervals[1 if own else 0] == pytest.approx(interval, rel=5e-5)
