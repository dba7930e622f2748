"""The set-up of a recording as a fit takes it: the probe's opening, its force, the support's hole, and who says so.

The specification comes first, then the recording's protocol, its calibration, and the station it was made on. Where
none says anything, a usual value of the instrument is assumed, the same for every model, and the result warns of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isclose
from typing import Any

import yaml

from ..api import ModelInfo
from . import units

SPECIFICATION, PROTOCOL, CALIBRATION, STATION, ASSUMED = (
    "specification",
    "protocol",
    "calibration",
    "station",
    "assumed",
)
FITTED = "fitted"
ALIKE = 1e-3  # relative difference up to which two statements agree


@dataclass(frozen=True)
class Kind:
    """A quantity of a set-up: its ``name`` in protocols and stations, and where models take it.

    ``options`` maps a problem to its geometry option, which is ``factor`` times the quantity; ``parameter`` is a
    model's parameter that holds it instead. A value outside ``possible`` [SI] is taken for a wrong unit.
    """

    name: str
    words: str
    unit: str
    possible: tuple[float, float]
    factor: float = 1.0
    options: Mapping[str, str] = field(default_factory=dict)
    parameter: str = ""
    usual: Mapping[str, float] = field(default_factory=dict)


KINDS = (
    Kind("opening", "opening", "m", (2e-4, 5e-2), 0.5, {"suction": "opening_radius", "finger": "opening"},
         usual={"cutometer": 2e-3, "aspiration": 8e-3}),  # diameters, as simulated instruments and the diagnosis take
    Kind("contact_force", "contact force", "N", (0.0, 5.0), parameter="spring_force"),
    Kind("hole_radius", "radius of the hole", "m", (1e-3, 0.2), options={"sheet": "hole_radius"},
         usual={"microrobot": 20e-3}),
)  # fmt: skip


@dataclass(frozen=True)
class Fact:
    """One quantity of a set-up: its value [SI] and where it is from; ``others`` are statements that differ."""

    name: str
    words: str
    value: float
    unit: str
    source: str
    others: tuple[tuple[str, float], ...] = ()

    def in_words(self) -> str:
        return f"{self.words} {units.show(self.value, self.unit)} ({self.source})"

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "name": self.name,
            "value": self.value,
            "unit": self.unit,
            "source": self.source,
            "disagree": dict(self.others),
        }


@dataclass(frozen=True)
class Setup:
    """The set-up of one recording in a fit: ``geometry`` options and held ``parameters`` of the model, the facts behind
    them, and ``faults``, statements that could not be understood."""

    geometry: Mapping[str, Any] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    facts: tuple[Fact, ...] = ()
    faults: tuple[str, ...] = ()

    def in_words(self) -> str:
        return ", ".join(fact.in_words() for fact in self.facts)


@dataclass(frozen=True)
class Given:
    """A specification's part in it: geometry options, parameters that it holds (SI), and symbols that it frees."""

    geometry: Mapping[str, Any]
    held: Mapping[str, float] = field(default_factory=dict)
    free: tuple[str, ...] = ()


def setup(about: Any, info: ModelInfo, given: Given) -> Setup:
    """The set-up of a recording. ``about`` is its ``info``: instrument and, where known, protocol, calibration, station
    and device."""
    geometry, parameters = dict(given.geometry), {}
    facts: list[Fact] = []
    faults: list[str] = []
    for kind in KINDS:
        option = kind.options.get(info.problem, "")
        held = kind.parameter if kind.parameter in info.symbols else ""
        if not option and not held:
            continue
        said = list(_said(about, kind, faults))
        fact = _fact(kind, said, _asked(kind, option, held, given), _usual(kind, about.instrument, info, held))
        if fact is None:
            continue
        facts.append(fact)
        if fact.source in (SPECIFICATION, FITTED):
            continue
        if option:
            geometry[option] = kind.factor * fact.value
        else:
            parameters[held] = fact.value
    return Setup(geometry, parameters, tuple(facts), tuple(faults))


def _asked(kind: Kind, option: str, held: str, given: Given) -> tuple[str, float] | None:
    """Source and SI value of a quantity in the specification; NaN where it is fitted, None where it is not there."""
    if option and option in given.geometry:
        return SPECIFICATION, float(given.geometry[option]) / kind.factor
    if held in given.free:
        return FITTED, float("nan")
    return (SPECIFICATION, given.held[held]) if held in given.held else None


