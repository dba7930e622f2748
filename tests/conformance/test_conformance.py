"""What every instrument must do over every link: the same tests for all."""

from __future__ import annotations

import contextlib
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from drivers import messages as msg
from drivers.device import LinkLost, Refused
from drivers.signals import Block
from protocols.limits import PROBE
from protocols.setpoints import Segment

if TYPE_CHECKING:
    from conftest import Host


def test_says_who_it_is(host: Host) -> None:
    identity = host.device.connect()
    assert "simulated" in identity.model
    assert identity.serial
    assert identity.firmware
    assert host.device.connect() == identity  # connecting again is allowed


def test_streams_every_sample_once_and_in_order(host: Host) -> None:
    host.connect()
    host.samples(300)
    rate = host.server.bench.rate
    assert np.array_equal(np.diff(host.seq), np.ones(len(host.seq) - 1))
    assert np.allclose(np.diff(host.time), 1 / rate, atol=2e-6)
    assert host.device.status.state == "idle"
    names = {c.name for c in host.device.channels}
    for block in host.blocks:
        assert set(block.values) == names
        assert all(len(v) == len(block) == len(block.time_host) for v in block.values.values())
        assert np.isfinite(block.time_host).all()


def test_executes_segments_in_its_own_time(host: Host) -> None:
    host.connect()
    host.arm()
    full = host.full
    plan = [
        host.segment(2.0, 0.0, full),
        host.segment(2.0, full, full),
        host.segment(1.0, full, full / 2),
        host.segment(2.0, full / 2, full / 2),
        host.segment(1.0, full / 2, 0.0),
        host.segment(1.0, 0.0, 0.0),
    ]
    host.device.enqueue(plan)
    host.device.start()
    host.listen(lambda: host.device.status.executed > 0)
    host.listen(lambda: host.device.status.executed == len(plan))
    status = host.device.status
    assert status.queued == 0
    assert status.state == "running"
    began = status.began - 9.0  # the last segment ended then
    measured = host.values(host.device.quantities[0])
    target = np.interp(
        host.time - began, np.cumsum([0, *(s.duration for s in plan)]), [0, full, full, full / 2, full / 2, 0, 0]
    )
    # Generous about the actuator's lag, strict about when things happen and how far they go.
    late = np.interp(
        host.time - began - 0.1, np.cumsum([0, *(s.duration for s in plan)]), [0, full, full, full / 2, full / 2, 0, 0]
    )
    during = (host.time > began) & (host.time < began + 9)
    error = np.minimum(np.abs(measured - target), np.abs(measured - late))[during]
    assert np.sqrt(np.mean(error**2)) < 0.03 * abs(full)
    hold = (host.time > began + 3.5) & (host.time < began + 4.0)
    assert np.mean(measured[hold]) == pytest.approx(full, rel=0.03)


def test_began_tells_when_the_running_segment_began(host: Host) -> None:
    host.connect()
    host.arm()
    host.device.enqueue([host.segment(1.0, 0.0, host.full), host.segment(host.long, host.full, host.full)])
    assert np.isnan(host.device.status.began)
    host.device.start()
    host.listen(lambda: host.device.status.state == "running" and np.isfinite(host.device.status.began))
    first = host.device.status
    host.listen(lambda: host.device.status.executed == 1)
    if first.executed == 0:
        assert host.device.status.began == pytest.approx(first.began + 1.0, abs=1e-5)


def test_refuses_more_segments_than_its_queue_holds(host: Host) -> None:
    host.connect()
    host.arm()
    rest = host.segment(1.0, 0.0, 0.0)
    with pytest.raises(Refused, match="queue holds"):
        host.device.enqueue([rest] * (host.device.queue_capacity + 1))
    host.device.enqueue([rest] * host.device.queue_capacity)
    with pytest.raises(Refused, match="queue holds"):
        host.device.enqueue([rest])


