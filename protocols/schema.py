"""The schema of protocols, ``protocol/1``: the allowed contents of a YAML file.

A `Protocol` is a frozen value, equal to another that says the same; `protocols.load` reads one, `protocols.dump` writes
one, `protocols.compile_protocol` turns one into timed set-points. Every value carries a unit; unknown keys are faults.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, PrivateAttr, field_validator, model_validator

from protocols.fields import Bore, Force, Frequency, Model, Text
from protocols.limits import Limits
from protocols.source import Source
from protocols.steps import AnyStep

SCHEMA = "protocol/1"
Instrument = Literal["cutometer", "aspiration", "microrobot"]
#: Commanded quantities of each instrument.
QUANTITIES: dict[str, tuple[str, ...]] = {
    "cutometer": ("pressure",),
    "aspiration": ("pressure",),
    "microrobot": ("probe_x", "probe_y", "probe_z"),
}
#: Measured quantities of each instrument, for ``until`` (a camera's frames and profiles are no single number).
CHANNELS: dict[str, tuple[str, ...]] = {
    "cutometer": ("pressure", "apex_height"),
    "aspiration": ("pressure", "apex_height"),
    "microrobot": tuple(
        f"{name}_{part}"
        for name, parts in (("axis_position", "123"), ("transducer_force", "abc"), ("probe", "xyz"), ("force", "xyz"))
        for part in parts
    ),
}


NAMED = "letters (a to z, A to Z), digits, '.', '_' and '-', and begins with a letter or digit"
"""The characters of a protocol's name: files are called by it."""


class Setup(Model):
    """How the instrument is set up for this protocol, where that is not the station's choice."""

    opening: Bore | None = Field(default=None, description="diameter of the probe's opening (suction)")
    sampling: Frequency | None = Field(default=None, description="samples per second, as the instrument is set up")
    frame_rate: Frequency | None = Field(
        default=None, description="camera frames per second, as the instrument is set up (aspiration)"
    )
    frames: Literal["region", "full"] | None = Field(
        default=None,
        description="how much of each camera frame is recorded: the region of the edge, or all (aspiration)",
    )
    contact_force: Force | None = Field(default=None, description="force of the probe on the skin (suction)")
    hole_radius: Bore | None = Field(default=None, description="radius of the support plate's hole (microrobot)")


class Limit(Model):
    """Lowest and highest value, largest rate and longest dwell away from rest of one quantity, as text with units."""

    low: Text | None = None
    high: Text | None = None
    rate: Text | None = None
    dwell: Text | None = None


class Protocol(Model):
    """One measurement, wholly described: instrument, its setup, limits and steps."""

    version: Literal["protocol/1"] = Field(alias="schema")
    name: Annotated[str, Field(strict=True, pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=80)]
    title: Annotated[str, Field(strict=True, max_length=160)] = ""
    description: Text = ""
    source: Text = Field(default="", description="where the protocol is known from")
    instrument: Instrument
    setup: Setup = Setup()
    limits: dict[str, Limit] = Field(default={}, description="limits of this protocol, beside the station's")
    steps: Annotated[tuple[AnyStep, ...], Field(min_length=1, max_length=1000)]
    _read: Source = PrivateAttr(default_factory=Source)

    @property
    def origin(self) -> Source:
        """The text this was read from and the lines of its parts; empty for a protocol made in Python."""
        return self._read

    @property
    def quantities(self) -> tuple[str, ...]:
        """The commanded quantities."""
        return QUANTITIES[self.instrument]

    @property
    def own_limits(self) -> Limits:
        """The limits that the protocol sets itself."""
        return _limits(self.limits)

    @field_validator("limits")
    @classmethod
    def _check_limits(cls, limits: dict[str, Limit]) -> dict[str, Limit]:
        _limits(limits)
        return limits

    @model_validator(mode="after")
    def _check_setup(self) -> Protocol:
        foreign: tuple[str, ...] = ("hole_radius",) if "pressure" in self.quantities else ("opening", "contact_force")
        if self.instrument != "aspiration":
            foreign += ("frame_rate", "frames")
        for name in foreign:
            if getattr(self.setup, name) is not None:
                raise ValueError(f"setup.{name}: the {self.instrument} has none")
        return self


def _limits(written: dict[str, Limit]) -> Limits:
    return Limits.parse({k: v.model_dump(exclude_none=True) for k, v in written.items()}, "protocol")
