"""The device's end of a byte link: a pseudo-terminal or a TCP port, non-blocking, that can be unplugged."""

from __future__ import annotations

import abc
import contextlib
import hmac
import os
import socket
import time
from dataclasses import dataclass

from drivers.transports import BUSY, DENIED, GREETING

_MOST = 2**20  # bytes heard in one turn
_GUESTS = 8  # connections that may wait
_STAY = 1.0  # s of wall time for which one may wait


class Link(abc.ABC):
    """One link with at most one host on it.

    ``fresh`` becomes true when a new host connects (a pseudo-terminal, like a serial line, cannot tell).
    """

    address: str
    fresh: bool = False

    @abc.abstractmethod
    def filenos(self) -> list[int]:
        """The file to wait on for input."""

    @property
    @abc.abstractmethod
    def connected(self) -> bool:
        """Whether bytes sent now can reach a host."""

    @abc.abstractmethod
    def receive(self) -> bytes:
        """Bytes that have arrived; empty when there are none."""

    @abc.abstractmethod
    def send(self, data: memoryview) -> int:
        """Send as much as the link takes now; the result is the number of bytes."""

    @abc.abstractmethod
    def unplug(self) -> None:
        """Pull the cable."""

    @abc.abstractmethod
    def plug(self) -> None:
        """Put it back, under the same address where that is possible."""

    def close(self) -> None:
        """Release everything. Idempotent."""
        self.unplug()


class PtyLink(Link):
    """A pseudo-terminal; ``address`` is the host's side and changes when it is plugged in again."""

    def __init__(self) -> None:
        self._master: int | None = None
        self._slave: int | None = None
        self.plug()

    def plug(self) -> None:
        if self._master is not None:
            return
        import pty
        import tty

        # The host's side stays open here too: like a serial line, the link outlives the host's program.
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.address = os.ttyname(self._slave)

    def unplug(self) -> None:
        for descriptor in (self._master, self._slave):
            if descriptor is not None:
                os.close(descriptor)
        self._master = self._slave = None

    def filenos(self) -> list[int]:
        return [] if self._master is None else [self._master]

    @property
    def connected(self) -> bool:
        return self._master is not None

    def receive(self) -> bytes:
        if self._master is None:
            return b""
        try:
            return os.read(self._master, 65536)
        except (BlockingIOError, OSError):
            return b""

    def send(self, data: memoryview) -> int:
        if self._master is None:
            return len(data)
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0


@dataclass
class _Guest:
    """A connection that is not the host's: not yet, or not at all (``leaving``: it is told why, and then dropped)."""

    socket: socket.socket
    since: float
    heard: bytes = b""
    leaving: bool = False


class TcpLink(Link):
    """A listening TCP port on the loopback interface, with one host at a time.

    Whoever comes while there is a host is told so and turned away. With a ``token`` only who says it first gets in:
    other users of the computer cannot.
    """

    def __init__(self, port: int = 0, send_buffer: int = 65536, token: str = "") -> None:
        self._port = port
        self._send_buffer = send_buffer
        self._token = token
        self._listener: socket.socket | None = None
        self._host: socket.socket | None = None
        self._guests: list[_Guest] = []
        self.plug()

    def plug(self) -> None:
        if self._listener is not None:
            return
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        # A small buffer, so that a host that does not read slows the instrument down soon.
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, self._send_buffer)
        try:
            listener.bind(("127.0.0.1", self._port))
            listener.listen(4)
        except OSError:
            listener.close()
            raise
        listener.setblocking(False)
        self._listener = listener
        self._port = listener.getsockname()[1]
        self.address = f"socket://{self._token}{'@' if self._token else ''}127.0.0.1:{self._port}"

    @property
    def port(self) -> int:
        """The TCP port."""
        return self._port

    @property
    def token(self) -> str:
        """The greeting that a host has to send first; '' where there is none."""
        return self._token

    def unplug(self) -> None:
        self._drop_host()
        for guest in self._guests:
            guest.socket.close()
        self._guests.clear()
        if self._listener is not None:
            # A thread that waits on the socket would keep it listening beyond its close.
            with contextlib.suppress(OSError):
                self._listener.shutdown(socket.SHUT_RDWR)
            self._listener.close()
            self._listener = None

    def filenos(self) -> list[int]:
        guests = [guest.socket for guest in self._guests]
        return [s.fileno() for s in (self._listener, *guests, self._host) if s is not None]

    @property
    def connected(self) -> bool:
        return self._host is not None

    def receive(self) -> bytes:
        data = self._hear()  # first, so that a host that has gone makes room for the next one
        self._accept()
        for guest in self._guests:
            data += self._admit(guest)
        self._guests = [
            guest for guest in self._guests if guest.socket.fileno() >= 0 and guest.socket is not self._host
        ]
        return data

    def send(self, data: memoryview) -> int:
        if self._host is None:
            return len(data)
        try:
            return self._host.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            self._drop_host()
            return len(data)

    def _hear(self) -> bytes:
        """All that the host has sent; it is dropped when it has gone."""
        heard = b""
        while self._host is not None and len(heard) < _MOST:
            data = _receive(self._host)
            if data is None:
                break
            heard += data
            if not data:
                self._drop_host()
        return heard

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while self._listener is not None and len(self._guests) < _GUESTS:
                connection, _ = self._listener.accept()
                connection.setblocking(False)
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._guests.append(_Guest(connection, time.monotonic()))

    def _admit(self, guest: _Guest) -> bytes:
        """Make a guest the host or turn it away; the result is the new host's text after its greeting."""
        late = time.monotonic() - guest.since > _STAY
        if guest.leaving:
            if late or _receive(guest.socket) == b"":
                guest.socket.close()
        elif self._host is not None:
            self._turn_away(guest, BUSY)
        elif not self._token:
            return self._welcome(guest, b"")
        else:
            data = _receive(guest.socket)
            guest.heard += data or b""
            greeting = GREETING.format(self._token).encode()
            if hmac.compare_digest(guest.heard[: len(greeting)], greeting):
                return self._welcome(guest, guest.heard[len(greeting) :])
            if late or data == b"" or len(guest.heard) >= len(greeting):
                self._turn_away(guest, DENIED)
        return b""

    def _welcome(self, guest: _Guest, said: bytes) -> bytes:
        self._host = guest.socket
        self.fresh = True
        return said + self._hear()

    def _turn_away(self, guest: _Guest, why: bytes) -> None:
        """Say why and close our direction only: a full close would take the words back (RST)."""
        guest.leaving, guest.since = True, time.monotonic()
        with contextlib.suppress(OSError):
            guest.socket.send(why)
            guest.socket.shutdown(socket.SHUT_WR)

    def _drop_host(self) -> None:
        if self._host is not None:
            self._host.close()
            self._host = None


def _receive(connection: socket.socket) -> bytes | None:
    """Bytes that have arrived: None when there are none, empty when the other end has gone."""
    try:
        return connection.recv(65536)
    except BlockingIOError:
        return None
    except OSError:
        return b""
