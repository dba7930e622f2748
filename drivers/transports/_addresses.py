"""The parts of an address."""

from __future__ import annotations

import ipaddress
import re

#: Sent ahead of everything to an instrument that wants a token, and its answer to a host it turns away.
GREETING = "OWNER {}\r\n"
BUSY = b"*BUSY\r\n"
DENIED = b"*DENIED\r\n"

_SOCKET = re.compile(
    r"socket://(?:(?P<token>[A-Za-z0-9_-]{8,64})@)?(?:\[(?P<six>[0-9a-fA-F:.]+)\]|(?P<host>[A-Za-z0-9._-]+)):"
    r"(?P<port>\d{1,5})/?"
)


def _socket(address: str) -> re.Match[str]:
    match = _SOCKET.fullmatch(address)
    if not match or int(match["port"]) > 65535:
        raise ValueError(f"{without_token(address)!r} is not a socket address; write socket://host:port")
    return match


def host_of(address: str) -> tuple[str, int]:
    """Host and port of ``socket://host:port``. Raises ValueError."""
    match = _socket(address)
    return match["six"] or match["host"], int(match["port"])


def token_of(address: str) -> str:
    """The token of ``socket://TOKEN@host:port``, '' without one. Raises ValueError."""
    return _socket(address)["token"] or ""


def without_token(address: str) -> str:
    """An address as it may be shown."""
    return re.sub(r"^(socket://)[^/@]*@", r"\1", address)


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
