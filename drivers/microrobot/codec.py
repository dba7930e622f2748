"""The micro-robot controller's dialect: COBS packets with a CRC-32, little endian, ended by a zero byte.

Assumed, not taken from hardware: the paper's robot ran on a National Instruments card; here its controller is a
firmware peer on USB. Packet: kind (u8), request number (u8), body, CRC-32 of all before. Text is UTF-8 after its
length (u8). Samples: packet (u32), number of the first (u32), its time in µs (u64), status, count n (u16), µs after the
first (n u32), then the raw channels one after the other (n f32 each).
"""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import astuple
from typing import Any

import numpy as np

from drivers import messages as msg
from drivers.device import Identity, Status
from drivers.framing import Splitter, cobs_decode, cobs_encode
from drivers.stream import Codec
from protocols.limits import Range

#: Raw channels: axis positions in m and transducer voltages in V.
RAW = ("axis_position_1", "axis_position_2", "axis_position_3", "voltage_a", "voltage_b", "voltage_c")
#: Segments that the controller's queue holds (assumed).
CAPACITY = 128
#: Longest packet in bytes.
LONGEST = 65000

_KINDS: dict[type, int] = {
    msg.Identify: 1,
    msg.Stream: 2,
    msg.Arm: 3,
    msg.Enqueue: 4,
    msg.Start: 5,
    msg.Hold: 6,
    msg.Skip: 7,
    msg.Safe: 8,
}
_BODIES = {kind: body for body, kind in _KINDS.items()}
_BEAT, _REPLY, _SAMPLES = 0x20, 0x40, 0x80
_DONE, _REFUSED, _IDENTITY = 0, 1, 2
_STATES = ("idle", "armed", "running", "held", "safe", "fault")
_PIECE = struct.Struct("<d6d")
_STATUS = struct.Struct("<BIIqQ")
_FIRST = struct.Struct("<IIQ")
_ARM = struct.Struct("<dQ")
_RANGE = struct.Struct("<4d")
_COUNT = struct.Struct("<Q")


class MicrorobotCodec(Codec):
    """One end of a micro-robot link."""

    def __init__(self) -> None:
        super().__init__()
        self._packets = Splitter(b"\0", LONGEST + 512)

    def encode(self, message: msg.Message) -> bytes:
        match message:
            case msg.Samples():
                return _packet(_SAMPLES, 0, _samples(message))
            case msg.Beat():
                return _packet(_BEAT, 0, _COUNT.pack(message.count))
            case msg.Reply():
                return _packet(_REPLY, message.number, _reply(message))
            case _:
                return _packet(_KINDS[type(message.body)], message.number, _body(message.body))

    def decode(self, data: bytes) -> list[msg.Message]:
        found: list[msg.Message] = []
        overrun = self._packets.overrun
        for packet in self._packets.feed(data):
            try:
                found.append(_parse(packet))
                self.tally.accepted += 1
            except (ValueError, KeyError, IndexError, struct.error) as error:
                self.tally.discarded += len(packet) + 1
                self.tally.last_fault = f"{error} in a packet of {len(packet)} bytes"
        self.tally.discarded += self._packets.overrun - overrun
        return found


def _packet(kind: int, number: int, body: bytes) -> bytes:
    content = bytes((kind, number)) + body
    if len(content) > LONGEST:
        raise ValueError(f"a packet of {len(content)} bytes is longer than the dialect allows ({LONGEST})")
    return cobs_encode(content + zlib.crc32(content).to_bytes(4, "little")) + b"\0"


def _parse(packet: bytes) -> msg.Message:
    content = cobs_decode(packet)
    if len(content) < 6:
        raise ValueError("short packet")
    if zlib.crc32(content[:-4]) != int.from_bytes(content[-4:], "little"):
        raise ValueError("wrong checksum")
    reader = _Reader(content[2:-4])
    message = _message(content[0], content[1], reader)
    reader.finish()
    return message


def _message(kind: int, number: int, reader: _Reader) -> msg.Message:
    if kind == _SAMPLES:
        return _parse_samples(reader)
    if kind == _BEAT:
        return msg.Beat(*reader.take(_COUNT))
    if kind == _REPLY:
        return _parse_reply(number, reader)
    return msg.Request(number, _parse_body(_BODIES[kind], reader))


