"""``socket://host:port``: a byte link over TCP.

pyserial has such a port too, but its close waits 0.3 s and leaks the socket when the other end has gone first.
"""

from __future__ import annotations

import select
import socket

from drivers.transports._addresses import BUSY, DENIED, GREETING, host_of, token_of
from drivers.transports._base import Transport

_CHUNK = 262144
_CONNECT_TIMEOUT = 3.0
_WRITE_TIMEOUT = 1.0


class SocketTransport(Transport):
    """A TCP connection in non-blocking mode."""

    def __init__(self, address: str) -> None:
        super().__init__(address)
        host, port = host_of(address)
        try:
            self._socket = socket.create_connection((host, port), timeout=_CONNECT_TIMEOUT)
        except OSError as error:
            raise self._lost(error) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.settimeout(_WRITE_TIMEOUT)
        self._greeted = False  # heard anything yet
        if token := token_of(address):
            self.write(GREETING.format(token).encode())

    def _receive(self, timeout: float) -> bytes:
        try:
            if not select.select([self._socket], [], [], timeout)[0]:
                return b""
            data = self._socket.recv(_CHUNK)
        except (OSError, ValueError) as error:  # ValueError: select on a socket closed meanwhile
            raise self._lost(error) from error
        if not data:
            raise self._lost("the other end closed it")
        if not self._greeted:
            self._greeted = True
            if data.startswith(BUSY):
                raise self._lost("another program drives this instrument")
            if data.startswith(DENIED):
                raise self._lost("the instrument wants another token (it stands in the address: socket://TOKEN@…)")
        return data

    def write(self, data: bytes) -> None:
        try:
            self._socket.sendall(data)
        except OSError as error:
            raise self._lost(error) from error

    def close(self) -> None:
        self._socket.close()
        self._release()