def test_refuses_what_is_out_of_limits(host: Host) -> None:
    host.connect()
    host.samples(10)
    q = host.device.quantities[0]
    limit = host.limits[q]
    with pytest.raises(Refused, match="not armed"):
        host.device.enqueue([host.segment(1.0, 0.0, 0.0)])
    with pytest.raises(Refused, match="not armed"):
        host.device.start()
    with pytest.raises(Refused, match="without limits"):
        host.device.arm({})
    with pytest.raises(Refused, match="hardware allows"):
        host.device.arm({**host.limits, q: replace(limit, low=2 * limit.low)})
    host.device.arm({**host.limits, q: replace(limit, low=limit.low / 4)})
    with pytest.raises(Refused, match=f"{q} .* is outside"):
        host.device.enqueue([host.segment(10.0, 0.0, limit.low / 2)])
    with pytest.raises(Refused, match="commanded by"):
        host.device.enqueue([Segment(1.0, {"current": 0.0}, {"current": 1.0})])
    with pytest.raises(Refused, match="duration"):
        host.device.enqueue([host.segment(-1.0, 0.0, 0.0)])
    assert host.device.status.queued == 0


@pytest.mark.parametrize("state", ["idle", "armed", "running", "held", "safe", "fault"])
def test_hold_skip_and_make_safe_from_every_state(host: Host, state: str) -> None:
    host.connect()
    host.samples(10)
    if state in ("armed", "running", "held", "fault"):
        host.device.arm(host.limits)
    if state in ("running", "held"):
        host.device.enqueue([host.segment(0.5, 0.0, host.full), host.segment(host.long, host.full, host.full)])
        host.device.start()
        host.listen(lambda: host.device.status.executed == 1)
    if state == "held":
        host.device.hold()
    if state == "safe":
        host.device.make_safe()
    if state == "fault":
        host.listen(lambda: host.device.status.state == "fault", beat=False)
    host.listen(lambda: host.device.status.state == state, beat=state != "fault")
    host.device.skip()
    host.device.hold()
    host.device.hold()
    expected = "held" if state in ("armed", "running", "held") else state
    host.listen(lambda: host.device.status.state == expected)
    host.device.make_safe()
    host.device.make_safe()
    host.listen(lambda: host.device.status.state == "safe")
    assert host.door.wait_vented().state == "safe"
    assert host.door.truth().limits == {}
    host.device.arm(host.limits)  # and it can be used again
    host.listen(lambda: host.device.status.state == "armed")


def test_hold_vents_and_start_goes_on(host: Host) -> None:
    host.suck()
    host.device.hold()
    held = host.door.wait_vented()
    assert held.state == "held"
    host.listen(lambda: host.device.status.state == "held")
    assert host.device.status.queued == 0
    host.device.enqueue([host.segment(0.5, host.full, host.full), host.segment(0.5, host.full, 0.0)])
    host.device.start()
    host.listen(lambda: host.device.status.state == "running" and host.device.status.executed == 2)


def test_skip_ends_the_running_segment_only(host: Host) -> None:
    host.suck()
    host.device.enqueue([host.segment(1.0, host.full, 0.0), host.segment(1e4, 0.0, 0.0)])
    host.device.skip()
    host.listen(lambda: host.device.status.executed >= 2)
    host.listen(lambda: host.device.status.executed == 3)
    assert host.door.truth().state == "running"
    assert set(host.door.truth().command.values()) == {0.0}


def test_vents_by_itself_when_beats_stop(host: Host) -> None:
    host.suck()
    host.listen(lambda: host.device.status.state == "fault", beat=False)
    assert "heartbeat" in host.device.status.fault
    assert host.door.wait_vented().state == "fault"
    with pytest.raises(Refused, match="fault"):
        host.device.arm(host.limits)


def test_a_beat_that_is_repeated_is_no_beat(host: Host) -> None:
    host.suck()
    host.device._beats -= 1  # type: ignore[attr-defined]
    again = host.device._codec.encode(msg.Beat(host.device._beats))  # type: ignore[attr-defined]
    deadline = time.monotonic() + 8.0
    while host.door.truth().state == "running":
        assert time.monotonic() < deadline, "beats that say nothing new keep it under suction"
        host.device._need_link().write(again)  # type: ignore[attr-defined]
        host.blocks += [b for b in host.device.read(0.01) if isinstance(b, Block)]
    truth = host.door.wait_vented()
    assert truth.state == "fault"
    assert "heartbeat" in truth.fault


