"""One host at a time on an instrument's TCP link, known by its token where it asks for one."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable

import pytest

from drivers.device import LinkLost
from drivers.instrument import Entry
from protocols.limits import Range
from sim_devices.servers import Server, serve


def refused(connect: Callable[[], object]) -> str:
    with pytest.raises(LinkLost) as caught:
        connect()
    return str(caught.value)


@pytest.fixture
def unseen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claims that nobody sees, as between programs of two users."""
    monkeypatch.setattr("drivers.transports.Claim", lambda address: None)


def connect(server: Server, address: str = "") -> None:
    entry = Entry(server.entry.instrument, address or server.entry.address, simulated=True)
    device = server.bench.instrument.open_rig(entry).device
    try:
        device.connect()
    finally:
        device.close()


def test_a_second_host_does_not_replace_the_first(unseen: None) -> None:
    with serve("cutometer", "tcp", speed=5.0) as server:
        first = server.open_rig().device
        first.connect()
        first.arm({"pressure": Range(-40e3, 0.0)})
        assert "another program drives this instrument" in refused(lambda: connect(server))
        for _ in range(20):  # nor does a crowd that says nothing
            socket.create_connection(("127.0.0.1", int(server.entry.address.rpartition(":")[2]))).close()
        first.beat()
        time.sleep(0.1)
        first.make_safe()  # its link has lived through all of it
        assert server.back_door.truth().state == "safe"
        first.close()
        connect(server)


def test_a_host_that_has_gone_makes_room_at_once() -> None:
    with serve("cutometer", "tcp") as server:
        device = server.open_rig().device
        for _ in range(20):
            device.connect()
            device.beat()  # unread when the link closes
            device.close()


def test_only_who_knows_the_token_gets_in() -> None:
    with serve("cutometer", "tcp", token="a-word-of-mine") as server:
        plain = server.entry.address.replace("a-word-of-mine@", "")
        assert plain != server.entry.address
        for wrong in (plain, plain.replace("//", "//another-word@")):
            told = refused(lambda wrong=wrong: connect(server, wrong))  # type: ignore[misc]
            assert "another token" in told
            assert "word@" not in told
        device = server.open_rig().device
        assert "simulated" in device.connect().model
        device.close()


def test_an_aspiration_device_s_camera_has_one_host_as_well() -> None:
    with serve("aspiration", "tcp", frame_size=(64, 48), token="a-word-of-mine") as server:
        rig = server.open_rig()
        camera = rig.sources[0]
        camera.connect()
        intruder = socket.create_connection(("127.0.0.1", int(server.entry.sources["camera"].rpartition(":")[2])))
        intruder.settimeout(5)
        assert intruder.recv(100) == b"*BUSY\r\n"
        intruder.close()
        camera.start_stream()
        deadline = time.monotonic() + 5
        while not camera.read(0.1):
            assert time.monotonic() < deadline
        camera.close()
