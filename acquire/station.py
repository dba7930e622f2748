"""Station files: which instruments a bench has, where their links are, their limits and calibrations.

::

    schema: station/1
    name: bench by the window
    instruments:
      cutometer:
        address: /dev/ttyUSB0
        i_have_verified_the_codec: true
        limits: {pressure: {low: -450 mbar, high: 0 mbar}}
      aspiration:
        simulated: {tissue: cheek}
        calibration:
          frame_scale: {value: 0.02 mm/px, provenance: assumed}
        frames: full                            # every pixel of every camera frame, not the edge's region alone
    subjects:
      P07: {pressure: {low: -300 mbar, high: 0 mbar}}
    notify:                                     # used only with --notify station
      - {on: [trip, stall], command: [notify-send, skinrig]}
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PrivateAttr, ValidationInfo, field_validator, model_validator

from acquire.engine.rules import BOUNDS, LONGEST_TRACKING, Rules, check_tracking
from acquire.engine.rules import Tracking as TrackingRule
from acquire.notify import Hook
from drivers.instrument import WATCHDOG, WATCHDOG_BOUNDS, Entry
from drivers.transports import host_of, is_loopback, kind_of
from protocols import units
from protocols.fields import Model, Text, Unit
from protocols.limits import Limits
from protocols.schema import Limit
from protocols.source import Source, read, written
from protocols.text import validate

Provenance = Literal["documented", "reported", "assumed", "measured"]
#: Of a camera that nobody calibrated.
FRAME_SCALE = "0.02 mm/px"
#: Of a simulated instrument, as `Rules.lag`.
SIMULATED_LAG = 0.9
#: Entries of a calibration, and the kind of quantity of each.
CALIBRATIONS = {"frame_scale": "scale", "opening": "length", "contact_force": "force", "hole_radius": "length"}


def _within(rule: str) -> Any:
    least, most = BOUNDS[rule]
    return Field(strict=True, ge=least, le=most)


class Tracking(Model):
    """Largest deviation from the set-point, as text with a unit, and for how long."""

    error: Text
    duration: Annotated[float, Unit("time", "positive", most=LONGEST_TRACKING)]

    def rule(self, quantity: str) -> TrackingRule:
        """The same in SI. Raises ValueError for a unit of another kind."""
        return TrackingRule(units.parse(self.error, units.kind_of(quantity)), self.duration)


class Interlock(Model):
    """Changes to `acquire.engine.Rules`, within their bounds; ``disk`` is in bytes."""

    margin: Annotated[float, _within("margin")] | None = None
    rate_margin: Annotated[float, _within("rate_margin")] | None = None
    rate_window: Annotated[float, Unit("time", "positive", *BOUNDS["rate_window"])] | None = None
    stale: Annotated[float, Unit("time", "positive", *BOUNDS["stale"])] | None = None
    lag: Annotated[float, _within("lag")] | None = None
    disk: Annotated[int, _within("disk")] | None = None
    tracking: dict[str, Tracking] = Field(default={})
    agreement: dict[str, Tracking] = Field(default={}, description="of a second gauge with the first")
    plausible: Annotated[bool, Field(strict=True)] | None = None

    @field_validator("tracking", "agreement")
    @classmethod
    def _check(cls, tracking: dict[str, Tracking]) -> dict[str, Tracking]:
        for quantity, rule in tracking.items():
            check_tracking(quantity, rule.rule(quantity))
        return tracking

    def rules(self) -> Rules:
        """The rules, with everything that is not said here at its default."""
        said = {name: value for name, value in self if name in Rules.__dataclass_fields__ and value is not None}
        for name in ("tracking", "agreement"):
            said[name] = {**getattr(Rules(), name), **{q: t.rule(q) for q, t in said[name].items()}}
        return Rules(**said)


class Calibration(Model):
    """One number that readings depend on, with its unit, and how well it is known."""

    value: Text
    provenance: Provenance
    note: Text = ""


class Simulation(Model):
    """A simulated instrument instead of a real one."""

    tissue: Text = "forearm"
    effects: tuple[Text, ...] = ()
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] | None = None
    link: Literal["pty", "tcp", "usb", "auto"] = "auto"


class Instrument(Model):
    """One instrument: at an ``address``, or ``simulated`` in this process.

    With both, the address is that of a simulated instrument served elsewhere (``acquire sim``): ``simulated: true``.
    """

    instrument: Text = Field(default="", description="kind of instrument; the entry's name by default")
    host: Text = Field(default="", description="of socket:// links that leave this computer, said once more")
    address: Text = ""
    sources: dict[str, Text] = Field(default={})
    simulated: Simulation | None = None
    i_have_verified_the_codec: bool = False
    options: dict[str, Any] = Field(default={})
    watchdog: Annotated[float, Unit("time", "positive", *WATCHDOG_BOUNDS)] = WATCHDOG
    limits: dict[str, Limit] = Field(default={})
    interlock: Interlock = Interlock()
    calibration: dict[str, Calibration] = Field(default={})
    frames: Literal["region", "full"] = Field(default="region", description="how much of each camera frame is recorded")

    @model_validator(mode="after")
    def _check(self) -> Instrument:
        if not self.address and self.simulated is None:
            raise ValueError("an instrument needs an address, or 'simulated: true'")
        if self.address and self.simulated not in (None, Simulation()):
            raise ValueError("an instrument at an address is simulated elsewhere: write 'simulated: true' and no more")
        return self

    @field_validator("address", "sources")
    @classmethod
    def _check_addresses(cls, said: Any, info: ValidationInfo) -> Any:
        """Plain device paths, USB ids, and TCP to this computer or to the ``host`` that the entry states."""
        for address in said.values() if isinstance(said, dict) else (said,):
            if not address or re.fullmatch(r"uvc:\d{1,2}", address):
                continue
            host = host_of(address)[0] if kind_of(address) == "socket" else "localhost"
            if not is_loopback(host) and host != info.data.get("host"):
                raise ValueError(
                    f"{address} leaves this computer, unencrypted and unauthenticated; if that is meant, say "
                    f"'host: {host}' too"
                )
        return said

    @field_validator("simulated", mode="before")
    @classmethod
    def _check_simulated(cls, simulated: object) -> object:
        return {True: {}, False: None}[simulated] if isinstance(simulated, bool) else simulated

    @property
    def here(self) -> bool:
        """Whether it is to be simulated in this process."""
        return self.simulated is not None and not self.address

    @field_validator("limits")
    @classmethod
    def _check_limits(cls, limits: dict[str, Limit]) -> dict[str, Limit]:
        parse_limits(limits, "station")
        return limits

    @field_validator("calibration")
    @classmethod
    def _check_calibration(cls, calibration: dict[str, Calibration]) -> dict[str, Calibration]:
        for name, entry in calibration.items():
            if name not in CALIBRATIONS:
                raise ValueError(f"unknown calibration {name!r}; there is {', '.join(CALIBRATIONS)}")
            units.parse(entry.value, CALIBRATIONS[name])
        return calibration

    @property
    def station_limits(self) -> Limits:
        """The bench's own limits of this instrument."""
        return parse_limits(self.limits, "station")

    def calibrated(self, name: str) -> float:
        """A calibration in SI; 0 where the station has none."""
        return units.parse(self.calibration[name].value, CALIBRATIONS[name]) if name in self.calibration else 0.0

    @property
    def rules(self) -> Rules:
        """The interlock's rules. A simulated instrument's time may stand still while its host is busy."""
        rules = self.interlock.rules()
        return replace(rules, lag=SIMULATED_LAG) if self.simulated is not None else rules

    @property
    def driver_options(self) -> dict[str, Any]:
        """The driver's options, with the calibrations that it needs to make readings of pictures."""
        scale = self.calibration.get("frame_scale")
        return {**self.options, "frame_scale": scale.value} if scale else dict(self.options)

    def entry(self, kind: str) -> Entry:
        """The arguments for the driver of an instrument at an address."""
        return Entry(
            instrument=kind,
            address=self.address,
            simulated=self.simulated is not None,
            i_have_verified_the_codec=self.i_have_verified_the_codec,
            sources=self.sources,
            options=self.driver_options,
            watchdog=self.watchdog,
        )


