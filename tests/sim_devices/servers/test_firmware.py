"""The queue, the limits and the states of a simulated instrument, without bytes and without physics."""

from __future__ import annotations

import contextlib
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from drivers import messages as msg
from drivers.device import Identity, Refused
from protocols.limits import PROBE, Limits, Range
from sim_devices.servers.firmware import Firmware

PRESSURE = Limits({"pressure": Range(-5e4, 0.0)})
PROBES = Limits({**{f"probe_{k}": Range(-3e-3, 3e-3, rate=0.02) for k in "xyz"}, PROBE: Range(0.0, 3e-3, rate=0.02)})


def suction() -> Firmware:
    return Firmware(Identity("m", "s", "f"), ("pressure",), ("pressure", "apex_height"), 4, PRESSURE)


def robot() -> Firmware:
    return Firmware(Identity("m", "s", "f"), ("probe_x", "probe_y", "probe_z"), ("axis_position_1",), 8, PROBES)


def armed(firmware: Firmware) -> Firmware:
    firmware.handle(msg.Arm(firmware.hardware.ranges, 0.25), 0.0)
    return firmware


def piece(duration: float, *ends: float) -> msg.Piece:
    return msg.Piece(duration, (ends[0],), (ends[1],))


def test_executes_pieces_without_gaps_however_it_is_advanced() -> None:
    pieces = (piece(0.0, -1e3, -1e3), piece(1.0, -1e3, -2e3), piece(0.5, -2e3, -2e3), piece(0.0, 0.0, 0.0))
    for steps in ([2.0], [0.3, 0.31, 1.0, 1.7, 2.0], np.arange(1, 201) / 100):
        firmware = armed(suction())
        firmware.handle(msg.Enqueue(pieces), 0.0)
        firmware.handle(msg.Start(), 0.0)
        waves = [firmware.advance(t) for t in steps]
        time = np.concatenate([w.time for w in waves])
        values = np.concatenate([w.values[:, 0] for w in waves])
        assert np.all(np.diff(time) >= 0)
        for t, expected in ((0.2, -1200.0), (0.9, -1900.0), (1.3, -2000.0), (1.6, 0.0)):
            assert np.interp(t, time, values) == pytest.approx(expected)
        assert firmware.executed == 4
        assert firmware.began == pytest.approx(1.5)
        assert firmware.status.queued == 0
        assert firmware.resting


def test_skip_ends_where_it_is_and_the_next_begins_there() -> None:
    firmware = armed(suction())
    firmware.handle(msg.Enqueue((piece(10.0, 0.0, -1e4), piece(1.0, -1e4, 0.0))), 0.0)
    firmware.handle(msg.Start(), 0.0)
    firmware.advance(2.0)
    firmware.handle(msg.Skip(1), 0.0)  # an old wish, of a segment that is not the running one
    assert firmware.executed == 0
    firmware.handle(msg.Skip(0), 0.0)
    firmware.handle(msg.Skip(0), 0.0)
    assert firmware.executed == 1
    assert firmware.began == 2.0
    wave = firmware.advance(2.5)
    assert wave.values[0, 0] == pytest.approx(-2e3)
    assert wave.values[-1, 0] == pytest.approx(-1e3)


def test_knows_when_its_queue_runs_dry() -> None:
    firmware = armed(suction())
    assert firmware.horizon == math.inf
    firmware.handle(msg.Start(), 0.0)
    assert firmware.starved
    assert firmware.horizon == math.inf
    firmware.handle(msg.Enqueue((piece(0.0, -1e3, -1e3),)), 0.0)
    assert not firmware.starved
    firmware.handle(msg.Enqueue((piece(2.0, -1e3, -1e3), piece(1.0, -1e3, 0.0))), 0.0)
    firmware.advance(0.5)
    assert firmware.horizon == pytest.approx(3.0)
    firmware.advance(3.0)
    assert firmware.starved
    firmware.handle(msg.Hold(), 0.0)
    assert not firmware.starved


def test_the_robot_never_jumps() -> None:
    firmware = armed(robot())
    far = (1e-3, 0.0, 0.0)
    hold = msg.Piece(1.0, far, far)
    firmware.handle(msg.Enqueue((hold,)), 0.0)
    with pytest.raises(Refused, match="jumps"):
        firmware.handle(msg.Enqueue((msg.Piece(1.0, (0.0,) * 3, far),)), 0.0)
    with pytest.raises(Refused, match="faster than"):
        firmware.handle(msg.Enqueue((msg.Piece(0.01, far, (0.0,) * 3),)), 0.0)
    with pytest.raises(Refused, match="reach"):
        firmware.handle(msg.Enqueue((msg.Piece(1.0, far, (2.5e-3, 2.5e-3, 0.0)),)), 0.0)
    firmware.handle(msg.Start(), 0.0)
    approach = firmware.advance(0.06)
    speed = np.abs(np.diff(approach.values[:, 0]) / np.diff(approach.time)).max()
    assert speed == pytest.approx(0.02)
    assert firmware.executed == 0
    assert firmware.began == pytest.approx(0.05)  # the approach is not the host's segment
    firmware.handle(msg.Hold(), 0.0)
    assert not firmware.resting
    back = firmware.advance(0.2)
    assert np.nanmax(np.abs(np.diff(back.values[:, 0])[1:])) <= 0.02 * 0.06
    assert firmware.resting


