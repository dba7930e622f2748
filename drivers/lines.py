"""Dialects of text lines: a head, a request number, a verb, arguments, a CRC-16 in hexadecimal after an asterisk.

``@0A QUEUE 60.0,-30000.0,-30000.0*5C21\\r`` — an instrument's dialect chooses the head, the verbs and how samples are
written.
"""

from __future__ import annotations

import abc
import math
from collections.abc import Mapping
from dataclasses import astuple
from urllib.parse import quote, unquote

from drivers import messages as msg
from drivers.device import Identity, Status
from drivers.framing import Splitter, crc16
from drivers.stream import Codec
from protocols.limits import Range

#: Longest line in bytes: a full queue, or a block of samples.
LONGEST = 32768
STATES = {"I": "idle", "A": "armed", "R": "running", "H": "held", "S": "safe", "F": "fault"}
_LETTERS = {state: letter for letter, state in STATES.items()}
_PLAIN = " ,.:()/+-=<>"  # characters free text may hold unescaped; '*', ';' and controls are escaped


class LineCodec(Codec):
    """Messages as lines. Subclasses set the class attributes and write and read sample lines."""

    #: First characters of a request, a reply and a sample line; all different.
    REQUEST: str
    REPLY: str
    SAMPLE: str
    TERMINATOR: bytes
    VERBS: Mapping[type, str]
    BEAT: str

    def __init__(self) -> None:
        super().__init__()
        self._lines = Splitter(self.TERMINATOR, LONGEST)
        self._bodies = {verb: body for body, verb in self.VERBS.items()}

    @abc.abstractmethod
    def sample_lines(self, samples: msg.Samples) -> list[str]:
        """The lines (without head and CRC) that carry a block of samples."""

    @abc.abstractmethod
    def parse_sample(self, text: str) -> msg.Samples:
        """One line's samples. Raises ValueError or IndexError when it is not one."""

    def encode(self, message: msg.Message) -> bytes:
        if isinstance(message, msg.Samples):
            return b"".join(self._line(self.SAMPLE + line) for line in self.sample_lines(message))
        if isinstance(message, msg.Beat):
            return self._line(f"{self.REQUEST}00 {self.BEAT} {message.count}")
        if isinstance(message, msg.Reply):
            return self._line(f"{self.REPLY}{message.number:02X} {_reply_text(message)}")
        arguments = _arguments(message.body)
        verb = self.VERBS[type(message.body)]
        return self._line(f"{self.REQUEST}{message.number:02X} {verb}{' ' if arguments else ''}{arguments}")

    def decode(self, data: bytes) -> list[msg.Message]:
        found: list[msg.Message] = []
        overrun = self._lines.overrun
        for line in self._lines.feed(data):
            try:
                found.append(self._parse(line))
                self.tally.accepted += 1
            except (ValueError, IndexError, KeyError) as error:
                self.tally.discarded += len(line) + len(self.TERMINATOR)
                self.tally.last_fault = f"{error} in {line[:60]!r}"
        self.tally.discarded += self._lines.overrun - overrun
        return found

    def _line(self, text: str) -> bytes:
        data = text.encode("ascii")
        if len(data) > LONGEST - 8:
            raise ValueError(f"a line of {len(data)} bytes is longer than the dialect allows ({LONGEST})")
        return b"%b*%04X%b" % (data, crc16(data), self.TERMINATOR)

    def _parse(self, line: bytes) -> msg.Message:
        if line[-5:-4] != b"*":
            raise ValueError("no checksum")
        data = line[:-5]
        if int(line[-4:], 16) != crc16(data):
            raise ValueError("wrong checksum")
        text = data.decode("ascii")
        head = text[0]
        if head == self.SAMPLE:
            return self.parse_sample(text[1:])
        number = int(text[1:3], 16)
        verb, _, rest = text[4:].partition(" ")
        if head == self.REPLY:
            return _parse_reply(number, verb, rest)
        if head != self.REQUEST:
            raise ValueError(f"unknown head {head!r}")
        if verb == self.BEAT:
            return msg.Beat(int(rest))
        return msg.Request(number, _parse_arguments(self._bodies[verb], rest))


def write_status(status: Status) -> str:
    """Status without its time: state letter, executed, queued, when the running segment began in µs, fault."""
    began = -1 if math.isnan(status.began) else round(status.began * 1e6)
    return f"{_LETTERS[status.state]},{status.executed},{status.queued},{began},{quote(status.fault, _PLAIN[0])}"


def read_status(text: str, time: float) -> Status:
    """The inverse of `write_status`. Raises ValueError, KeyError."""
    letter, executed, queued, began, fault = text.split(",")
    when = math.nan if int(began) < 0 else int(began) / 1e6
    return Status(time, STATES[letter], int(executed), int(queued), unquote(fault), when)


def _reply_text(reply: msg.Reply) -> str:
    if reply.refused:
        return f"NO {quote(reply.refused, _PLAIN)}"
    if reply.identity is not None:
        who = reply.identity
        return f"ID {';'.join(quote(part, _PLAIN) for part in (who.model, who.serial, who.firmware))}"
    return "OK"


def _parse_reply(number: int, verb: str, rest: str) -> msg.Reply:
    if verb == "OK":
        return msg.Reply(number)
    if verb == "NO":
        return msg.Reply(number, refused=unquote(rest) or "no reason given")
    if verb == "ID":
        model, serial, firmware = (unquote(part) for part in rest.split(";"))
        return msg.Reply(number, identity=Identity(model, serial, firmware))
    raise ValueError(f"unknown reply {verb!r}")


def _arguments(body: msg.Body) -> str:
    match body:
        case msg.Stream(on):
            return "1" if on else "0"
        case msg.Arm(limits, watchdog, beats):
            ranges = [f"{quote(name, '')}={':'.join(map(repr, astuple(r)))}" for name, r in limits.items()]
            return ";".join([repr(float(watchdog)), str(beats), *ranges])
        case msg.Enqueue(pieces):
            return ";".join(",".join(repr(v) for v in (p.duration, *p.start, *p.end)) for p in pieces)
        case msg.Skip(index):
            return str(index)
        case _:
            return ""


def _parse_arguments(kind: type, text: str) -> msg.Body:
    if kind is msg.Stream:
        return msg.Stream({"0": False, "1": True}[text])
    if kind is msg.Arm:
        watchdog, beats, *ranges = text.split(";")
        limits = {}
        for part in ranges:
            name, _, numbers = part.partition("=")
            low, high, rate, dwell = (float(v) for v in numbers.split(":"))
            limits[unquote(name)] = Range(low, high, rate, dwell)
        return msg.Arm(limits, float(watchdog), int(beats))
    if kind is msg.Enqueue:
        return msg.Enqueue(tuple(_piece([_finite(v) for v in part.split(",")]) for part in text.split(";")))
    if kind is msg.Skip:
        return msg.Skip(int(text))
    if text:
        raise ValueError(f"{kind.__name__.lower()} takes no argument")
    body: msg.Body = kind()
    return body


def _piece(numbers: list[float]) -> msg.Piece:
    count, odd = divmod(len(numbers) - 1, 2)
    if odd or not count:
        raise ValueError(f"a segment of {len(numbers)} numbers")
    return msg.Piece(numbers[0], tuple(numbers[1 : 1 + count]), tuple(numbers[1 + count :]))


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is not a finite number")
    return value
