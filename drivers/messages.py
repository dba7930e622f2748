"""Messages between host and device, before any codec turns it into bytes.

Every instrument speaks the same few messages in a dialect of its own. A request carries a number and is answered by a
`Reply` with the same number; a host that hears nothing sends the same request again, and a device that has
already answered that number repeats its answer instead of acting twice. Samples come unasked while the stream is on;
ahead of every answer to a command goes a status (`Samples` without samples).

Beats and samples carry a count that only rises. A beat that is repeated or late is no beat, and a status that is
repeated or late is not believed: a link that says the same thing for ever keeps nobody under suction.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from drivers.device import Identity, Status
from drivers.signals import FloatArray
from protocols.limits import Range

#: Request numbers run from 1 to this and start again.
LAST_NUMBER = 255


@dataclass(frozen=True)
class Identify:
    """Who are you? The reply's text is an `Identity`."""


@dataclass(frozen=True)
class Stream:
    """Samples on or off."""

    on: bool


@dataclass(frozen=True)
class Arm:
    """Limits (SI) per quantity or channel, the watchdog time in s of wall time, the count of the host's last beat."""

    limits: Mapping[str, Range]
    watchdog: float
    beats: int = 0


@dataclass(frozen=True)
class Piece:
    """A segment as the device executes it: duration in s, value of each quantity (SI) at its start and end."""

    duration: float
    start: tuple[float, ...]
    end: tuple[float, ...]


@dataclass(frozen=True)
class Enqueue:
    """Append pieces; the device takes all of them or refuses all."""

    pieces: tuple[Piece, ...]


@dataclass(frozen=True)
class Start:
    """Execute the queue."""


@dataclass(frozen=True)
class Hold:
    """Vent or return to the centre; forget the queue."""


@dataclass(frozen=True)
class Skip:
    """End piece number ``index`` now, if it is still the running one."""

    index: int


@dataclass(frozen=True)
class Safe:
    """Vent, stop, forget the queue and the limits."""


Body = Identify | Stream | Arm | Enqueue | Start | Hold | Skip | Safe


@dataclass(frozen=True)
class Request:
    """A command that is answered; ``number`` is 1 … `LAST_NUMBER`."""

    number: int
    body: Body


@dataclass(frozen=True)
class Beat:
    """The host is alive. Never answered; ``count`` is higher than that of every beat before."""

    count: int


@dataclass(frozen=True)
class Reply:
    """The answer to a request: done, or refused with the reason; ``identity`` answers `Identify`."""

    number: int
    refused: str = ""
    identity: Identity | None = None


@dataclass(frozen=True)
class Samples:
    """Consecutive samples: number of the first, device time (n,) s, raw values (n, channels), status after the last.

    ``packet`` counts the device's messages of this kind since it was switched on. Pieces of one have the same.
    """

    first: int
    time: FloatArray
    values: FloatArray
    status: Status
    packet: int = 0

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Samples):
            return NotImplemented
        return (
            (self.packet, self.first) == (other.packet, other.first)
            and np.array_equal(self.time, other.time)
            and np.array_equal(self.values, other.values, equal_nan=True)
            and repr(self.status) == repr(other.status)
        )

    __hash__ = None  # type: ignore[assignment]


Message = Request | Beat | Reply | Samples


@dataclass
class Tally:
    """A decoder's counts: ``accepted`` messages, and bytes ``discarded`` on the way back into step."""

    accepted: int = 0
    discarded: int = 0
    last_fault: str = ""
