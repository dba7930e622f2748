"""Recordings of the standard set that a folder holds already: whether they are of the instrument at hand, as it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from acquire.qualifications import serial_of
from acquire.recording import RunInfo, open_recording
from acquire.session import Session
from acquire.station import Instrument, load_station
from gap.qualify.steps import Step
from protocols import Protocol, ProtocolError, find, load
from sim_devices.effects import parse_effect


def recording_of(step: Step, folder: Path) -> Path:
    """Where the recording of a step is kept."""
    return folder / f"{step.name}.h5"


def kept(session: Session, name: str, steps: Sequence[Step], folder: Path) -> dict[str, RunInfo]:
    """The recordings in ``folder`` that need not be made again, by step: measured to their end, with the station's
    instrument ``name`` as it is now.

    Before anything is measured it is seen, too, that every step can be. Raises ValueError that names the file of
    another instrument, specimen or protocol, or the effect that cannot be simulated; ProtocolError; DeviceError.
    """
    entry, kind = session.station.instruments[name], session.kind(name)
    protocols = _feasible(session, name, steps)
    there = [s for s in steps if recording_of(s, folder).is_file()]
    found = {s.name: open_recording(recording_of(s, folder)).info for s in there}
    for step in there:
        if why := _other(found[step.name], step, kind, protocols[step.name], entry):
            raise ValueError(f"{recording_of(step, folder)}: {why}; take another folder")
    done = {key: info for key, info in found.items() if info.status == "completed"}
    numbers = {key: number for key, info in done.items() if (number := serial_of(info))}
    if numbers:  # the instrument is asked only where something is left to measure with it
        here = _serial_here(session, name) if len(done) < len(steps) else ""
        here = here or next(iter(numbers.values()))
        for step in there:
            if (number := numbers.get(step.name, here)) != here:
                path = recording_of(step, folder)
                raise ValueError(f"{path}: is of serial number {number}, not of {here}; take another folder")
    return done


def _feasible(session: Session, name: str, steps: Sequence[Step]) -> dict[str, Protocol]:
    """The protocols of ``steps`` by their names, which the station's instrument ``name`` can carry out.

    Raises ValueError of an effect that cannot be simulated, ProtocolError, DeviceError.
    """
    entry = session.station.instruments[name]
    for text in entry.simulated.effects if entry.simulated else ():
        parse_effect(text, session.kind(name))
    protocols = {step.name: load(find(step.protocol)) for step in steps}
    for protocol in protocols.values():
        session.compile(name, protocol)
    return protocols


def in_words(done: Mapping[str, RunInfo], steps: Sequence[Step]) -> str:
    """How many steps need not be measured again, and of which days their recordings are."""
    days = sorted({info.start_time[:10] for info in done.values()} - {""})
    of = f" of {' to '.join(dict.fromkeys((days[0], days[-1])))}" if days else ""
    return f"{len(done)} of {len(steps)} steps taken from recordings{of}"


def _other(info: RunInfo, step: Step, kind: str, protocol: Protocol, entry: Instrument) -> str:
    """Why a recording is not that of a step on this instrument; '' where it is."""
    if info.instrument != kind:
        return f"is of instrument {info.instrument}, not of {kind}"
    if info.specimen != step.specimen or dict(info.specimen_properties) != dict(step.known):
        return f"is of a {info.specimen} with other numbers than step {step.name}"
    if not _same_protocol(info, protocol):
        return f"follows another protocol than {protocol.name} as it is now"
    was, now = _made_by(info), _making(entry)
    return "" if was in ("", now) else f"was made by {was}, and this is {now}"


def _same_protocol(info: RunInfo, protocol: Protocol) -> bool:
    try:
        return load(f"{info.protocol}\n") == protocol
    except ProtocolError:
        return False


def _making(entry: Instrument) -> str:
    """Whether an instrument of a station is real or simulated, and with which effects, in words."""
    if entry.simulated is None:
        return "a real instrument"
    return f"a simulated instrument with {', '.join(entry.simulated.effects) or 'no effects'}"


def _made_by(info: RunInfo) -> str:
    """The same of the instrument of a recording; '' where its station does not tell."""
    try:
        entry = load_station(f"{info.station}\n").instruments.get(info.device)
    except ProtocolError:
        return ""
    return "" if entry is None else _making(entry)


def _serial_here(session: Session, name: str) -> str:
    """The serial number that the instrument on the bench says; '' where it says none."""
    identities, _ = session.look(name)
    identity = identities.get(session.engine(name).rig.device.name)
    return identity.serial if identity is not None else ""
