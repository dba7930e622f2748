"""Every instrument on a bad link: pulled cables, noise, lost and repeated messages, slow hosts."""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING

import numpy as np
import pytest

from drivers import messages as msg
from drivers.device import LinkLost

if TYPE_CHECKING:
    from conftest import Host


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
