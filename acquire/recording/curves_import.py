"""Import of curves that an instrument's own software exported, through a column map.

A column map is a YAML file that names the quantity of each column (schema ``column-map/1``)::

    schema: column-map/1
    instrument: cutometer
    time: {column: 'Time [s]', unit: s}        # or {rate: 100 Hz}
    channels:
      apex_height: {column: 'Curve *', unit: mm}   # '*': one recording per column that fits
      pressure: {column: 'Pressure', unit: mbar, suction: positive}
    protocol: protocol.yaml                    # optional, beside the map
    subject: P07                               # optional, like site, operator, specimen, notes
"""

from __future__ import annotations

import fnmatch
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, model_validator

from acquire.recording.bundle import MAX_PROTOCOL, import_bundle
from acquire.recording.bundle_schema import SCHEMA, Bundle, Run, Source, TimeAxis
from acquire.recording.model import Recording, RecordingError
from acquire.recording.tables import Table
from protocols.errors import ProtocolError
from protocols.fields import Model
from protocols.files import contents, inside, is_file, refusing
from protocols.source import Source as Yaml
from protocols.source import read
from protocols.text import validate

Short = Annotated[str, Field(max_length=400)]


class MappedColumn(Model):
    """One channel: its column (``*`` stands for any text) and unit; exports often give suction as a positive number."""

    column: Short
    unit: Short
    suction: Literal["negative", "positive"] = "negative"


class ColumnMap(Model):
    """The whole map."""

    model_config = ConfigDict(frozen=True, extra="forbid", coerce_numbers_to_str=True)
    version: Literal["column-map/1"] = Field(alias="schema")
    instrument: Short = "cutometer"
    time: TimeAxis
    channels: Annotated[dict[str, MappedColumn], Field(min_length=1)]
    protocol: str | dict[str, Any] | None = None
    subject: Short = ""
    site: Short = ""
    operator: Short = ""
    specimen: Short = "skin"
    specimen_properties: dict[Short, Any] = Field(default={})
    notes: str = ""
    sheet: Short | None = None

    @model_validator(mode="after")
    def _one_pattern(self) -> ColumnMap:
        if sum("*" in channel.column for channel in self.channels.values()) > 1:
            raise ValueError("only one channel's column may have a '*'")
        return self


def read_curves(export: Path | str, column_map: Path | str) -> list[Recording]:
    """The recordings in ``export`` (CSV, TSV or XLSX), one per column that fits the map's ``*``, numbered as repeats.

    Raises RecordingError that names file and line, column or channel.
    """
    export, column_map = Path(export), Path(column_map)
    try:
        data, source = read(column_map, aliases=True)
        mapping = validate(ColumnMap, data, source)
    except ProtocolError as error:
        raise RecordingError(str(error)) from error
    header = Table(export, mapping.sheet).header
    pattern = next((channel.column for channel in mapping.channels.values() if "*" in channel.column), None)
    matches: list[str | None] = [None]
    if pattern is not None:
        matches = [title for title in header if fnmatch.fnmatchcase(title, pattern)]
        if not matches:
            raise RecordingError(f"{export}: no column fits {pattern!r}; there is {', '.join(header)}")
    return [_one(export, mapping, source, match, number) for number, match in enumerate(matches, start=1)]


def _one(export: Path, mapping: ColumnMap, source: Yaml, match: str | None, number: int) -> Recording:
    """The map as a bundle whose data are in ``export``: one way in, one set of checks."""
    channels = {
        name: Source(
            file=export.name,
            column=match if match is not None and "*" in channel.column else channel.column,
            unit=channel.unit,
            suction=channel.suction,
            time=mapping.time,
            sheet=mapping.sheet,
        )
        for name, channel in mapping.channels.items()
    }
    keys = ("instrument", "subject", "site", "operator", "specimen", "specimen_properties", "notes")
    about = {key: getattr(mapping, key) for key in keys}
    bundle = Bundle(
        schema=SCHEMA,
        repeat=number,
        channels=channels,
        protocol=_protocol(Path(source.file), mapping.protocol),
        run=Run(id=f"import-{export.stem}-{number}"),
        **about,
    )
    return import_bundle(bundle, export.parent, source)


def _protocol(column_map: Path, given: str | dict[str, Any] | None) -> str | dict[str, Any] | None:
    """The text of a protocol file beside the map, else the given text: an inline protocol or a library name."""
    if not isinstance(given, str) or "\n" in given:
        return given
    with refusing(column_map, RecordingError, "protocol"):
        path = inside(column_map.parent, given)
    if not is_file(path):
        return given
    with refusing(path, RecordingError, "protocol"):
        return contents(path, MAX_PROTOCOL).decode() + "\n"
