"""Frames and checksums that the codecs share: lines with a CRC, and COBS packets.

COBS is Cheshire and Baker, "Consistent Overhead Byte Stuffing", IEEE/ACM Trans. Networking 7 (1999): it removes every
zero from a packet, so that a zero byte always means a boundary and a reader is in step again after one packet.
"""

from __future__ import annotations

import binascii


def crc16(data: bytes | memoryview) -> int:
    """CRC-16/XMODEM (polynomial 0x1021, initial value 0)."""
    return binascii.crc_hqx(data, 0)


def cobs_encode(data: bytes) -> bytes:
    """``data`` with no zero byte in it, at most one byte in 254 longer, plus one; without the delimiter."""
    out = bytearray()
    for run in data.split(b"\0"):
        while len(run) >= 254:
            out.append(255)
            out += run[:254]
            run = run[254:]
        out.append(len(run) + 1)
        out += run
    return bytes(out)


def cobs_decode(packet: bytes) -> bytes:
    """The inverse of `cobs_encode`. Raises ValueError on a packet that no encoder makes."""
    out = bytearray()
    at, end = 0, len(packet)
    if not end:
        raise ValueError("empty packet")
    while at < end:
        code = packet[at]
        if code == 0:
            raise ValueError(f"zero byte at {at}")
        stop = at + code
        if stop > end:
            raise ValueError(f"the packet ends {stop - end} bytes early")
        out += packet[at + 1 : stop]
        if code < 255 and stop < end:
            out.append(0)
        at = stop
    return bytes(out)


class Splitter:
    """Cuts a byte stream at a delimiter, keeping an incomplete rest.

    A run longer than ``longest`` without a delimiter is garbage: it is dropped and counted in ``overrun``.
    """

    def __init__(self, delimiter: bytes, longest: int) -> None:
        self._delimiter = delimiter
        self._longest = longest
        self._rest = b""
        self.overrun = 0

    def feed(self, data: bytes) -> list[bytes]:
        """The complete pieces, without their delimiters (empty ones left out)."""
        *pieces, self._rest = (self._rest + data).split(self._delimiter)
        if len(self._rest) > self._longest:
            self.overrun += len(self._rest)
            self._rest = b""
        return [p for p in pieces if p]