def _usual(kind: Kind, instrument: str, info: ModelInfo, held: str) -> float | None:
    return info[held].default if held else kind.usual.get(instrument)


def _fact(
    kind: Kind, said: list[tuple[str, float]], asked: tuple[str, float] | None, usual: float | None
) -> Fact | None:
    if asked is None:
        asked = said[0] if said else (ASSUMED, usual) if usual is not None else None
    if asked is None:
        return None
    source, value = asked
    others = () if source == FITTED else tuple((s, v) for s, v in said if not isclose(v, value, rel_tol=ALIKE))
    return Fact(kind.name, kind.words, value, kind.unit, source, others)


def _said(about: Any, kind: Kind, faults: list[str]) -> Iterable[tuple[str, float]]:
    """Statements of the recording itself, (source, SI value), the weightiest first."""
    protocol = _mapping(getattr(about, "protocol", ""))
    own = protocol.get("setup")
    entries = [(PROTOCOL, (own if isinstance(own, Mapping) else protocol).get(kind.name))]
    calibration = getattr(about, "calibration", None) or {}
    entries.append((CALIBRATION, calibration.get(kind.name) if isinstance(calibration, Mapping) else None))
    instruments = _mapping(getattr(about, "station", "")).get("instruments")
    device = getattr(about, "device", "") or about.instrument
    station = instruments.get(device) if isinstance(instruments, Mapping) else None
    known = station.get("calibration") if isinstance(station, Mapping) else None
    entries.append((STATION, known.get(kind.name) if isinstance(known, Mapping) else None))
    for source, entry in entries:
        if entry is None:
            continue
        try:
            value = _value(entry, kind)
        except (ValueError, TypeError) as error:
            faults.append(f"its {source}'s {error}: it is not used")
            continue
        yield (_provenance(entry) if source == CALIBRATION else source), value


def _mapping(text: Any) -> Mapping[str, Any]:
    """YAML of one mapping; empty for anything else: recordings keep protocols of other rigs in any words."""
    try:
        found = yaml.safe_load(text or "")
    except (yaml.YAMLError, ValueError, AttributeError, RecursionError):
        return {}
    return found if isinstance(found, Mapping) else {}


def _value(entry: Any, kind: Kind) -> float:
    """SI value of '4 mm', of a number in SI, or of {value, unit}. Raises ValueError that names the quantity."""
    if isinstance(entry, Mapping):
        value, unit = entry.get("value"), str(entry.get("unit") or "")
        plain = value if isinstance(value, str | type(None)) else float(value)
        entry = f"{plain:.12g} {unit}" if unit and isinstance(plain, float) else plain
    value = units.read(entry, kind.unit, kind.name)
    low, high = kind.possible
    if not low <= value <= high:
        bounds = f"{units.show(low, kind.unit)} to {units.show(high, kind.unit)}"
        raise ValueError(f"{kind.name}: {entry!r} is {value:.4g} {kind.unit}, beyond {bounds}; write its unit")
    return value


def _provenance(entry: Any) -> str:
    how = str(entry.get("provenance") or "") if isinstance(entry, Mapping) else ""
    return f"{CALIBRATION}, {how}" if how else CALIBRATION


def remarks(setups: Mapping[str, Setup]) -> list[str]:
    """Warnings about the set-ups of recordings, by label: assumptions, disagreements, misunderstandings."""
    found: dict[str, list[str]] = {}
    for label, one in setups.items():
        for fault in one.faults:
            found.setdefault(fault, []).append(label)
        for fact in one.facts:
            for source, value in fact.others:
                differ = f"{units.show(fact.value, fact.unit)} by its {fact.source}, {units.show(value, fact.unit)}"
                found.setdefault(f"{fact.words} is {differ} by its {source}: the first is used", []).append(label)
        assumed = [fact for fact in one.facts if fact.source == ASSUMED]
        if assumed:
            words = " and ".join(f"{fact.words} ({units.show(fact.value, fact.unit)} is assumed)" for fact in assumed)
            names = " and ".join(fact.name for fact in assumed)
            told = f"nothing states the {words}, on which the parameters hang"
            found.setdefault(f"{told}: state {names} in the protocol's setup or among the calibrations", []).append(
                label
            )
    return [f"{', '.join(labels)}: {text}" for text, labels in found.items()]


def common(sets: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """The entries that are the same in every one."""
    first = sets[0] if sets else {}
    return {name: value for name, value in first.items() if all(one.get(name) == value for one in sets)}
