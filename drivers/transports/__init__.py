"""Links to instruments: serial ports, pseudo-terminals, TCP sockets and USB bulk endpoints behind one interface.

``open_transport("/dev/ttyUSB0")`` or ``"COM3"`` (pyserial), ``"socket://127.0.0.1:5000"``, ``"usb:16C0:27DD"`` (pyusb;
hexadecimal vendor and product id).
"""

from __future__ import annotations

from typing import Any

from drivers.transports._base import Transport

__all__ = ["Transport", "kind_of", "open_transport"]


def kind_of(address: str) -> str:
    """Which transport an address means: ``socket``, ``usb`` or ``serial``. Raises ValueError on an empty address."""
    if not address:
        raise ValueError("the address of the link is empty; write /dev/ttyUSB0, socket://host:port or usb:VID:PID")
    if address.startswith("socket://"):
        return "socket"
    return "usb" if address.startswith("usb:") else "serial"


def open_transport(address: str, *, baudrate: int = 115200, usb_backend: Any = None) -> Transport:
    """Open a link. Raises ValueError on an address that means nothing, LinkLost when nobody is there."""
    kind = kind_of(address)
    if kind == "usb":
        from drivers.transports._usb import UsbTransport

        return UsbTransport(address, usb_backend)
    if kind == "socket":
        from drivers.transports._socket import SocketTransport

        return SocketTransport(address)
    from drivers.transports._serial import SerialTransport

    return SerialTransport(address, baudrate)
