"""The compiler: protocols to timed set-points, within limits or not at all."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from protocols.errors import ProtocolError
from protocols.limits import PROBE, Limits, Violation
from protocols.schema import CHANNELS, QUANTITIES, Protocol
from protocols.setpoints import Segment, Setpoints, Until
from protocols.source import Key
from protocols.steps import AnyStep, Cycle, Direction, Group, Hold, Ramp, Step, Trajectory, Wait
from protocols.steps import Until as UntilStep

#: A protocol that repeats itself into more segments than this is a mistake (the fingertip series has 141).
MAX_SEGMENTS = 100_000
#: Longest protocol in s: nobody stays with a run for more than a day.
MAX_DURATION = 86_400.0
_COMPARISON = {"above": ">", "below": "<"}


def effective_limits(protocol: Protocol, limits: Limits) -> Limits:
    """``limits`` (hardware, station, subject) intersected with the protocol's own.

    Raises ProtocolError when they exclude each other.
    """
    try:
        return limits.intersect(protocol.own_limits)
    except ValueError as error:
        raise protocol.origin.fault(("limits",), str(error)) from None


def compile_protocol(protocol: Protocol, limits: Limits) -> Setpoints:
    """Linear segments in SI, every one of them inside `effective_limits`; nothing is ever clipped.

    Raises ProtocolError, with the lines, for every step that leaves the limits, for a commanded quantity without
    limits, and for steps that the instrument cannot do.
    """
    compiler = _Compiler(protocol)
    compiler.steps(protocol.steps, ("steps",), {})
    if not compiler.segments:
        raise protocol.origin.fault(("steps",), "every step stays where it is: there is nothing to do")
    setpoints = Setpoints(tuple(compiler.segments))
    found: dict[tuple[str, str, str], Violation] = {}
    for violation in effective_limits(protocol, limits).violations(setpoints):
        found.setdefault((violation.step, violation.quantity, violation.message), violation)
    for violation in _beside_the_hole(protocol, setpoints):
        found.setdefault((violation.step, "", ""), violation)
    if found:
        problems = tuple(protocol.origin.problem(_place(v.step), f"{v.quantity} {v.message}") for v in found.values())
        raise ProtocolError(problems, protocol.origin.file)
    return setpoints


def _beside_the_hole(protocol: Protocol, setpoints: Setpoints) -> Iterator[Violation]:
    """Segments in which the tip would run into the support plate, whose hole it moves in."""
    radius = protocol.setup.hole_radius
    if radius is None:
        return
    for segment in setpoints.segments:
        aside = max(math.hypot(end["probe_x"], end["probe_y"]) for end in (segment.start, segment.end))
        if aside >= radius:
            message = f"goes {1e3 * aside:.4g} mm aside, in a hole of {1e3 * radius:.4g} mm radius (setup.hole_radius)"
            yield Violation(segment.step, PROBE, message)


def _place(step: str) -> Key:
    """The path in the file of a segment's ``step`` (``"1.0"`` is ``steps[1].steps[0]``)."""
    path: list[str | int] = []
    for index in step.split(".") if step else ():
        path += ["steps", int(index)]
    return tuple(path)


