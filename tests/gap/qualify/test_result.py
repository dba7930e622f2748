"""The result of a qualification in words: its validity, and what a finding leaves unexplained."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from types import SimpleNamespace

import pytest

from acquire.qualifications import SCHEMA, Parameter, Qualification
from gap.data.signatures import CERTAIN, HUM, Signature
from gap.qualify.judge import _beyond_tolerance, _sentences
from gap.report.pages import render

NOW = datetime(2026, 5, 1, tzinfo=UTC)


@pytest.mark.parametrize(
    ("passed", "days", "words"),
    [(True, 1, "valid until 2026-10-28"), (True, 200, "expired on 2026-10-28"), (False, 1, "")],
)
def test_an_instrument_that_did_not_pass_has_no_validity(passed: bool, days: int, words: str) -> None:
    given = {"schema": SCHEMA, "instrument": "cutometer", "date": NOW, "passed": passed, "verdict": "none"}
    q = Qualification(**given)
    assert q.validity(NOW + timedelta(days=days)) == words
    page = render("gap.qualify", "qualification.html", q=q, charts={}, known=[q], picture="")
    assert ("valid until" in page or "expired on" in page) == passed


def parameter(value: float, nominal: float, tolerance: float, like: str = "") -> Parameter:
    return Parameter(value=value, se=1e-4, unit="s", nominal=nominal, tolerance=tolerance, passed=False, like=like)


OFF = {
    "regulator_time": parameter(0.117, 0.04, 0.004, "regulator_lag"),
    "height_shift": parameter(0.03, 0.0, 0.01, "desynchronisation"),
}


def test_what_the_finding_explains_is_told_apart_from_what_it_leaves() -> None:
    beside = {"pressure": {"regulator_time": (0.116, "s")}, "reference": {"height_shift": (0.002, "s")}}
    problems = {b: SimpleNamespace(quantities=lambda nuisance: nuisance) for b in beside}
    fits = {b: SimpleNamespace(nuisance=values) for b, values in beside.items()}
    d = SimpleNamespace(problems=problems, best=SimpleNamespace(fits=fits))
    said = _beyond_tolerance(d, "rim_friction", OFF, full=False)  # type: ignore[arg-type]
    assert "regulator_time (regulator_lag would look so) is beyond its tolerance beside rim_friction, too" in said[0]
    assert said[1] == "Not passed: height_shift is beyond its tolerance, which rim_friction explains."
    assert "More than rim_friction is off: it does not explain regulator_time." in said[2]
    assert "--full" in said[2]
    assert "--full" not in _beyond_tolerance(d, "rim_friction", OFF, full=True)[2]  # type: ignore[arg-type]
    alone = _beyond_tolerance(d, "", OFF, full=False)  # type: ignore[arg-type]
    assert alone[1] == "Not passed: height_shift (desynchronisation would look so) is beyond its tolerance."
    assert len(alone) == 2


def test_a_line_that_nobody_explains_is_named() -> None:
    hum = Signature(HUM, "force_x", CERTAIN, "force_x has a line at 50.0 Hz")
    d = SimpleNamespace(verdict=SimpleNamespace(verdict="unknown"), signatures=(hum,))
    (said,) = _sentences(d, [], {}, [], full=False)  # type: ignore[arg-type]
    assert said.startswith("Not passed")
    assert "a line at 50.0 Hz" in said