class Station(Model):
    """A bench: its instruments by name, and limits of its subjects by pseudonym."""

    version: Literal["station/1"] = Field(alias="schema")
    name: Text = ""
    instruments: Annotated[dict[str, Instrument], Field(min_length=1)]
    subjects: dict[str, dict[str, Limit]] = Field(default={})
    notify: tuple[Hook, ...] = ()
    _read: Source = PrivateAttr(default_factory=Source)

    @field_validator("subjects")
    @classmethod
    def _check_subjects(cls, subjects: dict[str, dict[str, Limit]]) -> dict[str, dict[str, Limit]]:
        for name, limits in subjects.items():
            parse_limits(limits, f"subject {name}")
        return subjects

    def subject_limits(self, subject: str) -> Limits:
        """The limits set for a subject; none for one that is not listed."""
        return parse_limits(self.subjects.get(subject, {}), f"subject {subject}")

    def find(self, kind: str) -> str:
        """Name of the first instrument of a kind. Raises ValueError that lists the station's instruments."""
        for name, instrument in self.instruments.items():
            if (instrument.instrument or name) == kind:
                return name
        where = f"{self._read.file or 'station'}: {self.name or 'the station'}"
        raise ValueError(f"{where} has no {kind}; it has {', '.join(self.instruments)}")

    def text(self) -> str:
        """The station as YAML, for the recording."""
        data = self.model_dump(mode="json", by_alias=True, exclude_defaults=True)
        return written(data)


def parse_limits(written: dict[str, Limit], origin: str) -> Limits:
    """Limits as written, in SI. Raises ValueError that names quantity and entry."""
    return Limits.parse({k: v.model_dump(exclude_none=True) for k, v in written.items()}, origin)


def load_station(path: Path | str) -> Station:
    """Read a station file. Raises ProtocolError (a ValueError) with file, line and field of every fault."""
    data, source = read(path)
    station = validate(Station, data, source)
    station._read = source
    return station


def simulated_station(tissue: str = "forearm", effects: tuple[str, ...] = (), seed: int | None = None) -> Station:
    """The default bench: one simulated instrument of each kind.

    It must run on a computer that is busy with other things (continuous integration), so its watchdog and its patience
    with a silent link are longer than a bench with people on it should have.
    """
    simulated = {
        "simulated": {"tissue": tissue, "effects": effects, "seed": seed},
        "watchdog": "1 s",
        "interlock": {"stale": "5 s"},
    }
    return Station.model_validate(
        {
            "schema": "station/1",
            "name": "simulated bench",
            "instruments": {kind: simulated for kind in ("cutometer", "aspiration", "microrobot")},
        }
    )
