"""Limits: the ranges within which a run must stay, from hardware, station, protocol and subject, intersected.

Nothing here clips. A set-point outside is an error before arming (`protocols.compile_protocol`), a measured value
outside is a trip while running (the engine's interlock).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from protocols import units
from protocols.setpoints import Segment, Setpoints

#: The probe's excursion as a whole: the length of (probe_x, probe_y, probe_z) in m; its rate is the speed of the tip.
PROBE = "probe"
PROBE_AXES = ("probe_x", "probe_y", "probe_z")
# Relative slack of every comparison: unit conversion and angles leave errors of a few ulp, physics never asks for 1e-9.
_SLACK = 1e-9


@dataclass(frozen=True)
class Range:
    """Lowest and highest allowed value (SI), and the largest allowed absolute rate of change (SI per s)."""

    low: float = -math.inf
    high: float = math.inf
    rate: float = math.inf

    def __post_init__(self) -> None:
        if math.isnan(self.low) or math.isnan(self.high) or math.isnan(self.rate):
            raise ValueError(f"a limit is not a number: {self}")
        if self.low > self.high:
            raise ValueError(f"the range is empty: low {self.low:g} is above high {self.high:g}")
        if self.rate <= 0:
            raise ValueError(f"the rate limit must be positive, not {self.rate:g}")

    @property
    def bounded(self) -> bool:
        """Whether both ends are finite."""
        return math.isfinite(self.low) and math.isfinite(self.high)

    def intersect(self, other: Range) -> Range:
        """What both allow. Raises ValueError when nothing is left."""
        return Range(max(self.low, other.low), min(self.high, other.high), min(self.rate, other.rate))

    def holds(self, value: float) -> bool:
        """Whether ``value`` is inside (False for NaN)."""
        slack = _SLACK * max((abs(v) for v in (self.low, self.high) if math.isfinite(v)), default=0.0)
        return self.low - slack <= value <= self.high + slack

    def holds_rate(self, rate: float) -> bool:
        """Whether a rate of change is allowed (False for NaN)."""
        return abs(rate) <= self.rate * (1 + _SLACK)


@dataclass(frozen=True)
class Violation:
    """One set-point out of its limits; ``step`` is the path of the protocol step it came from."""

    step: str
    quantity: str
    message: str


@dataclass(frozen=True)
class Limits:
    """A `Range` per commanded quantity or measured channel; what is not named is not bounded.

    ``origin`` says whose limits these are (``hardware``, ``station``, ``hardware ∩ protocol`` …), for messages.
    """

    ranges: Mapping[str, Range] = field(default_factory=dict)
    origin: str = ""

    @classmethod
    def parse(cls, written: Mapping[str, Mapping[str, str]], origin: str = "") -> Limits:
        """From text with units: ``{"pressure": {"low": "-500 mbar", "high": "0 mbar", "rate": "1000 mbar/s"}}``.

        Raises ValueError that names the quantity and the entry.
        """
        ranges = {}
        for name, entries in written.items():
            kind = units.kind_of(name)
            values = {}
            for key, text in entries.items():
                if key not in ("low", "high", "rate"):
                    raise ValueError(f"{name}: unknown entry {key!r}; a limit has low, high and rate")
                try:
                    values[key] = units.parse(text, units.rate_kind(kind) if key == "rate" else kind)
                except ValueError as error:
                    raise ValueError(f"{name}.{key}: {error}") from None
            try:
                ranges[name] = Range(**values)
            except ValueError as error:
                raise ValueError(f"{name}: {error}") from None
        return cls(ranges, origin)

    def __getitem__(self, name: str) -> Range:
        return self.ranges.get(name, Range())

    def __bool__(self) -> bool:
        return bool(self.ranges)

    def intersect(self, other: Limits) -> Limits:
        """What both allow. Raises ValueError that names the quantity for which nothing is left."""
        merged = dict(self.ranges)
        for name, there in other.ranges.items():
            try:
                merged[name] = self[name].intersect(there)
            except ValueError as error:
                raise ValueError(
                    f"{name}: {self.origin} and {other.origin} limits exclude each other ({error})"
                ) from None
        origins = [o for o in (self.origin, other.origin) if o]
        return Limits(merged, " ∩ ".join(dict.fromkeys(origins)))

    def values(self) -> dict[str, tuple[float, float]]:
        """(low, high) per name in SI: what `drivers.device.Device.arm` takes and a recording keeps."""
        return {name: (r.low, r.high) for name, r in self.ranges.items()}

    def rates(self) -> dict[str, float]:
        """Largest absolute rate per name, where one is set."""
        return {name: r.rate for name, r in self.ranges.items() if math.isfinite(r.rate)}

    def violations(self, setpoints: Setpoints) -> Iterator[Violation]:
        """Every set-point that leaves the limits, in order; one for each quantity whose limits are missing.

        After a segment with ``until``, the next may begin anywhere along it: both ends are tried as its beginning.
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
    if set(PROBE_AXES) <= set(names):
        # |p| is convex along a straight line: its largest value is at an end.
        lengths = [_length(s) for s in (*starts, segment.end)]
        jump = max(math.dist([s[a] for a in PROBE_AXES], [segment.end[a] for a in PROBE_AXES]) for s in starts)
        yield PROBE, max(lengths), max(lengths), _rate(jump, segment.duration)


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
