"""Reference specimens: how their numbers are read, and how a wrong one is told."""

from __future__ import annotations

from typing import Any

import pytest

from protocols.specimens import SPECIMENS, Stated, assignments, check, check_complete, described, stated

NAMES = (
    "rigid block", "gauge step", "reference membrane", "manometer",
    "open air", "rigid post", "reference spring", "dead weight",
)  # fmt: skip


def test_the_table_has_these_names_and_no_other() -> None:
    assert tuple(SPECIMENS) == NAMES


@pytest.mark.parametrize(
    ("specimen", "key", "given", "value", "se"),
    [
        ("gauge step", "height", "1.000±0.002 mm", 1e-3, 2e-6),
        ("gauge step", "height", "1.000±0.002mm", 1e-3, 2e-6),
        ("gauge step", "height", "1 mm ± 2 µm", 1e-3, 2e-6),
        ("gauge step", "height", "1.000 +/- 0.002 mm", 1e-3, 2e-6),
        ("gauge step", "height", "1 mm", 1e-3, 2e-6),
        ("gauge step", "height", {"value": 1.0, "se": 0.002, "unit": "mm"}, 1e-3, 2e-6),
        ("gauge step", "height", {"value": "1.0 mm", "uncertainty": "2 µm"}, 1e-3, 2e-6),
        ("gauge step", "height", {"value": 0.001, "u": 3e-6}, 1e-3, 3e-6),
        ("gauge step", "height", 1e-3, 1e-3, 2e-6),
        ("reference membrane", "memory", 0.01, 0.01, 0.0),
        ("reference spring", "k", "400 N/m ± 1 %", 400.0, 4.0),
        ("reference spring", "k", "0.4 N/mm", 400.0, 4.0),
        ("gauge step", "height", "1.000(3) mm", 1e-3, 3e-6),
        ("gauge step", "height", "1000(3)µm", 1e-3, 3e-6),
        ("reference spring", "k", " 400.0(25) N/m", 400.0, 2.5),
        ("dead weight", "mass", "20.00±0.02 g", 0.02, 2e-5),
    ],
)
def test_reading(specimen: str, key: str, given: Any, value: float, se: float) -> None:
    known = stated(specimen, {key: given})[key]
    assert known.scalar == pytest.approx(value)
    assert known.se == pytest.approx(se)
    assert stated(specimen, {key: known.plain()})[key] == known


def test_a_direction_has_three_components() -> None:
    known = stated("dead weight", {"direction": "0, 0.6, -0.8 ± 0.5 deg"})["direction"]
    assert known.value == pytest.approx((0.0, 0.6, -0.8))
    assert known.se == pytest.approx(0.5 * 3.14159265 / 180)
    assert stated("dead weight", {"direction": [0, 0, -1]})["direction"] == Stated((0.0, 0.0, -1.0), 0.01, "1")


@pytest.mark.parametrize(
    "given",
    [
        {"value": [0, 0, 1], "se": "0.02 rad"},
        {"value": "0, 0, 1", "se": 0.02, "unit": ""},
        {"value": [0, 0, 1], "se": 0.02, "unit": "1"},
    ],
)
def test_a_direction_may_be_a_mapping(given: Any) -> None:
    assert stated("dead weight", {"direction": given})["direction"] == Stated((0.0, 0.0, 1.0), 0.02, "1")


@pytest.mark.parametrize(
    ("specimen", "properties", "words"),
    [
        ("gauge step", {"k": "3 N/m"}, "k: no property of a gauge step"),
        ("rigid block", {"height": "1 mm"}, "height: no property of a rigid block, which has none"),
        ("gauge step", {"height": "1 g"}, "height: is in kg, not in m"),
        ("gauge step", {"height": "1 mm ± 2 mbar"}, "height: its uncertainty is in Pa"),
        ("gauge step", {"height": "1 mm ± -2 µm"}, "height: its uncertainty"),
        ("gauge step", {"height": "-1 mm"}, "height: must be"),
        ("gauge step", {"height": "nan mm"}, "height: 'nan mm' does not read"),
        ("gauge step", {"height": float("inf")}, "height: is not finite"),
        ("gauge step", {"height": {"value": 1.0, "unit": "mm", "sd": 1}}, "height: sd is not understood"),
        ("gauge step", {"height": None}, "height: 'None' is no number"),
        ("dead weight", {"direction": "0, 0, -2"}, "direction: "),
        ("dead weight", {"direction": "0, 0.5, 0.5"}, "direction: is no unit vector"),
        ("dead weight", {"direction": "1"}, "direction: has 1 components"),
        ("reference spring", {"k": "400 furlongbananas"}, "k: 'furlongbananas' is not a unit"),
        ("reference spring", {"k": "600±1 % N/m"}, "k: put the unit before"),
        ("dead weight", {"mass": "50±0.1 % g"}, "mass: put the unit before"),
    ],
)
def test_faults_name_the_key(specimen: str, properties: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match="^" + words.replace("(", r"\(")):
        stated(specimen, properties)


def test_a_specimen_of_somebody_elses_keeps_what_it_states() -> None:
    known = stated("silicone 30A", {"shore": 30, "thickness": "5 ± 0.1 mm"})
    assert known["shore"] == Stated((30.0,), 0.0, "1")
    assert known["thickness"].scalar == pytest.approx(5e-3)
    check("silicone 30A", "cutometer")
    check("rigid block", "a rig of our own")


def test_the_instrument_must_fit() -> None:
    with pytest.raises(ValueError, match=r"specimen: a manometer is not for a microrobot, which has open air"):
        check("manometer", "microrobot")


def test_a_run_needs_the_numbers() -> None:
    with pytest.raises(ValueError, match="height: state it for a gauge step"):
        check_complete("gauge step", "cutometer", {})
    check_complete("reference membrane", "cutometer", {})
    check_complete("gauge step", "cutometer", stated("gauge step", {"height": "1 mm"}))


def test_assignments() -> None:
    assert assignments(["mass=20 g", "direction = 0,0,-1"]) == {"mass": "20 g", "direction": "0,0,-1"}
    for wrong, words in ((["mass"], "expected KEY=VALUE"), (["mass=1 g", "mass=2 g"], "given twice")):
        with pytest.raises(ValueError, match=words):
            assignments(wrong)


def test_an_exact_number_stands_without_an_error() -> None:
    assert str(Stated((0.01,), 0.0, "1")) == "0.01"
    assert str(Stated((0.4,), 0.02, "N")) == "0.4 ± 0.02 N"
    height = SPECIMENS["gauge step"].property("height")
    assert height.in_words(Stated((1e-3,), 0.0, "m")) == "height 1 mm"
    assert height.in_words(Stated((1e-3,), 2e-6, "m")) == "height 1 ± 0.002 mm"


def test_skin_takes_no_properties_and_a_reference_is_described_with_its_own() -> None:
    height = stated("gauge step", {"height": "1.000±0.002 mm"})
    assert described("gauge step", height) == "gauge step (height 1 ± 0.002 mm)"
    assert described("skin", {}) == "skin"
    check_complete("gauge step", "cutometer", height)
    with pytest.raises(ValueError, match="height: stated of skin; name the reference"):
        check_complete("skin", "cutometer", height)
