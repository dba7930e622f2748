import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols import units


@pytest.mark.parametrize(
    ("text", "kind", "si"),
    [
        ("-300 mbar", "pressure", -30e3),
        ("-300mbar", "pressure", -30e3),
        ("-30 kPa", "pressure", -30e3),
        ("1.2 mm", "length", 1.2e-3),
        ("0.1 Hz", "frequency", 0.1),
        ("15 mbar/s", "pressure rate", 1500.0),
        ("45 min", "time", 2700.0),
        ("30 deg", "angle", math.pi / 6),
        ("0.02 mm/px", "scale", 2e-5),
        ("1e5 mbar/s", "pressure rate", 1e7),
    ],
)
def test_quantities_become_si(text: str, kind: str, si: float) -> None:
    assert units.parse(text, kind) == pytest.approx(si, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (300, "unit is missing"),
        ("300", "unit is missing"),
        (True, "expected pressure"),
        (None, "expected pressure"),
        ("300 mm", "no unit of pressure"),
        ("300 mbarr", "no unit of pressure"),
        ("300 mbar; import os", "no unit of pressure"),
        ("-300 mbar " + 60 * "*mbar", "does not read as pressure"),
        ("three mbar", "does not read as pressure"),
        ("nan mbar", "does not read as pressure"),
        ("1e999 mbar", "not finite"),
    ],
)
def test_what_is_no_pressure_is_refused(text: object, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        units.parse(text, "pressure")


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(sorted(units.KINDS)))
def test_written_quantities_read_back_exactly(value: float, kind: str) -> None:
    assert units.parse(units.write(value, kind), kind) == value


def test_people_get_the_units_they_use() -> None:
    assert units.write(-30e3, "pressure") == "-300 mbar"
    assert units.write(1.2e-3, "length") == "1.2 mm"
    assert units.write(math.radians(45), "angle") == "45 deg"


@pytest.mark.parametrize(
    ("written", "si", "factor"),
    [
        ("N m", "N m", 1.0),
        ("mN*m", "N m", 1e-3),
        ("Nm", "N m", 1.0),
        ("mNm", "N m", 1e-3),
        ("kgf cm", "N m", 0.0980665),
        ("lbf ft", "N m", 1.3558179483314),
        ("J", "J", 1.0),
        ("W s", "J", 1.0),
        ("N m/s", "W", 1.0),
        ("rpm", "rad/s", math.pi / 30),
        ("%", "1", 0.01),
    ],
)
def test_a_torque_is_no_energy(written: str, si: str, factor: float) -> None:
    assert units.to_si(written) == (si, pytest.approx(factor), 0.0)


def test_a_temperature_has_an_offset_and_a_logarithm_is_refused() -> None:
    assert units.to_si("degC") == ("K", 1.0, pytest.approx(273.15))
    with pytest.raises(ValueError, match="not a unit"):
        units.to_si("dB")


def test_kinds_of_channels() -> None:
    assert units.kind_of("probe_x") == "length"
    assert units.kind_of("force_z") == "force"
    with pytest.raises(ValueError, match="unknown channel"):
        units.kind_of("pressures")
