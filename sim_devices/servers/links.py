"""The device's end of a byte link: a pseudo-terminal or a TCP port, non-blocking, that can be unplugged."""

from __future__ import annotations

import abc
import contextlib
import os
import socket


class Link(abc.ABC):
    """One link with at most one host on it.

    ``fresh`` becomes true when a new host connects (a pseudo-terminal, like a serial line, cannot tell).
    """

    address: str
    fresh: bool = False

    @abc.abstractmethod
    def filenos(self) -> list[int]:
        """What to wait on for input."""

    @property
    @abc.abstractmethod
    def connected(self) -> bool:
        """Whether bytes sent now can reach a host."""

    @abc.abstractmethod
    def receive(self) -> bytes:
        """What has arrived; empty when nothing did."""

    @abc.abstractmethod
    def send(self, data: memoryview) -> int:
        """Send what the link takes now; how many bytes that was."""

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


class TcpLink(Link):
    """A listening TCP port on the loopback interface; a new host replaces the old one."""

    def __init__(self, port: int = 0, send_buffer: int = 65536) -> None:
        self._port = port
        self._send_buffer = send_buffer
        self._listener: socket.socket | None = None
        self._host: socket.socket | None = None
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
            listener.listen(1)
        except OSError:
            listener.close()
            raise
        listener.setblocking(False)
        self._listener = listener
        self._port = listener.getsockname()[1]
        self.address = f"socket://127.0.0.1:{self._port}"

    @property
    def port(self) -> int:
        """The TCP port."""
        return self._port

    def unplug(self) -> None:
        self._drop_host()
        if self._listener is not None:
            # A thread that waits on the socket would keep it listening beyond its close.
            with contextlib.suppress(OSError):
                self._listener.shutdown(socket.SHUT_RDWR)
            self._listener.close()
            self._listener = None

    def filenos(self) -> list[int]:
        return [s.fileno() for s in (self._listener, self._host) if s is not None]

    @property
    def connected(self) -> bool:
        return self._host is not None

    def receive(self) -> bytes:
        self._accept()
        if self._host is None:
            return b""
        try:
            data = self._host.recv(65536)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._drop_host()
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

    def _accept(self) -> None:
        if self._listener is None:
            return
        with contextlib.suppress(BlockingIOError):
            host, _ = self._listener.accept()
            self._drop_host()
            host.setblocking(False)
            host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._host = host
            self.fresh = True

    def _drop_host(self) -> None:
        if self._host is not None:
            self._host.close()
            self._host = None
