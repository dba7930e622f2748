"""Bundles: a folder with ``recording.yaml`` and tables or images, for a lab without a driver link.

A bundle becomes a recording like any other. Whatever is wrong with it is told with the file and the line, column or
channel, and nothing is imported then.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from acquire.recording.bundle_doubts import doubts
from acquire.recording.bundle_schema import SUCTION, Bundle, Images, Quantity, Source, TimeAxis
from acquire.recording.images import find_frames
from acquire.recording.model import Event, FloatArray, Frames, Recording, RecordingError, RunInfo, SegmentRecord, Series
from acquire.recording.possible import impossible
from acquire.recording.segments import of_setpoints
from acquire.recording.segments import read_csv as read_segments
from acquire.recording.tables import Table, evenly
from protocols import specimens, units
from protocols.errors import ProtocolError
from protocols.files import contents, in_words, inside, is_file
from protocols.source import Key, read, written
from protocols.source import Source as Yaml
from protocols.specimens import Stated
from protocols.text import validate

OURS = (*SUCTION, "microrobot")
FILE_NAME = "recording.yaml"
MAX_PROTOCOL = 2**20  # bytes
_NAMES_A_FILE = re.compile(r"^[^,;]*\.[A-Za-z][A-Za-z0-9]{0,4}$")  # by its suffix; 'rest of 0.5 s' has none
_OURS = re.compile(r"""^[\s{]*["']?schema["']?\s*:\s*["']?protocol/""", re.MULTILINE)


def read_bundle(folder: Path | str) -> Recording:
    """The recording in ``folder`` (or of the ``recording.yaml`` given).

    Units become SI, times stay on the session's clock. Frames go through the threshold pipeline where the bundle has no
    ``apex_height`` of its own. A skinrig protocol without ``setpoints`` is compiled to them, beginning at the first
    sample.

    Raises RecordingError that names file and line, column or channel.
    """
    folder = Path(folder)
    file = folder if is_file(folder) else folder / FILE_NAME
    if not is_file(file):
        raise RecordingError(f"{folder}: not a bundle: there is no {FILE_NAME}")
    try:
        data, source = read(file, aliases=True)
        return import_bundle(validate(Bundle, data, source), file.parent, source)
    except ProtocolError as error:
        raise RecordingError(str(error)) from error


def import_bundle(bundle: Bundle, folder: Path, source: Yaml) -> Recording:
    """The recording of ``bundle``, whose files are in ``folder``; faults are told at their place in ``source``."""
    return _Import(bundle, folder, source).recording()


class _Import:
    """The import of one bundle."""

    def __init__(self, bundle: Bundle, folder: Path, source: Yaml) -> None:
        self.folder = folder
        self.source = source
        self.bundle = bundle
        self.tables: dict[tuple[Path, str | None], Table] = {}
        self.times: dict[tuple[Path, str | None, TimeAxis, int], FloatArray] = {}
        self.events = [Event(e.time, e.level, e.code, e.text, e.count) for e in bundle.events]

    def recording(self) -> Recording:
        streams = self.series("channels", self.bundle.channels)
        setpoints = self.series("setpoints", self.bundle.setpoints)
        derived = self.series("derived", self.bundle.derived)
        start = min((float(s.time[0]) for s in streams.values()), default=0.0)
        frames = self.frames(self.bundle.frames, start) if self.bundle.frames is not None else None
        protocol, name = self.protocol()
        segments = self.segments()
        if not setpoints:
            setpoints, segments = self.compiled(protocol, start)
        recording = Recording(
            info=self.info(protocol, name),
            streams=streams,
            setpoints=setpoints,
            segments=segments,
            frames=frames,
            events=tuple(self.events),
            derived=derived,
            plot=self.bundle.run.plot,
        )
        recording = replace(recording, events=(*recording.events, *doubts(self.bundle, recording)))
        return self.threshold(recording)

    def fault(self, path: Key, message: str) -> RecordingError:
        return RecordingError(str(self.source.fault(path, message)))

    def info(self, protocol: str, name: str) -> RunInfo:
        bundle, run = self.bundle, self.bundle.run
        digest = hashlib.sha256(self.source.text.encode() + str(self.folder.resolve()).encode()).hexdigest()[:8]
        return RunInfo(
            id=run.id or f"import-{self.folder.resolve().name}-{digest}",
            instrument=bundle.instrument,
            start_time=run.start_time,
            end_time=run.end_time,
            status=run.status or "imported",
            trip_reason=run.trip_reason,
            protocol=protocol,
            protocol_name=name if run.protocol_name is None else run.protocol_name,
            subject=bundle.subject,
            site=bundle.site,
            operator=bundle.operator,
            repeat=bundle.repeat,
            specimen=bundle.specimen,
            specimen_properties=self.properties(),
            experiment=bundle.experiment,
            notes=bundle.notes,
            versions=run.versions,
            station=run.station,
            device=run.device,
            consent=run.consent,
            limits=run.limits,
            calibration=run.calibration,
        )

    def properties(self) -> dict[str, Stated]:
        bundle = self.bundle
        try:
            specimens.check(bundle.specimen, bundle.instrument)
        except ValueError as error:
            raise self.fault(("specimen",), str(error)) from None
        result: dict[str, Stated] = {}
        for key, given in bundle.specimen_properties.items():
            try:
                result |= specimens.stated(bundle.specimen, {key: given})
            except ValueError as error:
                raise self.fault(("specimen_properties", key), str(error)) from None
        return result

    # Tables ------------------------------------------------------------------------------------------------------

    def series(self, kind: str, sources: Mapping[str, Source]) -> dict[str, Series]:
        return {name: self.one(kind, name, source) for name, source in sources.items()}

    def one(self, kind: str, name: str, source: Source) -> Series:
        table = self.table((kind, name, "file"), source.file, source.sheet)
        scale = unit, factor, offset = self.scale(kind, name, source)
        nan = source.allow_nan
        if source.width is None:
            value, lines = table.column(source.column, name, allow_nan=nan)
            if kind != "derived" and not self.bundle.exported:
                self._refuse_impossible(table, name, source, scale, value, lines)
        else:
            columns = [f"{source.column}_{k}" for k in range(source.width)]
            value = np.column_stack([table.column(column, name, allow_nan=nan)[0] for column in columns])
        time = self.time((kind, name, "time"), table, source.time, len(value), name)
        seq = table.counter(source.seq, name) if source.seq else None
        if seq is None and kind == "channels":
            seq = np.arange(len(value))
        host = table.column(source.time_host, name)[0] if source.time_host else None
        for what, array in (("seq", seq), ("time_host", host)):
            if array is not None and len(array) != len(value):
                raise self.fault((kind, name, what), f"{len(array)} rows, but {len(value)} values")
        return Series(
            value=factor * value + offset,
            time=time,
            unit=unit,
            seq=seq,
            time_host=host,
            stage=source.stage if source.stage is not None else _stage(self.bundle.instrument, name),
            range=source.range,
            resolution=self.stated((kind, name), "resolution", source.resolution, unit),
            noise=self.stated((kind, name), "noise", source.noise, unit),
        )

    def scale(self, kind: str, name: str, source: Source) -> tuple[str, float, float]:
        """The SI unit of a source, and its factor and offset, with the sign of suction."""
        unit, factor, offset = self.unit((kind, name, "unit"), name, source.unit)
        if source.suction == "negative":
            return unit, factor, offset
        if unit != "Pa":
            raise self.fault((kind, name, "suction"), f"channel {name}: {source.unit!r} is no unit of pressure")
        return unit, -factor, 0.0 - offset  # no minus before nought

    def _refuse_impossible(
        self,
        table: Table,
        name: str,
        source: Source,
        scale: tuple[str, float, float],
        value: FloatArray,
        lines: Sequence[int],
    ) -> None:
        """Refuse a ``value`` (n,) in the stated unit, from these ``lines``, that the channel ``name`` cannot hold;
        ``scale`` is its SI unit, factor and offset."""
        unit, factor, offset = scale
        worst, reason = impossible(name, factor * value + offset, ours=self.bundle.instrument in OURS)
        if reason:
            text = f"{value[worst]:g} {source.unit} is {factor * value[worst] + offset:g} {unit}: {reason}"
            raise table.fault(lines[worst], name, source.column, f"{text}; a wrong unit?")

    def stated(self, channel: tuple[str, str], what: str, quantity: float | Quantity | None, unit: str) -> float:
        """A quantity of a channel in its SI ``unit``; a number is in SI."""
        if not isinstance(quantity, Quantity):
            return quantity or 0.0
        path = (*channel, what, "unit")
        try:
            si, factor, _ = units.to_si(quantity.unit)
        except ValueError as error:
            raise self.fault(path, f"channel {channel[1]}: {error}") from error
        if si != unit:
            text = f"{what} in {quantity.unit!r} is {si}, but this channel is in {unit}"
            raise self.fault(path, f"channel {channel[1]}: {text}")
        return factor * quantity.value

    def table(self, path: Key, name: str, sheet: str | None) -> Table:
        file = self.inside(path, name)
        key = (file, sheet)
        if key not in self.tables:
            self.tables[key] = Table(file, sheet)
        return self.tables[key]

    def inside(self, path: Key, name: str) -> Path:
        try:
            file = inside(self.folder, name)
        except ValueError as error:
            raise self.fault(path, str(error)) from error
        if not is_file(file):
            raise self.fault(path, f"there is no file {name!r}")
        return file

    def si(self, path: Key, channel: str, written: str) -> tuple[str, float, float]:
        try:
            return units.to_si(written)
        except ValueError as error:
            raise self.fault(path, f"channel {channel}: {error}") from error

    def unit(self, path: Key, channel: str, written: str) -> tuple[str, float, float]:
        si, factor, offset = self.si(path, channel, written)
        if self.bundle.instrument in OURS and path[0] != "derived":
            try:
                expected = units.KINDS[units.kind_of(channel)][0]
            except ValueError:
                return si, factor, offset  # a channel that this lab added
            if si != expected:
                raise self.fault(path, f"channel {channel}: {written!r} is {si}, but this channel is in {expected}")
        return si, factor, offset

    def time(self, path: Key, table: Table, axis: TimeAxis, count: int, channel: str) -> FloatArray:
        key = (table.path, table.sheet, axis, count)
        if key not in self.times:
            self.times[key] = self._time(path, table, axis, count, channel)
        return self.times[key]

    def _time(self, path: Key, table: Table, axis: TimeAxis, count: int, channel: str) -> FloatArray:
        if axis.rate is not None:
            return evenly(count, axis.rate, axis.start)
        assert axis.column is not None, "the schema asks for one of the two"
        si, factor, offset = self.si((*path, "unit"), channel, axis.unit) if axis.unit != "s" else ("s", 1.0, 0.0)
        if si != "s":
            raise self.fault((*path, "unit"), f"channel {channel}: {axis.unit!r} is not a unit of time")
        time, lines = table.column(axis.column, channel)
        if len(time) != count:
            message = f"{len(time)} times in column {axis.column!r} for {count} values"
            if len(time) > count:
                raise table.fault(lines[count], channel, axis.column, f"{message}, which end before this line")
            raise RecordingError(f"{table.path}: channel {channel}: {message}")
        back = np.flatnonzero(np.diff(time) < 0)
        if len(back):
            row = int(back[0]) + 1
            message = f"time goes back from {time[row - 1]:g} to {time[row]:g}"
            raise table.fault(lines[row], channel, axis.column, message)
        if path[0] != "setpoints" and not self.bundle.exported:  # there two rows of one time are a step
            self._standing(table, axis.column, channel, time, lines)
        return factor * time + offset

    def _standing(self, table: Table, column: str, channel: str, time: FloatArray, lines: Sequence[int]) -> None:
        """Refuse times that are all equal; some that are get a warning."""
        equal = np.flatnonzero(np.diff(time) == 0) + 1
        if not len(equal):
            return
        if len(equal) == len(time) - 1:
            message = f"all {len(time)} times are {time[0]:g}: time stands still"
            raise table.fault(lines[1], channel, column, message)
        if all(event.code != "equal_times" for event in self.events):
            place = f"{table.path.name}:{lines[equal[0]]}: channel {channel}, column {column!r}"
            text = f"{place}: {time[equal[0]]:g} is the time of the line before too ({len(equal)} such lines)"
            self.events.append(Event(float(time[equal[0]]), "warning", "equal_times", text, len(equal)))

    # Images ------------------------------------------------------------------------------------------------------

    def frames(self, images: Images, start: float) -> Frames:
        try:
            data = find_frames(self.folder, images.files)
        except RecordingError as error:
            raise self.fault(("frames", "files"), str(error)) from error
        seq = np.arange(len(data))
        if images.rate is not None:
            time = evenly(len(data), images.rate, start if images.start is None else images.start)
        else:
            assert images.time is not None, "the schema asks for both"
            assert images.time_file is not None, "the schema asks for both"
            table = self.table(("frames", "time_file"), images.time_file, None)
            time = self.time(("frames", "time"), table, images.time, len(data), "frames")
            if images.seq is not None:
                seq = table.counter(images.seq, "frames")
        return Frames(data, time, images.scale or 0.0, seq)

    def threshold(self, recording: Recording) -> Recording:
        """Contours and heights from the frames, unless the bundle states them."""
        images = self.bundle.frames
        if images is None or "apex_height" in recording.streams:
            return recording
        if images.scale is None:
            text = "the frames have no scale, so no height was measured in them"
            missing = Event(0.0, "warning", "no_scale", text)
            return replace(recording, events=(*recording.events, missing))
        from acquire.analysis.frames import with_contour
        from drivers.aspiration.contour import Settings

        delta = Settings.delta if images.delta is None else images.delta
        try:
            return with_contour(recording, Settings(images.gvt, delta, images.apex, images.tissue))
        except ValueError as error:
            raise self.fault(("frames",), str(error)) from error

    # Protocol ----------------------------------------------------------------------------------------------------

    def protocol(self) -> tuple[str, str]:
        """The protocol's text and its name: of a file here or of the library, else it is the text that is given.

        A line with a suffix such as ``.yaml`` names a file, and is a fault where there is none.
        """
        given = self.bundle.protocol
        if given is None:
            return "", ""
        if isinstance(given, dict):
            return written(given), str(given.get("name", ""))
        if "\n" in given:
            return given, ""
        from protocols.catalogue import library

        if given in library() and not is_file(self.folder / given):
            return library()[given].read_text("utf-8"), given
        if not is_file(self.folder / given) and not _NAMES_A_FILE.search(given):
            return given, ""
        file = self.inside(("protocol",), given)
        try:
            return contents(file, MAX_PROTOCOL).decode(), file.stem
        except ValueError as error:
            raise self.fault(("protocol",), f"{given!r}: {in_words(error)}") from error

    def segments(self) -> tuple[SegmentRecord, ...]:
        name = self.bundle.segments
        return () if name is None else read_segments(self.inside(("segments",), name))

    def compiled(self, text: str, start: float) -> tuple[dict[str, Series], tuple[SegmentRecord, ...]]:
        """Set-points of a skinrig protocol and their segments; of any other, none."""
        from protocols.compiler import compile_protocol
        from protocols.limits import Limits, Range
        from protocols.text import load

        if not _OURS.search(text):
            return {}, ()
        try:
            protocol = load(text if "\n" in text else text + "\n")
            # The run was allowed where it was done: only the protocol's own limits are asked again.
            setpoints = compile_protocol(protocol, Limits({q: Range(-1e9, 1e9) for q in protocol.quantities}))
        except ProtocolError as error:
            where = self.bundle.protocol if isinstance(self.bundle.protocol, str) else text
            located = ProtocolError(error.problems, where if where != text else "")
            raise self.fault(("protocol",), f"the protocol is faulty: {located}") from error
        times, values = setpoints.table()
        text = "set-points were compiled from the protocol, its beginning put at the first sample"
        self.events.append(Event(start, "info", "setpoints_compiled", text))
        series = {q: Series(v, times + start, units.KINDS[units.kind_of(q)][0]) for q, v in values.items()}
        return series, of_setpoints(setpoints, start)


def _stage(instrument: str, channel: str) -> str:
    """The stage that a known channel of a known instrument observes."""
    if instrument in SUCTION and channel == "pressure":
        return "actuator"
    if instrument == "microrobot" and channel.startswith("axis_position"):
        return "actuator"
    if instrument in OURS and channel.startswith(("apex_height", "transducer_force")):
        return "sensor"
    if instrument == "microrobot" and channel.startswith(("probe_", "force_")):
        return "processing"
    return ""