class _Compiler:
    """Walks the steps, remembering the value reached, and collects segments."""

    def __init__(self, protocol: Protocol) -> None:
        self.protocol = protocol
        self.rest = dict.fromkeys(QUANTITIES[protocol.instrument], 0.0)
        self.now: Mapping[str, float] = self.rest
        self.segments: list[Segment] = []
        self._duration = 0.0
        self._done = 0
        self._path: Key = ()
        self._phase: str | None = None
        self._labels: dict[str, str] = {}
        self._open_end = False  # the last segment may end early, away from `now`

    def steps(self, steps: tuple[AnyStep, ...], path: Key, labels: Mapping[str, str]) -> None:
        """Compile steps in order."""
        for index, step in enumerate(steps):
            place = (*path, index)
            for repeat in range(1, step.repeat + 1):
                counted = dict(labels)
                if step.repeat > 1:
                    counted[step.counts_as if isinstance(step, Group) else "repeat"] = str(repeat)
                if isinstance(step, Group):
                    self.steps(step.steps, (*place, "steps"), counted)
                else:
                    self._step(step, place, counted)

    def _step(self, step: Step, path: Key, labels: dict[str, str]) -> None:
        self._path, self._labels, self._phase = path, labels, step.phase
        self._done += 1
        if self._done > MAX_SEGMENTS:  # steps that go nowhere make no segments, but time to count
            raise self._fault(f"repeats make more than {MAX_SEGMENTS} steps")
        if isinstance(step, Hold):
            self._hold(step)
        elif isinstance(step, Ramp):
            self._ramp(step)
        elif isinstance(step, Cycle):
            self._cycle(step)
        elif isinstance(step, Wait):
            self._wait(step)
        elif isinstance(step, Trajectory):
            self._trajectory(step)

    def _hold(self, step: Hold) -> None:
        target = self._known(step.target)
        if target is None:
            if self._open_end:
                raise self._fault(
                    "after a ramp with until, a hold must say its value: where the ramp ends is not known"
                )
            target = dict(self.now)
        with self._labelled(level=_level(target)):
            self._approach(target, step.rate, step.speed)
            self._add(step.duration, target, "rest" if target == self.rest else "hold", step.until)

    def _ramp(self, step: Ramp) -> None:
        target = self._known(step.target)
        assert target is not None
        with self._labelled(level=_level(target)):
            if step.duration is not None:
                self._add(step.duration, target, self._direction(target), step.until)
            else:
                self._approach(target, step.rate, step.speed, step.until)

    def _cycle(self, step: Cycle) -> None:
        if "pressure" not in self.rest:
            raise self._fault(f"the {self.protocol.instrument} has no pressure: use a trajectory")
        base = self.now["pressure"]
        rate, leg, peak = step.rate, step.leg, step.peak
        if peak is None:
            assert rate is not None  # two of the three are given
            assert leg is not None
            peak = base - rate * leg
        if leg is None:
            assert rate is not None
            leg = abs(peak - base) / rate
        if peak == base:
            raise self._fault("the peak is where the cycle begins")
        top = {"pressure": peak}
        with self._labelled(level=_level(top), rate=f"{abs(peak - base) / leg / 100:.6g} mbar/s"):
            for cycle in range(1, step.cycles + 1):
                with self._labelled(cycle=str(cycle) if step.cycles > 1 else ""):
                    self._add(leg, top, self._direction(top))
                    self._add(leg, {"pressure": base}, self._direction({"pressure": base}))

    def _wait(self, step: Wait) -> None:
        if "pressure" not in self.rest and self.now != self.rest:
            raise self._fault("the probe is not at the centre: ramp it back before waiting")
        self._approach(self.rest, step.rate, None)
        self._add(step.duration, self.rest, "rest", step.until)

    def _trajectory(self, step: Trajectory) -> None:
        if "probe_x" not in self.rest:
            raise self._fault(f"the {self.protocol.instrument} has no probe to move: use cycle")
        if self.now != self.rest:
            raise self._fault("a trajectory begins at the centre: ramp the probe back first")
        for direction in step.directions:
            out = _along(direction, step.amplitude)
            turns = [out, self.rest]
            if step.sides == "both":
                turns += [{axis: -value for axis, value in out.items()}, self.rest]
            with self._labelled(direction=_spell(direction), level=f"{step.amplitude * 1e3:.6g} mm"):
                for cycle in range(1, step.cycles + 1):
                    with self._labelled(cycle=str(cycle)):
                        for turn in turns:
                            self._add(step.leg, turn, self._direction(turn))
                if step.rest is not None:
                    self._add(step.rest, self.rest, "rest")

    def _approach(
        self, target: Mapping[str, float], rate: float | None, speed: float | None, until: UntilStep | None = None
    ) -> None:
        """Go to ``target``: at once, or at a rate (Pa/s) or speed (m/s)."""
        asked = rate if "pressure" in self.rest else speed
        if (rate if asked is speed else speed) is not None and asked is None:
            wrong, right = ("rate", "speed") if speed is None else ("speed", "rate")
            raise self._fault(f"the {self.protocol.instrument} has no {wrong}; give a {right}", wrong)
        distance = math.dist([self.now[q] for q in self.rest], [target[q] for q in self.rest])
        if asked is None and distance > 0 and "pressure" not in self.rest:
            raise self._fault("the probe cannot jump: give a speed")
        if distance > 0 or self._open_end:
            self._add(0.0 if asked is None else distance / asked, target, self._direction(target), until)

    def _add(self, duration: float, target: Mapping[str, float], phase: str, until: UntilStep | None = None) -> None:
        if len(self.segments) >= MAX_SEGMENTS:
            raise self._fault(f"repeats make more than {MAX_SEGMENTS} segments")
        self._duration += duration
        if self._duration > MAX_DURATION:
            raise self._fault(f"the protocol takes longer than {MAX_DURATION / 3600:g} h")
        step = ".".join(str(p) for p in self._path if isinstance(p, int))
        early = None
        if until is not None:
            known = CHANNELS[self.protocol.instrument]
            if until.channel not in known:
                message = f"the {self.protocol.instrument} has no channel {until.channel!r}; it has {', '.join(known)}"
                raise self._fault(message, "until")
            comparison = _COMPARISON["above" if until.above is not None else "below"]
            early = Until(until.channel, comparison, until.value)
        labels = {k: v for k, v in self._labels.items() if v}
        self.segments.append(Segment(duration, dict(self.now), dict(target), self._phase or phase, step, labels, early))
        self._open_end = early is not None and dict(self.now) != dict(target)
        self.now = dict(target)

    def _known(self, target: Mapping[str, float] | None) -> Mapping[str, float] | None:
        """``target``, if the instrument has such quantities."""
        if target is not None and set(target) != set(self.rest):
            has = "pressure or suction" if "pressure" in self.rest else "position"
            raise self._fault(f"the {self.protocol.instrument} is commanded by {has}")
        return target

    def _direction(self, target: Mapping[str, float]) -> str:
        """``load`` when going away from rest, else ``unload``."""
        return "load" if _size(target) >= _size(self.now) else "unload"

    @contextmanager
    def _labelled(self, **labels: str) -> Iterator[None]:
        before = self._labels
        self._labels = {**before, **{k: v for k, v in labels.items() if v}}
        try:
            yield
        finally:
            self._labels = before

    def _fault(self, message: str, field: str = "") -> ProtocolError:
        return self.protocol.origin.fault((*self._path, field) if field else self._path, message)


def _size(value: Mapping[str, float]) -> float:
    return math.hypot(*value.values())


def _along(direction: Direction, amplitude: float) -> dict[str, float]:
    """A point at ``amplitude`` m from the centre; cosines of right angles are exactly 0."""
    unit = (
        math.cos(direction.phi) * math.cos(direction.theta),
        math.cos(direction.phi) * math.sin(direction.theta),
        math.sin(direction.phi),
    )
    return {q: amplitude * (round(u, 15) + 0.0) for q, u in zip(("probe_x", "probe_y", "probe_z"), unit, strict=True)}


def _level(target: Mapping[str, float]) -> str:
    """``300 mbar`` (of suction) or ``1.3 mm``."""
    if "pressure" in target:
        return f"{-target['pressure'] / 100 + 0.0:.6g} mbar"
    return f"{_size(target) * 1e3:.6g} mm"


def _spell(direction: Direction) -> str:
    theta, phi = (f"{math.degrees(a):.6g}" for a in (direction.theta, direction.phi))
    return f"theta={theta} phi={phi}"
