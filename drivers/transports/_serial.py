"""Serial ports and pseudo-terminals through pyserial."""

from __future__ import annotations

import contextlib
import os
import select
import stat

import serial

from drivers.transports._base import Transport

_CHUNK = 65536
_WRITE_TIMEOUT = 1.0


class SerialTransport(Transport):
    """A pyserial port in non-blocking mode.

    pyserial reprograms the port each time its timeout changes; waiting with ``select`` avoids that where the system has
    it for such ports (everywhere but on Windows, where pyserial's own time-out does the waiting).
    """

    def __init__(self, address: str, baudrate: int) -> None:
        super().__init__(address)
        exclusive = {} if os.name == "nt" else {"exclusive": True}
        try:
            if os.name != "nt" and not stat.S_ISCHR(os.stat(address).st_mode):
                raise self._lost("it is no serial port")
            # Not serial_for_url: its handlers open files and connections that an address may name.
            self._port = serial.Serial(address, baudrate=baudrate, timeout=0, write_timeout=_WRITE_TIMEOUT, **exclusive)
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise self._lost(error) from error
        self._selectable = os.name != "nt"

    def _receive(self, timeout: float) -> bytes:
        try:
            if self._selectable:
                if not select.select([self._port], [], [], timeout)[0]:
                    return b""
                return bytes(self._port.read(_CHUNK))
            self._port.timeout = timeout
            return bytes(self._port.read(max(1, self._port.in_waiting)))
        except (OSError, TypeError, ValueError) as error:  # the latter two: select on a port closed meanwhile
            raise self._lost(error) from error

    def write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except (OSError, TypeError) as error:
            raise self._lost(error) from error

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._port.close()
        self._release()
