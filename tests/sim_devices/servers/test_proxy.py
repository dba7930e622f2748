"""Streams through a bad cable: nothing false arrives, everything is counted, and beats that stop vent."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from drivers.device import LinkLost
from drivers.signals import Block
from sim_devices.servers import serve
from sim_devices.servers.proxy import DELIMITERS, Damage, Proxy, Wire

KINDS = list(DELIMITERS)
SPEED = {"cutometer": 40.0, "aspiration": 40.0, "microrobot": 10.0}


@pytest.mark.parametrize("fault", ["flip", "truncate", "drop", "repeat", "swap", "late", "garbage"])
def test_a_wire_does_what_it_says_and_no_more(fault: str) -> None:
    sent = [b"%04d\r" % k for k in range(400)]
    wire = Wire(b"\r", 3)
    wire.damage = Damage(**{fault: 0.25})
    got = b"".join(wire.pass_on(b"".join(sent)[k : k + 7]) for k in range(0, 2000, 7))
    assert 60 < wire.done[fault] < 140
    whole = [m for m in got.split(b"\r") if m + b"\r" in sent]
    assert len(set(whole)) >= 400 - 2 * wire.done[fault]
    if fault == "repeat":
        assert len(whole) == 400 + wire.done[fault]
    if fault in ("swap", "late"):
        numbers = np.array([int(m) for m in whole])
        assert (np.diff(numbers) < 0).any()
        assert len(numbers) >= 400 - 6
    again = Wire(b"\r", 3)
    again.damage = wire.damage
    assert again.pass_on(b"".join(sent)) == got, "the seed and the messages decide, not how they were cut"


def test_shares_above_one_are_refused() -> None:
    for bad in ({"flip": 1.1}, {"flip": -0.1}, {"flip": 0.6, "drop": 0.6}):
        with pytest.raises(ValueError, match="shares"):
            Damage(**bad)
    with pytest.raises(ValueError, match="socket"):
        Proxy("/dev/ttyS0")


@pytest.mark.parametrize("kind", KINDS)
def test_no_false_sample_comes_through(kind: str) -> None:
    with (
        serve(kind, "tcp", speed=SPEED[kind], camera=False, seed=1) as server,
        Proxy(server.entry.address, DELIMITERS[kind], seed=7) as cable,
    ):
        device = server.bench.instrument.open_rig(replace(server.entry, address=cable.address)).device
        device.connect()
        device.start_stream()
        cable.to_host.damage = Damage(0.05, 0.05, 0.05, 0.05, 0.05, 0.05, 0.05)
        blocks: list[Block] = []
        deadline = time.monotonic() + 8.0
        while sum(map(len, blocks)) < 2000 and time.monotonic() < deadline:
            blocks += [b for b in device.read(0.01) if isinstance(b, Block)]
        device.close()
    assert sum(cable.to_host.done.values()) > cable.to_host.done["passed"], cable.to_host.done
    assert device.discarded > 0  # type: ignore[attr-defined]
    seq = np.concatenate([b.seq for b in blocks])
    times = np.concatenate([b.time for b in blocks])
    assert np.allclose(times, times[0] + (seq - seq[0]) / server.bench.rate, atol=2e-6), (
        "number and time belong together"
    )
    table = np.column_stack([np.concatenate([b.values[name] for b in blocks]) for name in blocks[0].values])
    assert np.all(np.abs(table) < 1e3)  # at rest: bits that were changed would show
    _, first, again = np.unique(seq, return_index=True, return_inverse=True)
    assert np.array_equal(table, table[first[again]]), "what comes twice says the same"


@pytest.mark.parametrize("kind", KINDS)
def test_a_cable_that_repeats_the_last_beat_keeps_nobody_under_suction(kind: str) -> None:
    with (
        serve(kind, "tcp", speed=5.0, camera=False, seed=1, watchdog=0.5) as server,
        Proxy(server.entry.address, DELIMITERS[kind]) as cable,
    ):
        device = server.bench.instrument.open_rig(replace(server.entry, address=cable.address)).device
        device.connect()
        device.start_stream()
        device.arm(server.bench.instrument.limits.ranges)
        device.beat()
        cable.to_device.stuck = True
        deadline = time.monotonic() + 5.0
        while server.back_door.truth().state == "armed" and time.monotonic() < deadline:
            device.beat()
            device.read(0.01)
        assert "heartbeat" in server.back_door.wait_vented().fault
        with pytest.raises(LinkLost):
            device.make_safe()
        device.close()
