"""Every instrument vents by itself when its host is silent, late or gone: the same tests for all."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from drivers import messages as msg
from drivers.device import Refused
from drivers.signals import Block
from protocols.limits import PROBE

if TYPE_CHECKING:
    from conftest import Host


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


def test_vents_although_the_host_died_without_a_word(host: Host) -> None:
    host.suck()
    time.sleep(0.1)  # the host reads nothing any more: the link is full
    truth = host.door.wait_vented(timeout=5.0)
    assert truth.state == "fault"
