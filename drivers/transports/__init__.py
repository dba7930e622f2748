"""Links to instruments: serial ports, pseudo-terminals, TCP sockets and USB bulk endpoints behind one interface.

``open_transport("/dev/ttyUSB0")`` or ``"COM3"`` (pyserial), ``"socket://127.0.0.1:5000"``, ``"usb:16C0:27DD"`` (pyusb;
hexadecimal vendor and product id). ``socket://TOKEN@127.0.0.1:5000`` first says a word that the other end wants.
"""

from __future__ import annotations

import re
from typing import Any

from drivers.claims import Claim
from drivers.transports._addresses import BUSY, DENIED, GREETING, host_of, is_loopback, usb_ids
from drivers.transports._base import Transport

__all__ = [
    "BUSY",
    "DENIED",
    "GREETING",
    "Transport",
    "host_of",
    "is_local_simulator",
    "is_loopback",
    "kind_of",
    "open_transport",
]


_SERIAL = re.compile(r"/[^\0]+|COM\d{1,3}|\\\\\.\\COM\d{1,3}")
_PSEUDO = re.compile(r"/dev/(pts/\d+|ttys\d{3})")


def kind_of(address: str) -> str:
    """Which transport an address means: ``socket``, ``usb`` or ``serial``.

    A serial port is a plain device path or ``COM3``. pyserial would take much more (``spy://``, which writes files,
    ``rfc2217://``, ``hwgrep://``, ``alt://``): station files come from other people, so that all of it is refused.
    Raises ValueError on anything else.
    """
    if not address:
        raise ValueError("the address of the link is empty; write /dev/ttyUSB0, socket://host:port or usb:VID:PID")
    if address.startswith("socket://"):
        host_of(address)
        return "socket"
    if address.startswith("usb:"):
        usb_ids(address)
        return "usb"
    if not _SERIAL.fullmatch(address):
        raise ValueError(f"{address!r} is no link; write /dev/ttyUSB0, COM3, socket://host:port or usb:VID:PID")
    return "serial"


def is_local_simulator(address: str) -> bool:
    """Whether nothing but a simulated instrument should be behind an address: this computer's TCP, a pseudo-terminal.

    Raises ValueError as `kind_of`.
    """
    kind = kind_of(address)
    return is_loopback(host_of(address)[0]) if kind == "socket" else bool(_PSEUDO.fullmatch(address))


def open_transport(address: str, *, baudrate: int = 115200, usb_backend: Any = None) -> Transport:
    """Open a link that no other program has open.

    Raises ValueError on an address that means nothing, LinkLost when nobody is there or another program drives it.
    """
    kind = kind_of(address)
    claim = Claim(address) if usb_backend is None else None  # a virtual bus is this process's own
    try:
        link = _open(kind, address, baudrate, usb_backend)
    except BaseException:
        if claim is not None:
            claim.release()
        raise
    link.claim = claim
    return link


def _open(kind: str, address: str, baudrate: int, usb_backend: Any) -> Transport:
    if kind == "usb":
        from drivers.transports._usb import UsbTransport

        return UsbTransport(address, usb_backend)
    if kind == "socket":
        from drivers.transports._socket import SocketTransport

        return SocketTransport(address)
    from drivers.transports._serial import SerialTransport

    return SerialTransport(address, baudrate)
