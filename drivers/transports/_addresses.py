"""The parts of an address."""

from __future__ import annotations

import ipaddress
import re


def host_of(address: str) -> tuple[str, int]:
    """Host and port of ``socket://host:port``. Raises ValueError."""
    match = re.fullmatch(r"socket://(?:\[([0-9a-fA-F:.]+)\]|([A-Za-z0-9._-]+)):(\d{1,5})/?", address)
    if not match or int(match[3]) > 65535:
        raise ValueError(f"{address!r} is not a socket address; write socket://host:port")
    return match[1] or match[2], int(match[3])


def is_loopback(host: str) -> bool:
    """Whether a host is this computer."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def usb_ids(address: str) -> tuple[int, int]:
    """Vendor and product id of ``usb:VID:PID`` (hexadecimal). Raises ValueError."""
    match = re.fullmatch(r"usb:(?:0x)?([0-9a-fA-F]{1,4}):(?:0x)?([0-9a-fA-F]{1,4})", address)
    if not match:
        raise ValueError(f"{address!r} is not a USB address; write usb:VID:PID in hexadecimal, as usb:16C0:27DD")
    return int(match[1], 16), int(match[2], 16)