class _Reader:
    """Takes values off the front of a packet. Raises struct.error or ValueError when there is not enough."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def take(self, layout: struct.Struct) -> tuple[Any, ...]:
        values = layout.unpack_from(self._data, self._at)
        self._at += layout.size
        return values

    def text(self) -> str:
        length = self._data[self._at]
        end = self._at + 1 + length
        if end > len(self._data):
            raise ValueError("text runs past the end")
        text = self._data[self._at + 1 : end].decode()
        self._at = end
        return text

    def array(self, dtype: str, count: int) -> np.ndarray[Any, Any]:
        values = np.frombuffer(self._data, dtype, count, self._at)
        self._at += values.nbytes
        return values

    @property
    def left(self) -> int:
        return len(self._data) - self._at

    def finish(self) -> None:
        if self.left:
            raise ValueError(f"{self.left} bytes too many")


def _text(text: str) -> bytes:
    data = text.encode()[:255].decode(errors="ignore").encode()  # cut between characters
    return bytes((len(data),)) + data


def _samples(samples: msg.Samples) -> bytes:
    status = samples.status
    stamps = np.rint(np.append(samples.time, status.time) * 1e6).astype(np.int64)
    began = -1 if math.isnan(status.began) else round(status.began * 1e6)
    return b"".join(
        (
            _FIRST.pack(samples.packet, samples.first, int(stamps[0])),
            _STATUS.pack(_STATES.index(status.state), status.executed, status.queued, began, int(stamps[-1])),
            _text(status.fault),
            len(samples.time).to_bytes(2, "little"),
            (stamps[:-1] - stamps[0]).astype("<u4").tobytes(),
            samples.values.T.astype("<f4").tobytes(),
        )
    )


def _parse_samples(reader: _Reader) -> msg.Samples:
    packet, first, start = reader.take(_FIRST)
    state, executed, queued, began, end = reader.take(_STATUS)
    fault = reader.text()
    count = int(reader.array("<u2", 1)[0])
    time = (start + reader.array("<u4", count).astype(np.int64)) / 1e6
    values = reader.array("<f4", count * len(RAW)).reshape(len(RAW), count).T.astype(np.float64)
    status = Status(end / 1e6, _STATES[state], executed, queued, fault, math.nan if began < 0 else began / 1e6)
    return msg.Samples(first, time, values, status, packet)


def _reply(reply: msg.Reply) -> bytes:
    if reply.refused:
        return bytes((_REFUSED,)) + _text(reply.refused)
    if reply.identity is not None:
        who = reply.identity
        return bytes((_IDENTITY,)) + _text(who.model) + _text(who.serial) + _text(who.firmware)
    return bytes((_DONE,))


def _parse_reply(number: int, reader: _Reader) -> msg.Reply:
    kind = int(reader.array("u1", 1)[0])
    if kind == _REFUSED:
        return msg.Reply(number, refused=reader.text() or "no reason given")
    if kind == _IDENTITY:
        return msg.Reply(number, identity=Identity(reader.text(), reader.text(), reader.text()))
    if kind != _DONE:
        raise ValueError(f"unknown reply {kind}")
    return msg.Reply(number)


def _body(body: msg.Body) -> bytes:
    match body:
        case msg.Stream(on):
            return bytes((on,))
        case msg.Arm(limits, watchdog, beats):
            ranges = (_text(name) + _RANGE.pack(*astuple(r)) for name, r in limits.items())
            return _ARM.pack(watchdog, beats) + b"".join(ranges)
        case msg.Enqueue(pieces):
            return b"".join(_PIECE.pack(p.duration, *p.start, *p.end) for p in pieces)
        case msg.Skip(index):
            return struct.pack("<I", index)
        case _:
            return b""


def _parse_body(kind: type, reader: _Reader) -> msg.Body:
    if kind is msg.Stream:
        return msg.Stream(bool(reader.array("u1", 1)[0]))
    if kind is msg.Arm:
        watchdog, beats = reader.take(_ARM)
        limits = {}
        while reader.left:
            name = reader.text()
            limits[name] = Range(*reader.take(_RANGE))
        return msg.Arm(limits, watchdog, beats)
    if kind is msg.Enqueue:
        pieces = []
        while reader.left:
            numbers = reader.take(_PIECE)
            if not all(map(math.isfinite, numbers)):
                raise ValueError("a segment with a value that is not finite")
            pieces.append(msg.Piece(numbers[0], numbers[1:4], numbers[4:7]))
        return msg.Enqueue(tuple(pieces))
    if kind is msg.Skip:
        return msg.Skip(*reader.take(struct.Struct("<I")))
    body: msg.Body = kind()
    return body
