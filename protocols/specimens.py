"""Reference specimens: bodies measured in place of skin to learn about the instrument, and the numbers known of them.

The one home of their names, of the instruments they fit, of their property keys with units and default standard
uncertainties, and of the device effects that they tie down. A specimen of any other name is a laboratory's own:
it keeps its name and whatever properties it states, and nothing is concluded from them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from protocols import units
from protocols.uncertain import MOST, Raw, read_uncertain

SKIN, MANOMETER = "skin", "manometer"
SUCTION = ("cutometer", "aspiration")
ROBOT = ("microrobot",)
_UNIT_VECTOR = 0.01  # how far from 1 the length of a direction may be


@dataclass(frozen=True)
class Property:
    """A number that a specimen states: its SI ``unit``, how many components, default standard uncertainty, bounds.

    The default uncertainty is ``se`` (SI) plus ``relative`` times the value.
    """

    key: str
    unit: str
    meaning: str
    se: float = 0.0
    relative: float = 0.0
    size: int = 1
    low: float = -math.inf
    high: float = math.inf
    example: str = ""
    otherwise: float = math.nan  # where none is stated; NaN: a run needs it
    shown: str = ""  # unit for people

    def in_words(self, stated: Stated) -> str:
        """The stated number, in the unit that people use."""
        factor = units.to_si(self.shown)[1] if self.shown else 1.0
        return f"{self.key} {_written(stated.value, stated.se, factor)} {self.shown or self.unit}".removesuffix(" 1")

    def default_se(self, value: tuple[float, ...]) -> float:
        """Standard uncertainty where none is stated, in ``unit`` (rad for a direction)."""
        return self.se + self.relative * max(abs(v) for v in value)


@dataclass(frozen=True)
class Stated:
    """A property as it was stated: ``value`` (one component, or three of a direction) and ``se`` in SI ``unit``.

    The ``se`` of a direction is an angle in rad.
    """

    value: tuple[float, ...]
    se: float
    unit: str

    @property
    def scalar(self) -> float:
        """The value of a property with one component."""
        return self.value[0]

    def plain(self) -> dict[str, Any]:
        """As JSON and YAML write it; `stated` reads it back to the same."""
        value: Any = list(self.value) if len(self.value) > 1 else self.value[0]
        return {"value": value, "se": self.se, "unit": self.unit}

    def __str__(self) -> str:
        return _written(self.value, self.se) + ("" if self.unit == "1" else f" {self.unit}")


def _written(value: tuple[float, ...], se: float, factor: float = 1.0) -> str:
    """Components and standard error over ``factor``; an exact value stands alone."""
    numbers = ", ".join(f"{v / factor:.6g}" for v in value)
    return f"{numbers} ± {se / factor:.2g}" if se else numbers


@dataclass(frozen=True)
class Specimen:
    """A reference specimen: ``known`` is taken for granted by the diagnosis, ``separates`` the effects it ties down.

    ``yields``: it follows the probe as skin does, so that a run may be stopped where nothing moves. ``instruction`` is
    for the person at the bench.
    """

    name: str
    instruments: tuple[str, ...]
    properties: tuple[Property, ...]
    known: str
    separates: tuple[str, ...]
    instruction: str
    yields: bool = False

    def property(self, key: str) -> Property:
        """The property ``key``. Raises ValueError that names the key and those that exist."""
        for item in self.properties:
            if item.key == key:
                return item
        have = ", ".join(p.key for p in self.properties) or "none"
        raise ValueError(f"{key}: no property of a {self.name}, which has {have}")


HEIGHT = Property(
    "height", "m", "height of the solid above the probe's rim", 2e-6, 0.0, 1, 0.0, 20e-3, "1.000±0.002 mm", shown="mm"
)
MEMORY = Property("memory", "1", "largest share of the work that a cycle loses", 0.0, 0.0, 1, 0.0, 0.5, "0.01", 0.01)
STIFFNESS = Property("k", "N/m", "stiffness, the same in all directions", 0.0, 0.01, 1, 1.0, 1e6, "400±4 N/m")
MASS = Property("mass", "kg", "mass that hangs on the probe", 0.0, 1e-3, 1, 1e-5, 1.0, "20.00±0.02 g", shown="g")
DIRECTION = Property(
    "direction", "1", "unit vector of the weight on the probe", 0.01, 0.0, 3, -1.01, 1.01, "0, 0, -1 ± 0.01"
)

SPECIMENS: dict[str, Specimen] = {
    s.name: s
    for s in (
        Specimen(
            "rigid block",
            SUCTION,
            (),
            "height 0 at any pressure",
            ("regulator_lag", "leak", "dead_band", "sensor_offset", "sensor_drift", "crosstalk"),
            "Close the probe's opening with the rigid block, flat against the rim.",
        ),
        Specimen(
            "gauge step",
            SUCTION,
            (HEIGHT,),
            "height of a solid, at no suction",
            ("sensor_gain", "quadratic_error", "threshold_bias", "scale_error"),
            "Lay the probe on a flat; once the run has begun, slide the gauge step under its opening.",
        ),
        Specimen(
            "reference membrane",
            SUCTION,
            (MEMORY,),
            "a monotone, memoryless height at each pressure, unknown but fixed",
            ("sensor_low_pass", "sensor_hysteresis", "desynchronisation", "rim_friction", "rim_leak"),
            "Lay the probe on the reference membrane, as it is laid on skin.",
            yields=True,
        ),
        Specimen(
            MANOMETER,
            SUCTION,
            (),
            "the pressure at the probe, by a second gauge",
            ("gauge_gain", "gauge_offset", "regulator_lag"),
            "Close the probe with the manometer's adapter; its reading is recorded as pressure_reference.",
        ),
        Specimen(
            "open air",
            ROBOT,
            (),
            "no force",
            ("viscous_drag", "coulomb_friction", "integral_windup", "gravity_load", "sensor_drift"),
            "Leave the probe free in the air.",
        ),
        Specimen(
            "rigid post",
            ROBOT,
            (),
            "the tip does not move",
            ("glue_compliance", "force_saturation"),
            "Glue the probe's tip to the rigid post.",
        ),
        Specimen(
            "reference spring",
            ROBOT,
            (STIFFNESS,),
            "force -k u on the probe in every direction, without memory",
            ("sensor_gain", "crosstalk", "misalignment", "sensor_low_pass", "sensor_hysteresis"),
            "Join the probe's tip to the reference spring.",
            yields=True,
        ),
        Specimen(
            "dead weight",
            ROBOT,
            (MASS, DIRECTION),
            "force mass·g on the probe along a direction",
            ("sensor_gain", "misalignment", "wrong_geometry"),
            "Hang the weight on the probe's tip, over the pulley where its direction is not down.",
        ),
    )
}
"""The reference specimens by name. The two solids and open air do not come up under suction as skin does."""

GRAVITY = 9.80665  # m/s²: standard acceleration of free fall


def check(specimen: str, instrument: str) -> None:
    """Raises ValueError where a reference specimen is not for ``instrument`` (one of ours)."""
    found = SPECIMENS.get(specimen)
    if found is None or instrument not in (*SUCTION, *ROBOT) or instrument in found.instruments:
        return
    raise ValueError(f"specimen: a {specimen} is not for a {instrument}, which has {', '.join(of(instrument))}")


def of(instrument: str) -> tuple[str, ...]:
    """Names of the reference specimens for ``instrument``; none for one that is not ours."""
    return tuple(s.name for s in SPECIMENS.values() if instrument in s.instruments)


def yields(specimen: str) -> bool:
    """Whether it follows the probe: skin does, and an unknown specimen is taken for skin."""
    return specimen not in SPECIMENS or SPECIMENS[specimen].yields


def described(specimen: str, properties: Mapping[str, Stated]) -> str:
    """``gauge step (height 1 ± 0.002 mm)``: a specimen with what is stated of it, in the units that people use."""
    known = {item.key: item for item in SPECIMENS[specimen].properties} if specimen in SPECIMENS else {}
    said = [known[k].in_words(value) if k in known else f"{k} {value}" for k, value in properties.items()]
    return f"{specimen} ({', '.join(said)})" if said else specimen


def check_complete(specimen: str, instrument: str, properties: Mapping[str, Stated]) -> None:
    """Raises ValueError where a run on ``instrument`` could not be used: a wrong specimen, or a number not stated.

    Skin takes no properties: who states one has mounted a reference and not said so.
    """
    check(specimen, instrument)
    if specimen == SKIN and properties:
        raise ValueError(f"{', '.join(properties)}: stated of skin; name the reference specimen it belongs to")
    found = SPECIMENS.get(specimen)
    for item in found.properties if found else ():
        if item.key not in properties and math.isnan(item.otherwise):
            raise ValueError(
                f"{item.key}: state it for a {specimen} ({item.meaning}), such as '{item.key}={item.example}'"
            )


def stated(specimen: str, properties: Mapping[str, object]) -> dict[str, Stated]:
    """The properties of ``specimen`` from written text: ``{"height": "1.000±0.002 mm"}``.

    A value is text with its unit, with or without ``± uncertainty`` (in the same unit, one of its own, or ``%``), a
    number or list in SI, or a mapping of ``value``, ``se`` and ``unit``. Raises ValueError that names the key.
    """
    if len(properties) > MOST:
        raise ValueError(f"specimen_properties: {len(properties)} of them; at most {MOST}")
    known = SPECIMENS.get(specimen)
    result = {}
    for key, given in properties.items():
        item = None if known is None else known.property(key)
        try:
            result[key] = _checked(read_uncertain(given), item)
        except ValueError as error:
            example = f", such as '{item.example}'" if item else ""
            raise ValueError(f"{key}: {error}{example}") from None
    return result


def assignments(texts: list[str] | tuple[str, ...]) -> dict[str, str]:
    """``("height=1.000±0.002 mm",)`` as a mapping. Raises ValueError."""
    result: dict[str, str] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise ValueError(f"specimen property {text!r}: expected KEY=VALUE, such as 'height=1.000±0.002 mm'")
        if key.strip() in result:
            raise ValueError(f"specimen property {key.strip()} is given twice")
        result[key.strip()] = value.strip()
    return result


def _checked(raw: Raw, item: Property | None) -> Stated:
    value, se, unit = raw
    if item is None:
        return Stated(value, se or 0.0, unit or "1")
    if unit and unit != item.unit:
        raise ValueError(f"is in {unit}, not in {item.unit}")
    if len(value) != item.size:
        raise ValueError(f"has {len(value)} components, not {item.size}")
    if not all(item.low <= v <= item.high for v in value):
        raise ValueError(f"must be {item.low:g} … {item.high:g} {item.unit}")
    if item.size > 1:
        value = _unit_vector(value)
    return Stated(value, item.default_se(value) if se is None else se, item.unit)


def _unit_vector(value: tuple[float, ...]) -> tuple[float, ...]:
    length = math.hypot(*value)
    if abs(length - 1.0) > _UNIT_VECTOR:
        raise ValueError(f"is no unit vector: its length is {length:.4g}")
    return tuple(v / length for v in value)
