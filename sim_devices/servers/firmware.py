"""The firmware of a simulated instrument: its segment queue, limits, states and watchdog. No bytes, no physics, no
thread.

::

    idle ──arm──▶ armed ──start──▶ running ──hold──▶ held ──start──▶ running
      ▲             │                 │                │
      │             └───────safe──────┴──────safe──────┘──▶ safe ──arm──▶ armed
    (boot)          └──limit passed or no beat──▶ fault ──safe──▶ safe

Whatever leaves ``running`` vents at once (suction) or goes back to the centre at the rate the instrument allows
(robot). So does a queue that is empty while the instrument is away from rest, after the watchdog's time: that long a
host may take to feed on after an ``until``, and no longer.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np

from drivers import messages as msg
from drivers.device import HOST_SILENT, QUEUE_EMPTY, Identity, Refused, Status
from drivers.signals import FloatArray
from protocols.limits import PROBE, DwellTimer, Limits, Range, limited
from sim_devices.servers.timeline import Waveform

#: Segments shorter than this (s) are steps.
SHORTEST = 1e-5
#: A measured value this share of the allowed span beyond its limit is a fault.
MARGIN = 0.05
#: The longest watchdog time in s that the instrument agrees to, whatever a host asks for.
LONGEST_WATCHDOG = 1.0
_SLACK = 1e-6


@dataclass
class _Motion:
    """The piece being executed; ``counted`` when it came from the host's queue."""

    piece: msg.Piece
    began: float
    counted: bool


