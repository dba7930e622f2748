"""The simulated camera's wire: raw 8 bit frames behind a header, little endian, and one-line commands the other way.

This is a link of this project, for simulated instruments; real cameras are opened by their own interfaces.
Header: ``RAW8``, kind (u8: 0 frame, 1 identity), a spare byte, width and height (u16), sequence number (u32), device
time in µs (u64), length of the payload (u32), CRC-32 of the payload, CRC-16 of the header before it.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.device import Identity
from drivers.framing import crc16
from drivers.messages import Tally

IDENTIFY, STREAM_ON, STREAM_OFF = b"ID?\r", b"STREAM 1\r", b"STREAM 0\r"

_MAGIC = b"RAW8"
_HEADER = struct.Struct("<4sBxHHIQIIH")
_FRAME, _IDENTITY = 0, 1
_LARGEST = 2**26


@dataclass(frozen=True)
class Picture:
    """A frame on the wire: image (height, width), sequence number, device time in s."""

    image: NDArray[np.uint8]
    seq: int
    time: float


def encode(message: Picture | Identity) -> bytes:
    """The bytes of a frame or of the camera's identity."""
    if isinstance(message, Identity):
        payload = "\n".join((message.model, message.serial, message.firmware)).encode()
        return _header(_IDENTITY, 0, 0, 0, 0, payload) + payload
    height, width = message.image.shape
    payload = message.image.tobytes()
    return _header(_FRAME, width, height, message.seq, round(message.time * 1e6), payload) + payload


def _header(kind: int, width: int, height: int, seq: int, stamp: int, payload: bytes) -> bytes:
    head = _HEADER.pack(_MAGIC, kind, width, height, seq, stamp, len(payload), zlib.crc32(payload), 0)[:-2]
    return head + crc16(head).to_bytes(2, "little")


class FrameDecoder:
    """Cuts the stream into frames; after garbage it looks for the next header."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.tally = Tally()

    def feed(self, data: bytes) -> list[Picture | Identity]:
        """The messages completed by ``data``."""
        self._buffer += data
        found = []
        while (message := self._next()) is not None:
            found.append(message)
        return found

    @property
    def incomplete(self) -> bool:
        """Whether a message has begun and not ended."""
        return bool(self._buffer)

    def _next(self) -> Picture | Identity | None:
        while True:
            start = self._buffer.find(_MAGIC)
            if start < 0:
                self._discard(max(0, len(self._buffer) - len(_MAGIC) + 1), "no header")
                return None
            if start:
                self._discard(start, "bytes between frames")
            if len(self._buffer) < _HEADER.size:
                return None
            _, kind, width, height, seq, stamp, length, crc, check = _HEADER.unpack_from(self._buffer)
            sane = length <= _LARGEST and (kind == _IDENTITY or (kind == _FRAME and length == width * height > 0))
            if not sane or crc16(bytes(self._buffer[: _HEADER.size - 2])) != check:
                self._discard(len(_MAGIC), "wrong header")
                continue
            end = _HEADER.size + length
            if len(self._buffer) < end:
                return None
            payload = bytes(memoryview(self._buffer)[_HEADER.size : end])
            if zlib.crc32(payload) != crc:
                self._discard(len(_MAGIC), "wrong checksum")
                continue
            del self._buffer[:end]
            self.tally.accepted += 1
            if kind == _IDENTITY:
                model, serial, firmware = payload.decode(errors="replace").split("\n")
                return Identity(model, serial, firmware)
            return Picture(np.frombuffer(payload, np.uint8).reshape(height, width), seq, stamp / 1e6)

    def _discard(self, count: int, why: str) -> None:
        if count:
            del self._buffer[:count]
            self.tally.discarded += count
            self.tally.last_fault = why
