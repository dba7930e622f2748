"""Every instrument over every link: the same tests for all."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from drivers.device import LinkLost, Refused
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


def test_close_is_idempotent_and_a_closed_device_says_so(host: Host) -> None:
    host.device.close()
    host.connect()
    host.device.close()
    host.device.close()
    with pytest.raises(LinkLost, match="not connected"):
        host.device.read(0.0)
    host.device.make_safe()  # nothing to do, no error