def test_an_empty_queue_vents(host: Host) -> None:
    host.connect()
    host.arm()
    host.device.enqueue([host.segment(1.0, 0.0, host.full)])
    host.device.start()
    host.listen(lambda: host.device.status.state == "fault")
    assert "queue is empty" in host.device.status.fault
    assert host.door.wait_vented().state == "fault"


def test_an_empty_queue_at_rest_waits_for_more(host: Host) -> None:
    host.connect()
    host.arm()
    host.device.enqueue([host.segment(1.0, 0.0, host.full), host.segment(1.0, host.full, 0.0)])
    host.device.start()
    host.listen(lambda: host.device.status.executed == 2)
    goal = host.device.status.time + 5.0
    host.listen(lambda: host.device.status.time > goal)
    host.device.enqueue([host.segment(1.0, 0.0, 0.0)])
    host.listen(lambda: host.device.status.executed == 3)


def test_vents_when_it_was_away_from_rest_for_too_long(host: Host) -> None:
    host.connect()
    host.listen(lambda: bool(host.blocks))
    quantity = PROBE if PROBE in host.limits else host.device.quantities[0]
    allowed = {**host.limits, quantity: replace(host.limits[quantity], dwell=3.0)}
    host.device.arm(allowed)
    with pytest.raises(Refused, match="longer than 3 s"):
        host.device.enqueue([host.segment(4.0, host.full, host.full)])
    there, stay, back = (host.segment(0.5, *ends) for ends in ((0.0, host.full), (host.full,) * 2, (host.full, 0.0)))
    pause = host.segment(0.5, 0.0, 0.0)  # too short for a rest
    host.device.enqueue([there, stay, back, pause] * 5)
    host.device.start()
    host.listen(lambda: host.device.status.state == "fault")
    assert "away from rest for longer than 3 s" in host.device.status.fault
    assert host.door.wait_vented().state == "fault"


@pytest.mark.parametrize("watchdog", [0.0, -1.0, 1.5, 1e6, np.inf, np.nan])
def test_a_watchdog_that_protects_nobody_is_refused(host: Host, watchdog: float) -> None:
    host.connect()
    with pytest.raises(Refused, match="watchdog"):
        host.device._request(msg.Arm(host.limits, watchdog))  # type: ignore[attr-defined]
    assert host.door.truth().state == "idle"


def test_an_old_command_that_comes_again_is_not_obeyed(host: Host) -> None:
    host.connect()
    host.arm()
    device = host.device
    device.enqueue([host.segment(1.0, 0.0, 0.0)])
    old = device._codec.encode(  # type: ignore[attr-defined]
        msg.Request(device._number, msg.Enqueue((msg.Piece(1.0, *(((0.0,) * len(device.quantities),) * 2)),)))  # type: ignore[attr-defined]
    )
    device.skip()  # a newer command
    device._need_link().write(old)  # type: ignore[attr-defined]
    host.samples(30)
    assert device.status.queued == 1


def test_an_old_status_is_not_believed(host: Host) -> None:
    host.connect()
    host.samples(20)
    newest = host.device.status
    host.door.swap(1)
    host.listen(lambda: bool((np.diff(host.seq) < 0).any()))  # handed on as it came, with its own number
    assert host.device.status.time > newest.time
    host.door.stale("packet")
    host.listen(lambda: np.count_nonzero(np.diff(host.seq) <= 0) >= 4)  # the last packet again and again
    known = host.device.status
    for _ in range(20):
        host.listen(lambda: True)
    assert host.device.status == known


def test_vents_although_the_host_died_without_a_word(host: Host) -> None:
    host.suck()
    time.sleep(0.1)  # the host reads nothing any more: the link is full
    truth = host.door.wait_vented(timeout=5.0)
    assert truth.state == "fault"


