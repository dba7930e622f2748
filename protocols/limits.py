"""Limits: the ranges within which a run must stay, from hardware, station, protocol and subject, intersected.

Nothing here clips. A set-point outside is an error before arming (`protocols.compile_protocol`), a measured value
outside is a trip while running (the engine's interlock).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from protocols import units
from protocols.setpoints import Segment, Setpoints

#: The probe's excursion as a whole: the length of (probe_x, probe_y, probe_z) in m; its rate is the speed of the tip.
PROBE = "probe"
PROBE_AXES = ("probe_x", "probe_y", "probe_z")
#: A dwell is over when the quantity was at rest (zero: vented, centred) for this long, in s (assumed).
RELIEF = 1.0
# Relative slack of every comparison: unit conversion and angles leave errors of a few ulp, physics never asks for 1e-9.
_SLACK = 1e-9


def limited(quantities: Iterable[str]) -> tuple[str, ...]:
    """Names that limits of these quantities or channels may have: their own, and `PROBE` where its axes are there."""
    names = tuple(quantities)
    return (*names, PROBE) if set(PROBE_AXES) <= set(names) else names


@dataclass(frozen=True)
class Range:
    """Lowest and highest allowed value (SI), and the largest allowed absolute rate of change (SI per s).

    ``dwell`` is the longest time in s away from rest (zero: vented, centred); a rest shorter than `RELIEF` does not
    interrupt it.
    """

    low: float = -math.inf
    high: float = math.inf
    rate: float = math.inf
    dwell: float = math.inf

    def __post_init__(self) -> None:
        if any(map(math.isnan, (self.low, self.high, self.rate, self.dwell))):
            raise ValueError(f"a limit is not a number: {self}")
        if self.low > self.high:
            raise ValueError(f"the range is empty: low {self.low:g} is above high {self.high:g}")
        if self.rate <= 0:
            raise ValueError(f"the rate limit must be positive, not {self.rate:g}")
        if self.dwell <= 0:
            raise ValueError(f"the dwell limit must be positive, not {self.dwell:g} s")

    @property
    def bounded(self) -> bool:
        """Whether both ends are finite."""
        return math.isfinite(self.low) and math.isfinite(self.high)

    def intersect(self, other: Range) -> Range:
        """The range that both allow. Raises ValueError when nothing is left."""
        return Range(
            max(self.low, other.low),
            min(self.high, other.high),
            min(self.rate, other.rate),
            min(self.dwell, other.dwell),
        )

    def holds(self, value: float) -> bool:
        """Whether ``value`` is inside (False for NaN)."""
        slack = _SLACK * max((abs(v) for v in (self.low, self.high) if math.isfinite(v)), default=0.0)
        return self.low - slack <= value <= self.high + slack

    def holds_dwell(self, seconds: float) -> bool:
        """Whether a time away from rest is allowed (False for NaN)."""
        return seconds <= self.dwell * (1 + _SLACK)

    def holds_rate(self, rate: float) -> bool:
        """Whether a rate of change is allowed (False for NaN)."""
        return abs(rate) <= self.rate * (1 + _SLACK)


@dataclass
class DwellTimer:
    """For how long something is away from rest without `RELIEF` s of rest; told moment by moment, in order.

    A tenth of that is spared for moments that are samples.
    """

    _since: float = math.nan  # when it left rest
    _rest: float = -math.inf  # since when it is at rest; NaN while it is away
    _last: float = math.nan

    def at(self, time: float, away: bool) -> float:
        """The dwell in s at ``time`` s, 0 at rest. Between two moments it counts as away if it is at the second."""
        if not away:
            if math.isnan(self._rest):
                self._rest = time
            self._last = time
            return 0.0
        # The rest lasted until the moment before, not until this one. NaN compares false.
        if math.isnan(self._since) or self._last - self._rest >= 0.9 * RELIEF:
            self._since = self._last if math.isfinite(self._last) else time
        self._rest, self._last = math.nan, time
        return time - self._since


@dataclass(frozen=True)
class Violation:
    """One set-point out of its limits; ``step`` is the path of the protocol step it came from."""

    step: str
    quantity: str
    message: str


@dataclass(frozen=True)
class Limits:
    """A `Range` per commanded quantity or measured channel; one that is not named is not bounded.

    ``origin`` says whose limits these are (``hardware``, ``station``, ``hardware ∩ protocol`` …), for messages.
    """

    ranges: Mapping[str, Range] = field(default_factory=dict)
    origin: str = ""

    @classmethod
    def parse(cls, written: Mapping[str, Mapping[str, str]], origin: str = "") -> Limits:
        """From text with units: ``{"pressure": {"low": "-500 mbar", "rate": "1000 mbar/s", "dwell": "120 s"}}``.

        Raises ValueError that names the quantity and the entry.
        """
        ranges = {}
        for name, entries in written.items():
            kind = units.kind_of(name)
            kinds = {"low": kind, "high": kind, "rate": units.rate_kind(kind), "dwell": "time"}
            values = {}
            for key, text in entries.items():
                if key not in kinds:
                    raise ValueError(f"{name}: unknown entry {key!r}; a limit has {', '.join(kinds)}")
                try:
                    values[key] = units.parse(text, kinds[key])
                except ValueError as error:
                    raise ValueError(f"{name}.{key}: {error}") from None
            try:
                _check_ends(name, values.get("low", -math.inf), values.get("high", math.inf))
                ranges[name] = Range(**values)
            except ValueError as error:
                raise ValueError(f"{name}: {error}") from None
        return cls(ranges, origin)

    def __getitem__(self, name: str) -> Range:
        return self.ranges.get(name, Range())

    def __bool__(self) -> bool:
        return bool(self.ranges)

    def intersect(self, other: Limits) -> Limits:
        """The range that both allow. Raises ValueError that names the quantity for which nothing is left."""
        merged = dict(self.ranges)
        for name, there in other.ranges.items():
            try:
                _check_ends(name, max(self[name].low, there.low), min(self[name].high, there.high))
                merged[name] = self[name].intersect(there)
            except ValueError as error:
                raise ValueError(
                    f"{name}: {self.origin} and {other.origin} limits exclude each other ({error})"
                ) from None
        origins = [o for o in (self.origin, other.origin) if o]
        return Limits(merged, " ∩ ".join(dict.fromkeys(origins)))

    def values(self) -> dict[str, tuple[float, float]]:
        """(low, high) per name in SI, as a recording keeps them."""
        return {name: (r.low, r.high) for name, r in self.ranges.items()}

    def rates(self) -> dict[str, float]:
        """Largest absolute rate per name, where one is set."""
        return {name: r.rate for name, r in self.ranges.items() if math.isfinite(r.rate)}

    def violations(self, setpoints: Setpoints) -> Iterator[Violation]:
        """Every set-point that leaves the limits, in order; one for each quantity whose limits are missing.

        After a segment with ``until``, the next may begin anywhere along it: both ends are tried as its beginning.
        Such a segment may take any time up to its duration: all of it counts as dwell, none of it as rest.
        """
        for quantity in setpoints.quantities:
            if not self[quantity].bounded:
                yield Violation("", quantity, "has no limits: without limits nothing is armed")
        before: Segment | None = None
        for segment in setpoints.segments:
            starts = [segment.start]
            if before is not None and before.until is not None:
                starts = [before.start, before.end]
            for name, low, high, rate in _extremes(starts, segment):
                yield from self._outside(segment.step, name, low, high, rate)
            before = segment
        for name in (*setpoints.quantities, PROBE):
            yield from self._too_long(name, setpoints)

    def _too_long(self, name: str, setpoints: Setpoints) -> Iterator[Violation]:
        """The segments in which a dwell becomes longer than allowed."""
        allowed = self[name]
        if math.isinf(allowed.dwell):
            return
        away, rest = 0.0, math.inf  # s since it left rest, s of rest since it came back
        for segment in setpoints.segments:
            if not _leaves_rest(name, segment):
                rest += segment.duration if segment.until is None else 0.0
                continue
            before = 0.0 if rest >= RELIEF * (1 - _SLACK) else away + rest
            away, rest = before + segment.duration, 0.0
            if allowed.holds_dwell(before) and not allowed.holds_dwell(away):
                yield Violation(
                    segment.step,
                    name,
                    f"is away from rest for {away:.6g} s without {RELIEF:g} s of rest, longer than the "
                    f"{allowed.dwell:.6g} s allowed{self._whose()}",
                )

    def _outside(self, step: str, name: str, low: float, high: float, rate: float) -> Iterator[Violation]:
        allowed = self[name]
        kind = units.kind_of(name)
        for value in dict.fromkeys((low, high)):
            if not allowed.holds(value):
                sign = (
                    " (suction is negative: write -300 mbar, or suction: 300 mbar)"
                    if _is_suction_sign(name, value)
                    else ""
                )
                yield Violation(
                    step,
                    name,
                    f"{units.write(value, kind)} is outside {_text(allowed.low, kind)} … {_text(allowed.high, kind)}"
                    f"{self._whose()}{sign}",
                )
        if not allowed.holds_rate(rate):
            asked = "a step at once" if math.isinf(rate) else _text(rate, units.rate_kind(kind))
            hint = "; give it a rate or a duration" if math.isinf(rate) else ""
            most = _text(allowed.rate, units.rate_kind(kind))
            yield Violation(step, name, f"{asked} is faster than the {most} allowed{self._whose()}{hint}")

    def _whose(self) -> str:
        return f" ({self.origin} limits)" if self.origin else ""


def _extremes(starts: list[Mapping[str, float]], segment: Segment) -> Iterator[tuple[str, float, float, float]]:
    """Name, lowest value, highest value and largest absolute rate of each quantity along a segment."""
    names = list(segment.end)
    for name in names:
        ends = [s[name] for s in starts] + [segment.end[name]]
        jump = max(abs(segment.end[name] - s[name]) for s in starts)
        yield name, min(ends), max(ends), _rate(jump, segment.duration)
    if PROBE in limited(names):
        # |p| is convex along a straight line: its largest value is at an end.
        lengths = [_length(s) for s in (*starts, segment.end)]
        jump = max(math.dist([s[a] for a in PROBE_AXES], [segment.end[a] for a in PROBE_AXES]) for s in starts)
        yield PROBE, max(lengths), max(lengths), _rate(jump, segment.duration)


def _check_ends(name: str, low: float, high: float) -> None:
    """Raise ValueError, in the unit that people use, where nothing lies between ``low`` and ``high`` (SI)."""
    if low > high:
        kind = units.kind_of(name)
        raise ValueError(f"the range is empty: low {_text(low, kind)} is above high {_text(high, kind)}")


def _leaves_rest(name: str, segment: Segment) -> bool:
    parts = [q for q in segment.end if q == name or (name == PROBE and q in PROBE_AXES)]
    return any(segment.start[q] != 0 or segment.end[q] != 0 for q in parts)


def _length(position: Mapping[str, float]) -> float:
    return math.hypot(*(position[a] for a in PROBE_AXES))


def _rate(jump: float, duration: float) -> float:
    if jump == 0:
        return 0.0
    return jump / duration if duration > 0 else math.inf


def _is_suction_sign(name: str, value: float) -> bool:
    return name == "pressure" and value > 0


def _text(value: float, kind: str) -> str:
    if math.isinf(value):
        return "unbounded"
    pleasant = units.KINDS[kind][1][0]
    return f"{value / units.parse(f'1 {pleasant}', kind):.6g} {pleasant}"
