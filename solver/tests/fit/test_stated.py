"""What a recording says of its set-up reaches the model and the result; what it does not say is told."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from recovery import Recording

from skinrig_solver import models
from skinrig_solver.fit import FitResult, fit, read_spec
from skinrig_solver.fit.cases import given_by
from skinrig_solver.fit.stated import Setup, remarks, setup

STATION = (
    "instruments:\n  bench: {instrument: cutometer, calibration: {opening: {value: 6 mm, provenance: measured}}}\n"
)
CALIBRATION = {"opening": {"value": 4.0, "unit": "mm", "provenance": "measured", "note": ""}}


def known(model: str = "suction_yeoh_qlv", spec: dict[str, Any] | None = None, **about: Any) -> Setup:
    info = models()[model].info
    said = SimpleNamespace(**{"instrument": "cutometer", **about})
    return setup(said, info, given_by(read_spec({"model": model, **(spec or {})}), info))


def said(one: Setup) -> dict[str, tuple[float, str]]:
    return {fact.name: (fact.value, fact.source) for fact in one.facts}


def test_protocol_comes_before_calibration_and_calibration_before_station() -> None:
    everything = {"calibration": CALIBRATION, "station": STATION, "device": "bench"}
    by_protocol = known(protocol="setup: {opening: 8 mm, contact_force: 300 mN}", **everything)
    assert said(by_protocol) == {"opening": (8e-3, "protocol"), "contact_force": (0.3, "protocol")}
    assert by_protocol.geometry == {"opening_radius": 4e-3}
    assert by_protocol.parameters == {"spring_force": 0.3}
    assert said(known(**everything))["opening"] == (4e-3, "calibration, measured")
    assert said(known(station=STATION, device="bench"))["opening"] == (6e-3, "station")


def test_every_model_assumes_the_same_opening_and_warns() -> None:
    for model in ("suction_yeoh_qlv", "suction_rubin_bodner", "suction_fibres"):
        one = known(model)
        assert said(one)["opening"] == (2e-3, "assumed")
        assert one.geometry["opening_radius"] == 1e-3
        (told,) = remarks({"a": one, "b": one})
        assert told.startswith("a, b: nothing states the opening (2 mm is assumed) and contact force (")
    assert said(known(instrument="aspiration"))["opening"] == (8e-3, "assumed")
    sheet = known("sheet_ogden", instrument="microrobot", calibration={"hole_radius": {"value": "15 mm"}})
    assert (sheet.geometry, sheet.faults) == ({"hole_radius": 15e-3}, ())
    finger = known("finger_section", protocol="setup: {opening: 4 mm}")
    assert finger.geometry == {"opening": 2e-3}


def test_statements_that_disagree_are_named() -> None:
    one = known(protocol="setup: {opening: 2 mm, contact_force: 0.5 N}", calibration=CALIBRATION)
    (told,) = remarks({"a": one})
    assert told == "a: opening is 2 mm by its protocol, 4 mm by its calibration, measured: the first is used"
    spec = {"geometry": {"opening_radius": "3 mm"}, "parameters": {"G": "free", "spring_force": 0.2}}
    one = known(spec=spec, protocol="setup: {opening: 2 mm}")
    assert said(one) == {"opening": (6e-3, "specification"), "contact_force": (0.2, "specification")}
    assert "6 mm by its specification, 2 mm by its protocol" in remarks({"a": one})[0]


@pytest.mark.parametrize("wrong", ["2", "two", "[1, 2]", "3 kPa", "2 m"])
def test_a_statement_of_no_sense_is_told_and_left(wrong: str) -> None:
    one = known(protocol=f"setup: {{opening: {wrong}, contact_force: 0.5 N}}")
    assert said(one)["opening"] == (2e-3, "assumed")
    assert "its protocol's opening" in one.faults[0]
    assert "is not used" in remarks({"a": one})[0]
    assert known(protocol="a: [b\n").faults == ()


def test_a_force_that_the_fit_frees_is_not_held() -> None:
    one = known(spec={"parameters": {"spring_force": "free"}}, protocol="setup: {contact_force: 0.5 N}")
    assert one.parameters == {}
    assert said(one)["contact_force"][1] == "fitted"


def test_the_result_tells_geometry_and_its_source(
    dashpot: Any, record: Callable[..., Recording], named: Callable[..., None]
) -> None:
    named(dashpot.info)
    truth = {"a": 1e-4, "b": 2e-5, "c": 6e-5, "tau": 1.5}
    spec = {"parameters": {s: "free" for s in truth}}

    def go(**info: Any) -> FitResult:
        return fit([record(truth, **info)], spec, model=dashpot)

    stated = go(protocol="setup: {opening: 4 mm}")
    (recording,) = stated.as_dict()["recordings"]
    assert recording["setup"][0]["value"] == 4e-3
    assert recording["setup"][0]["source"] == "protocol"
    assert recording["geometry"] == {"opening_radius": 2e-3}
    assert "set-up of run-0: opening 4 mm (protocol)" in stated.in_words()
    assert not any("assumed" in w for w in stated.warnings)
    silent = go()
    assert "opening 2 mm (assumed)" in silent.in_words()
    assert any(w.startswith("run-0: nothing states the opening (2 mm is assumed)") for w in silent.warnings)