def test_pulled_cable(host: Host) -> None:
    host.suck()
    host.door.unplug()
    with pytest.raises(LinkLost, match=host.device.name + "|" + host.server.entry.address.split(":")[0]):
        host.listen(lambda: False)
    with contextlib.suppress(LinkLost):
        host.device.make_safe()
    truth = host.door.wait_vented(timeout=5.0)
    assert truth.state == "fault"
    host.device.close()
    host.device.close()


def test_cable_back_in(host: Host) -> None:
    host.connect()
    host.samples(10)
    host.door.unplug()
    with pytest.raises(LinkLost):
        host.listen(lambda: False)
    host.door.plug()
    if host.server.entry.address.startswith("/dev"):
        return  # a pseudo-terminal has another address then
    host.connect()
    host.samples(10)


def test_in_step_again_after_garbage(host: Host) -> None:
    host.connect()
    host.samples(20)
    host.door.garbage(500)
    host.samples(50)
    host.listen(lambda: host.device.discarded > 0)  # type: ignore[attr-defined]
    host.door.corrupt(2)
    host.listen(lambda: bool((np.diff(host.seq) > 1).any()))
    lost = np.diff(host.seq) - 1
    assert lost.max() > 0  # what was damaged is missing, and one sees it
    assert lost.min() == 0
    host.arm()  # commands go through too
    host.door.corrupt(1)
    host.device.enqueue([host.segment(1.0, 0.0, 0.0)])
    host.listen(lambda: host.device.status.queued == 1)  # once, though the answer had to be repeated


def test_repeated_messages_show_in_the_numbers(host: Host) -> None:
    host.connect()
    host.samples(20)
    host.door.repeat(3)
    host.listen(lambda: bool(np.diff(host.seq).min() < 1))
    host.samples(20)
    assert np.diff(host.seq).min() < 1
    assert len(np.unique(host.seq)) == host.seq.max() - host.seq.min() + 1


def test_short_reads_lose_nothing(host: Host) -> None:
    host.connect()
    host.door.short_reads(7)
    host.samples(60)
    host.door.short_reads(0)
    host.samples(20)
    assert np.all(np.diff(host.seq) == 1)


def test_a_slow_host_slows_the_instrument_and_loses_nothing(host: Host) -> None:
    host.connect()
    host.samples(20)
    time.sleep(0.3)
    host.samples(500)
    assert np.all(np.diff(host.seq) == 1)


def test_not_a_number_stays_one(host: Host) -> None:
    host.connect()
    host.samples(20)
    name = host.server.bench.raw[0]
    host.door.nan(name, 5)
    host.listen(lambda: bool(np.isnan(host.values(name)).any()))
    host.samples(40)
    values = host.values(name)
    assert np.isnan(values).sum() == 5
    assert np.isfinite(values[-1])
    if host.server.bench.instrument.name == "microrobot":
        assert np.isnan(host.values("probe_z")).sum() == 5  # and spreads to what is computed from it


def test_a_reboot_is_a_lost_link(host: Host) -> None:
    host.suck()
    host.door.reboot()
    with pytest.raises(LinkLost, match="restarted"):
        host.listen(lambda: False)
    truth = host.door.wait_vented()
    assert truth.state == "idle"
    assert truth.limits == {}


def test_a_stalled_link_vents(host: Host) -> None:
    host.suck()
    host.door.stall(0.9)
    assert host.door.wait_vented().state == "fault"
    host.listen(lambda: host.device.status.state == "fault")


def test_nobody_answers(host: Host) -> None:
    host.connect()
    host.door.stall(5.0)
    with pytest.raises(LinkLost, match="no answer to safe"):
        host.device.make_safe()


def test_close_is_idempotent_and_a_closed_device_says_so(host: Host) -> None:
    host.device.close()
    host.connect()
    host.device.close()
    host.device.close()
    with pytest.raises(LinkLost, match="not connected"):
        host.device.read(0.0)
    host.device.make_safe()  # nothing to do, no error
