"""The worker's answers about the station and about protocols, without touching an instrument."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from acquire.gui.messages import BenchSettings, ChannelInfo, InstrumentInfo, Preview, ProtocolEntry

if TYPE_CHECKING:
    from acquire.session import Session
    from acquire.station import Station


def station(bench: BenchSettings) -> Station:
    """The station file that the bench names, the simulated one for none.

    Raises ProtocolError (a ValueError) with file, line and field of every fault, OSError.
    """
    from acquire.station import load_station, simulated_station

    return load_station(bench.station) if bench.station else simulated_station(bench.tissue, seed=bench.seed)


def instruments(session: Session) -> tuple[InstrumentInfo, ...]:
    """Every instrument of the station whose driver loads."""
    from acquire.plugins import instrument

    found = []
    for name, entry in session.station.instruments.items():
        kind = session.kind(name)
        try:
            driver = instrument(kind)
        except ValueError as error:
            found.append(InstrumentInfo(name, kind, f"no driver: {error}", entry.simulated is not None, (), False))
            continue
        channels = tuple(ChannelInfo(c.name, c.unit) for c in driver.channels)
        simulated = entry.simulated is not None
        found.append(InstrumentInfo(name, kind, driver.title, simulated, channels, "camera" in driver.sources))
    return tuple(found)


def protocols(folder: Path | None = None) -> tuple[ProtocolEntry, ...]:
    """The library's protocols, or those of a folder. A file with faults is listed: the preview tells them."""
    from protocols import library, load

    paths = list(library().values()) if folder is None else sorted(Path(folder).glob("*.yaml"))
    found = []
    for path in paths:
        try:
            protocol = load(path)
            found.append(ProtocolEntry(protocol.name, protocol.title, protocol.instrument, path))
        except (ValueError, OSError):
            found.append(ProtocolEntry(path.stem, "has faults", "", path))
    return tuple(found)


def preview(session: Session, name: str, path: str, subject: str = "") -> Preview:
    """The protocol at ``path`` compiled for instrument ``name``. Raises ProtocolError, ValueError."""
    from protocols import find, load
    from protocols.summary import headline, rows, summarise

    protocol = load(find(path))
    setpoints, limits = session.compile(name, protocol, subject)
    time, values = setpoints.table()
    edges = setpoints.edges
    phases = tuple(
        (float(begin), float(end), segment.phase)
        for begin, end, segment in zip(edges[:-1], edges[1:], setpoints.segments, strict=True)
    )
    bounds = {q: bound for q, bound in limits.values().items() if np.isfinite(bound).any()}
    summary = summarise(protocol, setpoints, limits)
    return Preview(
        name=protocol.name,
        instrument=protocol.instrument,
        text=protocol.origin.text,
        headline=headline(summary),
        rows=rows(summary),
        duration=setpoints.duration,
        time=time,
        values=values,
        limits=bounds,
        phases=phases,
    )