def test_a_limit_of_the_probe_says_nothing_of_a_pressure() -> None:
    firmware = suction()
    firmware.handle(msg.Arm({**PRESSURE.ranges, PROBE: Range(0.0, 2e-3)}, 0.25), 0.0)
    firmware.handle(msg.Enqueue((piece(1.0, 0.0, -1e4),)), 0.0)
    assert firmware.status.queued == 1


def test_a_measured_value_out_of_limits_is_a_fault() -> None:
    firmware = armed(suction())
    firmware.watch_values(np.array([[-4e4, 0.0], [np.nan, 0.0]]))
    assert firmware.state == "armed"
    firmware.watch_values(np.array([[-5.2e4, 0.0]]))  # within the margin: the host's interlock judges this
    assert firmware.state == "armed"
    firmware.watch_values(np.array([[-4e4, 0.0], [-6e4, 0.0], [-4e4, 0.0]]))
    assert firmware.state == "armed"  # once may be a disturbance on a wire
    firmware.watch_values(np.array([[-4e4, 0.0], [-6e4, 0.0]]))
    firmware.watch_values(np.array([[-6e4, 0.0]]))
    assert firmware.state == "fault"
    assert "pressure -60000 is outside" in firmware.fault


@pytest.mark.parametrize(
    ("limits", "watchdog", "words"),
    [
        ({}, 0.25, "no finite limits for pressure"),
        ({"pressure": Range(-math.inf, 0.0)}, 0.25, "no finite limits"),
        ({"pressure": Range(-6e4, 0.0)}, 0.25, "hardware allows"),
        ({"pressure": Range(-1e4, 1e4)}, 0.25, "hardware allows"),
        *[({"pressure": Range(-1e4, 0.0)}, bad, "watchdog") for bad in (0.0, -1.0, 1.01, 1e6, math.inf, math.nan)],
    ],
)
def test_refuses_to_arm(limits: dict[str, Range], watchdog: float, words: str) -> None:
    firmware = suction()
    with pytest.raises(Refused, match=words):
        firmware.handle(msg.Arm(limits, watchdog), 0.0)
    assert firmware.state == "idle"


class Host(RuleBasedStateMachine):
    """Whatever a host says in whatever order, the instrument stays within limits and its states hold together."""

    def __init__(self) -> None:
        super().__init__()
        self.firmware = suction()
        self.wall = 0.0
        self.beats = 0

    def tell(self, body: msg.Body) -> None:
        with contextlib.suppress(Refused):
            self.firmware.handle(body, self.wall)

    @rule(low=st.floats(-6e4, 0))
    def arm(self, low: float) -> None:
        self.tell(msg.Arm({"pressure": Range(low, 0.0)}, 0.25))

    @rule(values=st.lists(st.tuples(st.floats(0, 2), st.floats(-6e4, 100), st.floats(-6e4, 100)), max_size=3))
    def enqueue(self, values: list[tuple[float, float, float]]) -> None:
        self.tell(msg.Enqueue(tuple(piece(d, a, b) for d, a, b in values)))

    @rule(body=st.sampled_from([msg.Start(), msg.Hold(), msg.Safe(), msg.Skip(0), msg.Skip(1)]))
    def command(self, body: msg.Body) -> None:
        self.tell(body)

    @rule()
    def beat(self) -> None:
        self.beats += 1
        self.firmware.beat(self.beats, self.wall)

    @rule(seconds=st.floats(0.001, 1))
    def pass_time(self, seconds: float) -> None:
        self.wall += seconds
        self.firmware.watch_host(self.wall)
        wave = self.firmware.advance(self.firmware.time + seconds)
        limit = self.firmware.limits.get("pressure", PRESSURE["pressure"])
        if self.firmware.state == "running":
            assert wave.values[1:].min() >= limit.low - 1e-3
            assert wave.values[1:].max() <= limit.high + 1e-3

    @precondition(lambda self: self.firmware.state in ("idle", "safe", "fault", "held", "armed"))
    @invariant()
    def nothing_is_commanded_unless_running(self) -> None:
        assert self.firmware.command == {"pressure": 0.0}
        assert self.firmware.resting

    @invariant()
    def the_queue_is_bounded(self) -> None:
        status = self.firmware.status
        assert 0 <= status.queued <= self.firmware.capacity
        assert (status.state == "fault") == bool(status.fault)


TestHost = Host.TestCase
TestHost.settings = settings(max_examples=40, stateful_step_count=25, deadline=None)


@settings(max_examples=50, deadline=None)
@example(durations=[0.0010000000000000002], steps=[0.001])
@given(
    durations=st.lists(st.one_of(st.just(0.0), st.floats(1e-6, 3.0)), min_size=1, max_size=4),
    steps=st.lists(st.floats(1e-3, 2.0), min_size=1, max_size=6),
)
def test_time_is_conserved(durations: list[float], steps: list[float]) -> None:
    firmware = armed(suction())
    firmware.handle(msg.Enqueue(tuple(piece(d, -1e3, -2e3) for d in durations)), 0.0)
    firmware.handle(msg.Start(), 0.0)
    for step in steps:
        firmware.advance(firmware.time + step)
    ends = np.cumsum([d if d >= 1e-5 else 0.0 for d in durations])
    over, begun = (int(np.sum(ends <= firmware.time + rounding)) for rounding in (-1e-12, 1e-12))
    # A segment that ends now but for rounding may be over or not.
    assert over <= firmware.executed <= begun
