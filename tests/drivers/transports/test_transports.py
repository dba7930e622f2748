"""Links: addresses, exact reads with deadlines, and what happens when the other end goes."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.claims import Claim
from drivers.device import LinkLost
from drivers.transports import Transport, kind_of, open_transport

posix = pytest.mark.skipif(os.name == "nt", reason="pseudo-terminals are POSIX")


class Peer:
    """The other end of a link."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        if kind == "pty":
            import pty
            import tty

            self.master, slave = pty.openpty()
            tty.setraw(slave)
            self.address = os.ttyname(slave)
            self._slave = slave
        else:
            self._listener = socket.create_server(("127.0.0.1", 0))
            self.address = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"

    def open(self) -> Transport:
        link = open_transport(self.address)
        if self.kind == "socket":
            self._socket, _ = self._listener.accept()
        return link

    def send(self, data: bytes) -> None:
        if self.kind == "pty":
            os.write(self.master, data)
        else:
            self._socket.sendall(data)

    def heard(self, count: int) -> bytes:
        return os.read(self.master, count) if self.kind == "pty" else self._socket.recv(count)

    def hang_up(self) -> None:
        if self.kind == "pty":
            os.close(self.master)
            os.close(self._slave)
        else:
            self._socket.close()
            self._listener.close()


@pytest.fixture(params=[pytest.param("pty", marks=posix), "socket"])
def peer(request: pytest.FixtureRequest) -> Iterator[Peer]:
    peer = Peer(request.param)
    yield peer
    with contextlib.suppress(OSError):
        peer.hang_up()


@pytest.fixture
def link(peer: Peer) -> Iterator[Transport]:
    link = peer.open()
    yield link
    link.close()


def test_read_takes_what_is_there_and_waits_no_longer_than_asked(peer: Peer, link: Transport) -> None:
    start = time.monotonic()
    assert link.read(0.05) == b""
    assert 0.04 < time.monotonic() - start < 1.0
    peer.send(b"\x00\r\n\x03\x11\x13\xff")  # nothing is swallowed or translated
    assert link.read_exactly(7, 1.0) == b"\x00\r\n\x03\x11\x13\xff"
    link.write(b"\x00\n\xff")
    assert peer.heard(10) == b"\x00\n\xff"


def test_an_exact_read_is_continued_over_short_ones_and_loses_nothing_at_its_deadline(
    peer: Peer, link: Transport
) -> None:
    peer.send(b"abc")
    assert link.read_exactly(5, 0.05) is None
    later = threading.Timer(0.05, peer.send, [b"defg"])
    later.start()
    assert link.read_exactly(5, 2.0) == b"abcde"
    later.join()
    assert link.read(0.5) == b"fg"


def test_hanging_up_is_a_lost_link(peer: Peer, link: Transport) -> None:
    peer.hang_up()
    with pytest.raises(LinkLost, match=peer.address):
        [link.read(0.1) for _ in range(10)]
    link.close()
    link.close()


def test_a_closed_link_is_a_lost_link(link: Transport) -> None:
    link.close()
    with pytest.raises(LinkLost):
        link.read(0.0)
    with pytest.raises(LinkLost):
        link.write(b"x")


@posix
def test_a_link_is_opened_by_one_program_only_and_says_by_which(peer: Peer, link: Transport) -> None:
    with pytest.raises(LinkLost, match=rf"py.* \(process {os.getpid()}, since .*\) drives this instrument"):
        open_transport(peer.address.replace("127.0.0.1", "localhost"))
    link.close()
    Claim(peer.address).release()


@posix
def test_the_system_locks_a_serial_port_too() -> None:
    """Against programs of other users, whose claims we do not see."""
    peer = Peer("pty")
    first = peer.open()
    first._release()
    with pytest.raises(LinkLost, match="lock"):
        open_transport(peer.address)
    first.close()
    peer.hang_up()


@posix
def test_a_dead_program_s_claim_is_void(tmp_path: Path) -> None:
    program = (
        "import sys, time; from drivers.claims import Claim; c = Claim('/dev/ttyX'); print(1, flush=True); input()"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        holder.stdout.readline()
        with pytest.raises(LinkLost, match=rf"process {holder.pid}"):
            Claim("/dev/ttyX")
        holder.kill()
        holder.wait()
        claim = Claim("/dev/ttyX")
        assert claim._path.stat().st_mode & 0o077 == 0
        assert claim._path.parent.stat().st_mode & 0o077 == 0
        claim.release()
        assert not claim._path.exists()


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("", "empty"),
        ("socket://localhost", "socket://host:port"),
        ("socket://localhost:99999", "socket://host:port"),
        ("usb:12345:1", "usb:VID:PID"),
        ("usb:xyz", "usb:VID:PID"),
    ],
)
def test_addresses_that_mean_nothing(address: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        open_transport(address)


@pytest.mark.parametrize("address", ["/dev/no-such-port", "socket://127.0.0.1:1"])
def test_nobody_there(address: str) -> None:
    with pytest.raises(LinkLost, match=address):
        open_transport(address)


@posix
def test_what_is_no_port_is_not_opened_as_one(tmp_path: Path) -> None:
    notes = tmp_path / "notes"
    notes.write_text("precious")
    with pytest.raises(LinkLost, match="no serial port"):
        open_transport(str(notes))
    assert notes.read_text() == "precious"


def test_kinds() -> None:
    assert [kind_of(a) for a in ("/dev/ttyUSB0", "COM3", "socket://h:1", "usb:1:2")] == [
        "serial",
        "serial",
        "socket",
        "usb",
    ]
