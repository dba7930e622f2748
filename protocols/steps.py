"""The steps a protocol is made of: hold, ramp, cycle, wait, trajectory, and groups of them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Literal

from pydantic import Field, model_validator

from protocols import units
from protocols.fields import (
    Angle,
    Count,
    Duration,
    Frequency,
    Length,
    Model,
    Pressure,
    PressureRate,
    Size,
    Speed,
    Suction,
    Text,
)


class Until(Model):
    """End the step early, as soon as a measured channel is above or below a value."""

    channel: Annotated[str, Field(strict=True)]
    above: Text | None = None
    below: Text | None = None

    @property
    def value(self) -> float:
        """The threshold in SI."""
        return units.parse(self.above if self.above is not None else self.below, units.kind_of(self.channel))

    @model_validator(mode="after")
    def _check(self) -> Until:
        _exactly_one(self, ("above", "below"))
        _ = self.value
        return self


class Position(Model):
    """A place of the probe's tip, from the centre pose; z from the platform towards the tip."""

    x: Length = 0.0
    y: Length = 0.0
    z: Length = 0.0


class Step(Model):
    """Fields of all steps. ``phase`` overrides the one found by the compiler."""

    repeat: Count = 1
    phase: Literal["load", "hold", "unload", "rest"] | None = None


class Target(Step):
    """A step that goes somewhere: ``suction`` 300 mbar is ``pressure`` -300 mbar; ``position`` is the robot's."""

    pressure: Pressure | None = None
    suction: Suction | None = None
    position: Position | None = None

    @property
    def target(self) -> dict[str, float] | None:
        """Value of each commanded quantity (SI), or None for where it is."""
        if self.position is not None:
            return {"probe_x": self.position.x, "probe_y": self.position.y, "probe_z": self.position.z}
        if self.suction is not None:
            return {"pressure": -self.suction}
        return None if self.pressure is None else {"pressure": self.pressure}


class Hold(Target):
    """Stay at a value: reached at once, or at ``rate`` (pressure) or ``speed`` (position). Without a value: stay."""

    type: Literal["hold"]
    duration: Duration
    rate: PressureRate | None = None
    speed: Speed | None = None
    until: Until | None = None

    @model_validator(mode="after")
    def _check(self) -> Hold:
        given = [n for n in ("pressure", "suction", "position") if getattr(self, n) is not None]
        if len(given) > 1:
            raise ValueError(f"give one of pressure, suction, position, not {' and '.join(given)}")
        if not given and (self.rate is not None or self.speed is not None):
            raise ValueError("a hold that goes nowhere has no rate or speed")
        return self


class Ramp(Target):
    """Go straight from where it is to a value, in a ``duration`` or at a ``rate`` or ``speed``."""

    type: Literal["ramp"]
    duration: Duration | None = None
    rate: PressureRate | None = None
    speed: Speed | None = None
    until: Until | None = None

    @model_validator(mode="after")
    def _check(self) -> Ramp:
        _exactly_one(self, ("pressure", "suction", "position"))
        _exactly_one(self, ("duration", "rate", "speed"))
        return self


class Cycle(Step):
    """Triangles of pressure, from where it is to a peak and back at the same rate.

    Two of three: the peak (``suction`` or ``pressure``), the ``rate``, and a time (``t_lin`` or ``frequency``).
    Weickenmeier et al. do not say whether t_lin is one leg or the whole triangle: ``t_lin_spans`` does.
    """

    type: Literal["cycle"]
    suction: Suction | None = None
    pressure: Pressure | None = None
    rate: PressureRate | None = None
    t_lin: Duration | None = None
    t_lin_spans: Literal["leg", "triangle"] = "leg"
    frequency: Frequency | None = None
    cycles: Count = 1

    @property
    def leg(self) -> float | None:
        """Duration of one leg in s, where a time is given."""
        if self.t_lin is not None:
            return self.t_lin if self.t_lin_spans == "leg" else self.t_lin / 2
        return None if self.frequency is None else 1 / (2 * self.frequency)

    @property
    def peak(self) -> float | None:
        """Gauge pressure of the peak in Pa, where it is given."""
        return -self.suction if self.suction is not None else self.pressure

    @model_validator(mode="after")
    def _check(self) -> Cycle:
        if self.suction is not None and self.pressure is not None:
            raise ValueError("give one of suction, pressure")
        if self.t_lin is not None and self.frequency is not None:
            raise ValueError("give one of t_lin, frequency")
        if [self.peak, self.rate, self.leg].count(None) != 1:
            raise ValueError("give two of three: a peak (suction or pressure), a rate, a time (t_lin or frequency)")
        return self


class Wait(Step):
    """Vented (suction) or at the centre (robot): release at once, or at ``rate``, and wait."""

    type: Literal["wait"]
    duration: Duration
    rate: PressureRate | None = None
    until: Until | None = None


class Direction(Model):
    """A direction of the probe: (cos phi cos theta, cos phi sin theta, sin phi); phi = 90 deg is the normal, +z."""

    theta: Angle = 0.0
    phi: Angle = 0.0


class Trajectory(Step):
    """The robot's triangular cycles along directions, one after the other, each from the centre and back to it.

    ``sides: one`` goes from the centre to the amplitude and back, ``both`` also to the other side. ``frequency`` is
    that of whole cycles; with ``speed`` instead the tip moves at it. ``rest`` is a time at the centre after each
    direction.
    """

    type: Literal["trajectory"]
    directions: Annotated[tuple[Direction, ...], Field(min_length=1, max_length=360)]
    amplitude: Size
    frequency: Frequency | None = None
    speed: Speed | None = None
    cycles: Count = 1
    sides: Literal["one", "both"] = "one"
    rest: Duration | None = None

    @property
    def leg(self) -> float:
        """Time from the centre to the amplitude in s."""
        if self.speed is not None:
            return self.amplitude / self.speed
        assert self.frequency is not None
        return 1 / ((2 if self.sides == "one" else 4) * self.frequency)

    @model_validator(mode="after")
    def _check(self) -> Trajectory:
        _exactly_one(self, ("frequency", "speed"))
        return self


class Group(Step):
    """Steps done together, ``repeat`` times; ``counts_as`` is the label under which an analysis finds the count."""

    type: Literal["group"]
    steps: Annotated[tuple[AnyStep, ...], Field(min_length=1, max_length=1000)]
    counts_as: Literal["repeat", "cycle"] = "repeat"


AnyStep = Annotated[Hold | Ramp | Cycle | Wait | Trajectory | Group, Field(discriminator="type")]
Group.model_rebuild()
STEPS: dict[str, type[Step]] = {
    "hold": Hold,
    "ramp": Ramp,
    "cycle": Cycle,
    "wait": Wait,
    "trajectory": Trajectory,
    "group": Group,
}


def _exactly_one(model: Model, names: Iterable[str]) -> None:
    names = tuple(names)
    given = [n for n in names if getattr(model, n) is not None]
    if len(given) != 1:
        raise ValueError(f"give exactly one of {', '.join(names)}" + (f", not {' and '.join(given)}" if given else ""))
