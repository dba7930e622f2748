"""Qualifications of instruments (schema ``qualification/1``): what a file holds, where they are kept, which one counts.

A file is written by ``acquire qualify`` and read by a diagnosis and by whoever starts a run.
"""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from platformdirs import user_data_dir
from pydantic import Field, field_validator, model_validator

from acquire.files import write_text
from acquire.recording.model import RecordingError, RunInfo
from protocols.errors import ProtocolError
from protocols.fields import Model
from protocols.source import read, written
from protocols.text import validate

SCHEMA: Final = "qualification/1"
VALID_DAYS = 180
"""How long a qualification holds (assumed: half a year, as for a balance in daily use)."""
SERIAL = "serial_number"
"""Name of the calibration entry of a recording that tells the instrument's serial number."""
ROUNDING = 1e-3
"""By how much correlations may differ from those of a covariance, whose numbers are rounded to five digits."""

Finite = Annotated[float, Field(allow_inf_nan=False)]
LONGEST = 3650
"""Days for which a qualification may hold."""
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]


def _finite(entries: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """The same. Raises ValueError that names a number in it that is none, or a standard deviation below 0."""
    for name, entry in entries.items():
        for key, value in entry.items():
            if isinstance(value, float) and not math.isfinite(value):
                raise ValueError(f"{name}.{key}: must be a finite number, not {value}")
            if key in ("se", "sd") and not (isinstance(value, int | float) and value >= 0):
                raise ValueError(f"{name}.{key}: must be a number from 0 on, not {value!r}")
    return entries


class Parameter(Model):
    """One number of the instrument (SI): ``value`` and standard error, and how far from ``nominal`` it may be.

    ``like`` names the effect that moves it so, where nothing tells the two apart.
    """

    value: Finite
    se: Positive
    unit: str
    nominal: Finite = 0.0
    tolerance: NotNegative | None = None
    passed: bool | None = None
    like: str = ""


class Bound(Model):
    """The strength (SI) of an effect that would have been seen, in its ``parameter``."""

    parameter: str
    value: NotNegative
    unit: str


class Finding(Model):
    """An effect that the references show: its ``effect`` and the class of those they cannot tell from it."""

    effect: str
    indistinguishable: tuple[str, ...] = Field(default=(), alias="class")
    probability: Probability
    parameters: dict[str, dict[str, Any]] = Field(default={})
    meaning: str = ""
    remedy: str = ""

    _numbers = field_validator("parameters")(_finite)


class Covariance(Model):
    """Covariance of parameters, in the order of ``names``."""

    names: tuple[str, ...]
    matrix: tuple[tuple[Finite, ...], ...]

    @model_validator(mode="after")
    def _possible(self) -> Covariance:
        n = len(self.names)
        if len(self.matrix) != n or any(len(row) != n for row in self.matrix):
            raise ValueError(f"matrix: must have {n} rows of {n} numbers, one for each of the names")
        for k, name in enumerate(self.names):
            if self.matrix[k][k] <= 0:
                raise ValueError(f"matrix: the variance of {name} must be positive, not {self.matrix[k][k]:g}")
        whole = np.array(self.matrix)
        sd = np.sqrt(np.diag(whole))
        correlation = whole / np.outer(sd, sd)
        if off := np.argwhere(np.abs(correlation - correlation.T) > ROUNDING).tolist():
            one, other = (self.names[k] for k in off[0])
            raise ValueError(f"matrix: is not symmetric in {one} and {other}")
        if n and float(np.linalg.eigvalsh(correlation)[0]) < -ROUNDING * n:
            raise ValueError("matrix: is no covariance: a combination of the parameters has a negative variance")
        return self


class Qualification(Model):
    """The whole of a file."""

    version: Literal["qualification/1"] = Field(alias="schema")
    instrument: str
    device: str = ""
    serial: str = ""
    date: datetime
    valid_days: Annotated[float, Field(gt=0, le=LONGEST, allow_inf_nan=False)] = VALID_DAYS
    passed: bool
    verdict: str
    sentences: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    doubts: tuple[str, ...] = ()
    parameters: dict[str, Parameter] = Field(default={})
    covariance: Covariance | None = None
    effects: dict[str, Bound] = Field(default={})
    noise: dict[str, dict[str, Any]] = Field(default={})
    checked: tuple[str, ...] = ()
    not_checked: tuple[str, ...] = ()
    recordings: tuple[str, ...] = ()
    minutes: NotNegative = 0.0
    software: dict[str, str] = Field(default={})

    _numbers = field_validator("noise")(_finite)

    @model_validator(mode="after")
    def _dated(self) -> Qualification:
        if self.date.tzinfo is None:
            raise ValueError("date: a time zone is missing, such as +00:00")
        return self

    @property
    def expires(self) -> datetime:
        """When it holds no longer."""
        return self.date + timedelta(days=self.valid_days)

    def validity(self, now: datetime | None = None) -> str:
        """Until when it holds, in words; '' of an instrument that did not pass."""
        if not self.passed:
            return ""
        over = (now or datetime.now(UTC)) > self.expires
        return f"{'expired on' if over else 'valid until'} {self.expires:%Y-%m-%d}"

    def against(self, instrument: str, serial: str = "", now: datetime | None = None) -> str:
        """Why it is not to be believed of an instrument; '' where it is."""
        if instrument != self.instrument:
            return f"it is of a {self.instrument}, not of a {instrument}"
        if serial and self.serial and serial != self.serial:
            return f"it is of serial number {self.serial}, not of {serial}"
        if self.doubts:
            return f"its references are in doubt: {self.doubts[0]}"
        if (now or datetime.now(UTC)) > self.expires:
            return f"it expired on {self.expires:%Y-%m-%d}"
        return ""


def serial_of(info: RunInfo) -> str:
    """The serial number of the instrument that made a recording; '' where it does not tell."""
    return str(info.calibration[SERIAL]["value"]) if SERIAL in info.calibration else ""


def day_of(info: RunInfo) -> datetime | None:
    """When a recording began; None where it does not tell, with a time zone."""
    try:
        day = datetime.fromisoformat(info.start_time)
    except ValueError:
        return None
    return day if day.tzinfo else None


def load_qualification(path: Path | str) -> Qualification:
    """The qualification in a file. Raises RecordingError that names file and line, OSError."""
    path = Path(path)
    try:
        data, source = read(path)
        return validate(Qualification, data, source)
    except ProtocolError as error:
        raise RecordingError(str(error)) from error


def dump(qualification: Qualification) -> str:
    """The file's text."""
    plain = qualification.model_dump(mode="json", by_alias=True, exclude_none=True)
    return written(plain)


def folder_of(instrument: str, serial: str, root: Path | None = None) -> Path:
    """Where the history of an instrument is kept: a folder of the user's, or one in ``root``."""
    name = re.sub(r"[^A-Za-z0-9_.-]+", "-", f"{instrument}-{serial or 'unknown'}")
    return (root or Path(user_data_dir("skinrig")) / "qualifications") / name


def keep(qualification: Qualification, root: Path | None = None) -> Path:
    """Add a qualification to its instrument's history."""
    folder = folder_of(qualification.instrument, qualification.serial, root)
    return write_text(folder / f"{qualification.date:%Y%m%dT%H%M%S}.yaml", dump(qualification))


def history(instrument: str, serial: str, root: Path | None = None) -> list[Qualification]:
    """Qualifications of an instrument, oldest first; a file that does not read as one is left out."""
    found = []
    for path in sorted(folder_of(instrument, serial, root).glob("*.yaml")):
        try:
            found.append(load_qualification(path))
        except (RecordingError, OSError):
            continue
    return sorted(found, key=lambda q: q.date)


def due(instrument: str, serial: str, root: Path | None = None, now: datetime | None = None) -> str:
    """A warning for who starts a run: the newest qualification does not hold. '' where it does, or never was one."""
    known = history(instrument, serial, root)
    if not known:
        return ""
    newest = known[-1]
    why = newest.against(instrument, serial, now) or ("" if newest.passed else "it was not passed")
    return f"the last qualification of {instrument} {serial} does not hold: {why}; see acquire qualify" if why else ""
