"""The contents of ``recording.yaml`` of a bundle (schema ``recording-bundle/1``).

Beyond the contract of docs/architecture.md a channel may name its stage, range, resolution and sample counter, a time
axis may be a ``rate`` instead of a column, and ``run`` carries the rest of a run's identity, so that an exported
recording comes back whole.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, model_validator

from protocols.fields import Frequency, Model, Unit
from protocols.specimens import SPECIMENS
from protocols.units import split

SCHEMA: Final = "recording-bundle/1"
SUCTION = ("cutometer", "aspiration")
ScaleValue = Annotated[float, Unit("scale", "positive")]
Duration = Annotated[float, Unit("time")]
Short = Annotated[str, Field(max_length=400)]


#: A number is written as one: in quotes it is a text, and Python would read '-3_0' as -30.
Number = Annotated[float, Field(strict=True)]
Whole = Annotated[int, Field(strict=True, ge=0, lt=2**31)]


def _check_name(name: str) -> str:
    if "/" in name or name in ("", ".", ".."):
        raise ValueError(f"{name!r} cannot be the name of a channel: it needs letters, and no '/'")
    return name


Name = Annotated[Short, AfterValidator(_check_name)]


def _quantity(given: Any) -> Any:
    """``4 mm`` as ``{value: 4.0, unit: mm}``; what has no unit is a value."""
    if not isinstance(given, str | int | float):
        return given
    try:
        return dict(zip(("value", "unit"), split(str(given)), strict=True))
    except ValueError:
        return {"value": given}


def _joined(given: Any) -> Any:
    """A time whose zone stands apart, as many loggers print it, in one word: ``2026-04-02 09:10:00 +02:00``."""
    return re.sub(r"(?<=\d)\s+(?=(Z|[-+]\d\d(:?\d\d)?)$)", "", given.strip()) if isinstance(given, str) else given


def _specimen(given: Any) -> Any:
    """The name of a reference specimen without its capitals."""
    return given.lower() if isinstance(given, str) and given.lower() in SPECIMENS else given


class _Loose(Model):
    """Numbers are taken as text where text is meant: ``subject: 7``, ``column: 1``."""

    model_config = ConfigDict(frozen=True, extra="forbid", coerce_numbers_to_str=True)


class TimeAxis(_Loose):
    """A time column (of the channel's file), or samples evenly at ``rate`` from ``start`` on."""

    column: Short | None = None
    unit: Short = "s"
    rate: Frequency | None = None
    start: Duration = 0.0

    @model_validator(mode="after")
    def _one_of_two(self) -> TimeAxis:
        if (self.column is None) == (self.rate is None):
            raise ValueError("time needs either a column or a rate")
        return self


class Quantity(_Loose):
    """A quantity of a channel as the laboratory knows it: its noise, or its resolution."""

    value: Annotated[Number, Field(gt=0)]
    unit: Short


class Source(_Loose):
    """Where one channel or set-point is: file, column, unit, and its time."""

    file: Short
    column: Short
    unit: Short
    suction: Literal["negative", "positive"] = Field(default="negative", description="its sign in a column of pressure")
    time: TimeAxis
    width: Annotated[Whole, Field(ge=1, le=10_000)] | None = Field(
        default=None, description="a profile: the columns are <column>_0, <column>_1 …"
    )
    allow_nan: bool = Field(default=False, description="nan and empty cells are samples without a value, not a fault")
    sheet: Short | None = None
    stage: Short | None = None
    range: tuple[Number, Number] | None = Field(default=None, description="in SI")
    resolution: Number | Quantity | None = Field(default=None, description="a number is in SI")
    noise: Quantity | None = Field(default=None, description="else a diagnosis reads it from the samples")
    seq: Short | None = Field(default=None, description="column of the device's sample counter")
    time_host: Short | None = Field(default=None, description="column of the host's clock, in s")


class Images(_Loose):
    """Camera images: a pattern of PNG or TIFF files in their natural order, or one AVI or MP4 file.

    Their times: ``rate`` from ``start`` on (default: where the channels begin), or a ``time`` column of ``time_file``.
    ``gvt`` is the grey-value threshold set by eye (0..255), ``delta`` its uncertainty, ``apex`` where the dome points.
    ``tissue`` is darker or brighter than the background.
    Without a ``scale`` the images are kept, but no height is measured in them.
    """

    files: Short
    scale: ScaleValue | None = None
    rate: Frequency | None = None
    start: Duration | None = None
    time_file: Short | None = None
    time: TimeAxis | None = None
    seq: Short | None = Field(default=None, description="column of time_file with the camera's frame counter")
    gvt: Annotated[Number, Field(ge=0, le=255)] | None = None
    delta: Annotated[Number, Field(gt=0, le=100)] | None = None
    apex: Literal["up", "down"] = "up"
    tissue: Literal["dark", "bright"] = "dark"

    @model_validator(mode="after")
    def _one_clock(self) -> Images:
        if (self.rate is None) == (self.time_file is None):
            raise ValueError("frames need either a rate or a time_file")
        if (self.time_file is None) != (self.time is None):
            raise ValueError("time_file and time belong together")
        return self


class Run(_Loose):
    """The rest of a run's identity, as `acquire export` writes it."""

    id: Short | None = None
    status: Short | None = None
    trip_reason: str = ""
    start_time: Annotated[Short, BeforeValidator(_joined)] = ""
    end_time: Annotated[Short, BeforeValidator(_joined)] = ""
    protocol_name: Short | None = None
    versions: dict[Name, str] = Field(default={})
    limits: dict[Name, tuple[Number, Number]] = Field(default={})
    calibration: dict[Name, Annotated[dict[str, Any], BeforeValidator(_quantity)]] = Field(default={})
    station: str = ""
    device: Short = ""
    consent: Short = ""
    plot: Short = ""


class EventRow(_Loose):
    """One event."""

    time: Number
    level: Literal["info", "warning", "error", "trip"]
    code: Short
    text: str
    count: Annotated[int, Field(ge=0)] = 0


class Bundle(_Loose):
    """The whole of ``recording.yaml``."""

    version: Literal["recording-bundle/1"] = Field(alias="schema")
    instrument: Annotated[str, Field(min_length=1, max_length=80)]
    protocol: str | dict[str, Any] | None = None
    subject: Short = ""
    site: Short = ""
    repeat: Whole = 1
    specimen: Annotated[Short, BeforeValidator(_specimen)] = "skin"
    specimen_properties: dict[Name, Any] = Field(default={}, description="read by `protocols.specimens.stated`")
    experiment: Short = Field(default="", description="id of the experiment (gap-experiment/1) that this answers")
    operator: Short = ""
    notes: str = ""
    channels: dict[Name, Source] = Field(default={})
    setpoints: dict[Name, Source] = Field(default={})
    segments: Short | None = Field(default=None, description="table of the segments of the set-points")
    derived: dict[Name, Source] = Field(default={})
    frames: Images | None = None
    events: tuple[EventRow, ...] = ()
    run: Run = Run()

    @property
    def exported(self) -> bool:
        """Whether `acquire export` wrote it, which names all of these: it comes back whole, whatever it holds."""
        return None not in (self.run.id, self.run.status, self.run.protocol_name)

    @model_validator(mode="after")
    def _something_measured(self) -> Bundle:
        if not self.channels and self.frames is None:
            raise ValueError("a recording needs channels or frames")
        return self