@dataclass
class Firmware:
    """The state machine of one instrument.

    ``hardware`` are its own limits; a quantity with a finite rate there cannot step: on start it approaches the
    first segment, on hold it returns to zero at that rate. ``raw`` names the measured channels it watches.
    """

    identity: Identity
    quantities: tuple[str, ...]
    raw: tuple[str, ...]
    capacity: int
    hardware: Limits
    time: float = 0.0
    state: str = "idle"
    fault: str = ""
    executed: int = 0
    began: float = math.nan
    watchdog: float = math.inf
    limits: dict[str, Range] = field(default_factory=dict)
    _queue: deque[msg.Piece] = field(default_factory=deque)
    _motion: _Motion | None = None
    _value: tuple[float, ...] = ()
    _last_beat: float = -math.inf
    _beats: int = 0  # count of the newest beat
    _outside: dict[str, bool] = field(default_factory=dict)  # whether a channel's last sample was
    _dwells: dict[str, DwellTimer] = field(default_factory=dict)  # a new host or a new run does not shorten them
    _cut: bool = False  # the last piece was cut short: the next begins where it ended

    def __post_init__(self) -> None:
        self._value = self._zero
        self._dwells = {name: DwellTimer() for name in self.hardware.ranges}

    @property
    def _zero(self) -> tuple[float, ...]:
        return (0.0,) * len(self.quantities)

    @property
    def status(self) -> Status:
        return Status(self.time, self.state, self.executed, len(self._queue), self.fault, self.began)

    @property
    def command(self) -> dict[str, float]:
        """The command now."""
        return dict(zip(self.quantities, self._value, strict=True))

    @property
    def resting(self) -> bool:
        """Nothing is executed and everything commanded is zero."""
        return self._motion is None and self._value == self._zero and not (self.state == "running" and self._queue)

    @property
    def starved(self) -> bool:
        """Running, with nothing left to execute."""
        return self.state == "running" and self._motion is None and not self._queue

    @property
    def horizon(self) -> float:
        """Device time in s at which the queue runs dry; inf while nothing is executed."""
        if self.state != "running" or self.starved:
            return math.inf
        end = self._motion.began + self._motion.piece.duration if self._motion else self.time
        return end + sum(piece.duration for piece in self._queue)

    def handle(self, body: msg.Body, wall: float) -> None:
        """Obey a request that arrived at ``wall`` (monotonic s). Raises Refused with the reason."""
        match body:
            case msg.Arm():
                self._arm(body, wall)
            case msg.Enqueue(pieces):
                self._enqueue(pieces)
            case msg.Start():
                self._start()
            case msg.Hold():
                if self.state in ("armed", "running"):
                    self._stop("held")
            case msg.Skip(index):
                self._skip(index)
            case msg.Safe():
                self._stop("safe")
                self.limits.clear()

    def beat(self, count: int, wall: float) -> None:
        """The host is alive at ``wall`` (monotonic s); a beat that was counted already says nothing."""
        if count > self._beats:
            self._beats, self._last_beat = count, wall

    def starve(self) -> None:
        """Lose the queue: a fault, for tests."""
        self._queue.clear()

    def watch_host(self, wall: float) -> bool:
        """Vent if the host has been silent for too long; whether that happened just now."""
        if self.state not in ("armed", "running", "held") or wall - self._last_beat <= self.watchdog:
            return False
        self.trip(f"{HOST_SILENT} for {self.watchdog:g} s")
        return True

    def watch_values(self, values: FloatArray) -> None:
        """Vent if a measured value (n, raw channels) is out of its limits twice running; NaN is for the host to judge.

        Once may be a disturbance on a wire.
        """
        if self.state not in ("armed", "running", "held"):
            return
        for column, name in enumerate(self.raw):
            limit = self.limits.get(name, Range())
            spare = MARGIN * (limit.high - limit.low) if limit.bounded else 0.0
            outside = (values[:, column] < limit.low - spare) | (values[:, column] > limit.high + spare)
            twice = outside & np.append(self._outside.get(name, False), outside[:-1])
            self._outside[name] = bool(outside[-1])
            if twice.any():
                value = values[twice, column][0]
                self.trip(f"{name} {value:.6g} is outside {limit.low:.6g} to {limit.high:.6g}")
                return

    def trip(self, reason: str) -> None:
        """Stop by itself."""
        self._stop("fault")
        self.fault = reason

    def advance(self, until: float) -> Waveform:
        """Execute up to ``until`` (device time, s); the result is the set-points on the way."""
        times, values = [self.time], [self._value]

        def reach(time: float, value: tuple[float, ...]) -> None:
            times.append(time)
            values.append(value)
            self.time, self._value = time, value

        while True:
            if self._motion is None:
                if self.state != "running" or not self._queue:
                    reach(until, self._value)
                    break
                piece = self._queue.popleft()
                if self._cut:
                    piece, self._cut = replace(piece, start=self._value), False
                self._motion = _Motion(piece, self.time, True)
                self.began = self.time
                if piece.start != self._value:
                    reach(self.time, piece.start)
            piece, began = self._motion.piece, self._motion.began
            end = began + piece.duration if piece.duration >= SHORTEST else began
            if end <= until:
                reach(end, piece.end)
                if self._motion.counted:
                    self.executed += 1
                    self.began = end
                self._motion = None
            else:
                share = (until - began) / piece.duration
                reach(until, tuple(a + share * (b - a) for a, b in zip(piece.start, piece.end, strict=True)))
                break
        self._watch_queue()
        self._watch_dwells(times, values)
        return Waveform(np.array(times), np.array(values))

    def _watch_queue(self) -> None:
        if self.starved and self._value != self._zero and self.time - self.began > self.watchdog:
            self.trip(f"{QUEUE_EMPTY} for {self.watchdog:g} s, away from rest")

    def _watch_dwells(self, times: list[float], values: list[tuple[float, ...]]) -> None:
        for name, timer in self._dwells.items():
            allowed = self.limits.get(name, Range()).dwell
            dwell = max(timer.at(t, any(self._part(name, value))) for t, value in zip(times, values, strict=True))
            if self.state == "running" and dwell > allowed * (1 + MARGIN) + self.watchdog:
                self.trip(f"{name} is away from rest for longer than {allowed:g} s")

    def _part(self, name: str, value: tuple[float, ...]) -> tuple[float, ...]:
        """The part of a commanded value that a limit of that name is about."""
        return value if name == PROBE else (value[self.quantities.index(name)],)

    def _arm(self, order: msg.Arm, wall: float) -> None:
        limits, watchdog = order.limits, order.watchdog
        if self.state == "fault":
            raise Refused(f"in fault ({self.fault}); make it safe first")
        if self.state in ("running", "held"):
            raise Refused(f"{self.state}; make it safe first")
        if not 0 < watchdog <= LONGEST_WATCHDOG:
            raise Refused(f"a watchdog time of {watchdog:g} s; at most {LONGEST_WATCHDOG:g} s are allowed")
        for name in self.quantities:
            if not limits.get(name, Range()).bounded:
                raise Refused(f"no finite limits for {name}")
        for name, asked in limits.items():
            own = self.hardware[name]
            if not (own.holds(asked.low) and own.holds(asked.high)):
                raise Refused(
                    f"limits {asked.low:g} to {asked.high:g} of {name}; the hardware allows {own.low:g} to {own.high:g}"
                )
        # Limits the host leaves out (a rate, a dwell) stay the hardware's.
        self.limits = dict(self.hardware.intersect(Limits(limits)).ranges)
        self.watchdog = watchdog
        self._last_beat, self._beats = wall, order.beats
        self._outside.clear()
        self._queue.clear()
        self.executed, self.began = 0, math.nan
        self.state = "armed"

    def _enqueue(self, pieces: tuple[msg.Piece, ...]) -> None:
        if self.state not in ("armed", "running", "held"):
            raise Refused(f"not armed ({self.state})")
        if len(self._queue) + len(pieces) > self.capacity:
            raise Refused(f"the queue holds {self.capacity} segments, {len(self._queue)} wait, {len(pieces)} more came")
        tail = self._tail()
        for number, piece in enumerate(pieces):
            self._check(piece, tail, number)
            tail = piece.end
        self._queue.extend(pieces)

    def _tail(self) -> tuple[float, ...] | None:
        """Where the queue ends; None where that is open: the start is approached, or the last piece was cut."""
        if self._queue:
            return self._queue[-1].end
        if self.state != "running" or self._cut:
            return None
        return self._motion.piece.end if self._motion else self._value

    def _check(self, piece: msg.Piece, before: tuple[float, ...] | None, number: int) -> None:
        where = f"segment {number} of those sent: "
        if len(piece.start) != len(self.quantities) or len(piece.end) != len(self.quantities):
            raise Refused(f"{where}{len(piece.start)} values for {len(self.quantities)} quantities")
        if not math.isfinite(piece.duration) or piece.duration < 0:
            raise Refused(f"{where}a duration of {piece.duration:g} s")
        self._check_values(piece, where)
        self._check_dwell(piece, where)
        for k, name in enumerate(self.quantities):
            rate = self.limits[name].rate
            if math.isinf(rate):
                continue
            if before is not None and abs(piece.start[k] - before[k]) > _SLACK:
                raise Refused(f"{where}{name} jumps from {before[k]:g} to {piece.start[k]:g}")
            if abs(piece.end[k] - piece.start[k]) > rate * piece.duration * (1 + _SLACK):
                raise Refused(f"{where}{name} is faster than {rate:g} per s")

    def _check_values(self, piece: msg.Piece, where: str) -> None:
        for name, a, b in zip(self.quantities, piece.start, piece.end, strict=True):
            low, high = self.limits[name].low, self.limits[name].high
            slack = _SLACK * (high - low)
            for value in (a, b):
                if not low - slack <= value <= high + slack:
                    raise Refused(f"{where}{name} {value:g} is outside {low:g} to {high:g}")
        if PROBE in self.limits and PROBE in limited(self.quantities):
            reach = self.limits[PROBE].high
            if max(math.hypot(*piece.start), math.hypot(*piece.end)) > reach * (1 + _SLACK):
                raise Refused(f"{where}the probe leaves its reach of {reach:g} m")

    def _check_dwell(self, piece: msg.Piece, where: str) -> None:
        for name in self._dwells:
            away = any(self._part(name, piece.start)) or any(self._part(name, piece.end))
            if away and not self.limits[name].holds_dwell(piece.duration):
                raise Refused(f"{where}{name} would be away from rest for longer than {self.limits[name].dwell:g} s")

    def _start(self) -> None:
        if self.state == "running":
            return
        if self.state not in ("armed", "held"):
            raise Refused(f"not armed ({self.state})")
        self.state = "running"
        self.executed, self.began = 0, math.nan
        self._cut = False
        self._motion = self._slow_move(self._queue[0].start) if self._queue else None

    def _skip(self, index: int) -> None:
        if self.state != "running" or self._motion is None or not self._motion.counted or index != self.executed:
            return
        self._motion = None
        self._cut = True
        self.executed += 1
        self.began = self.time

    def _stop(self, state: str) -> None:
        """Forget the queue and go to zero."""
        self._queue.clear()
        self.state, self.fault, self._cut = state, "", False
        self.began = self.time
        self._motion = self._slow_move(self._zero)
        if self._motion is None:
            self._value = self._zero

    def _slow_move(self, target: tuple[float, ...]) -> _Motion | None:
        """A move of its own to ``target`` at the allowed rates; None where a step is allowed or nothing moves."""
        rates = [self.hardware[q].rate for q in self.quantities]
        duration = max(abs(b - a) / r for a, b, r in zip(self._value, target, rates, strict=True))
        return _Motion(msg.Piece(duration, self._value, target), self.time, False) if duration > 0 else None
