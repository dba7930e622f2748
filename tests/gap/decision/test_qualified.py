"""An earlier qualification in a diagnosis: what it narrows, what it makes improbable, and when it is not believed."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from acquire.qualifications import SCHEMA, SERIAL, Bound, Parameter, Qualification, dump
from gap import as_json, diagnose
from gap.decision.qualified import CHANGED, Qualified, inform, moved, read
from gap.design import simulated as own
from gap.effects.load import library
from gap.inference.evidence import Hypothesis
from gap.inference.least_squares import fit
from gap.null.suction import suction_problems
from gap.search.compare import compare
from sim_devices.effects import effects

LEGS = [own.step_hold(-20e3, 5.0, 3.0), own.step_hold(-10e3, 5.0, 3.0)]
TIME = Parameter(value=0.04, se=1e-4, unit="s", nominal=0.04, tolerance=0.004, passed=True)
LEAD = Parameter(value=0.0, se=1e-4, unit="s", nominal=0.0, tolerance=0.015, passed=True)  # below nought a valve's lag


def qualification(**other: object) -> Qualification:
    given = {
        "schema": SCHEMA, "instrument": "aspiration", "serial": "A1", "date": datetime(2025, 12, 1, tzinfo=UTC),
        "passed": True, "verdict": "none", "parameters": {"regulator_time": TIME, "regulator_lead": LEAD},
        "effects": {"regulator_lag": Bound(parameter="tau", value=0.005, unit="s")},
    }  # fmt: skip
    return Qualification(**{**given, **other})


def test_parameters_are_narrowed_and_a_change_is_told() -> None:
    slow = (effects("aspiration")["regulator_lag"], {"tau": 0.02})
    for acting, changed in (([], False), ([slow], True)):
        recordings = own.suction_session("aspiration", np.random.default_rng(2), acting, legs=LEGS)
        problems, _ = suction_problems(recordings, library("aspiration"))
        before = problems[0].prior_sd[0]
        known = Qualified(qualification(), "q.yaml")
        assert inform(problems, known) == ["regulator_time", "regulator_lead"]
        assert problems[0].prior_sd[0] < before
        told = moved({"pressure": problems[0]}, {"pressure": fit(problems[0])}, known)
        assert any(text.startswith("regulator_time was 40.0 ± 0.1 ms and is ") for text in told) == changed
        assert all(text.endswith(" ms") for text in told)


def test_an_effect_that_would_have_been_seen_must_have_come_since() -> None:
    slow = (effects("aspiration")["regulator_lag"], {"tau": 0.1})
    recordings = own.suction_session("aspiration", np.random.default_rng(2), [slow], legs=LEGS)
    problems, candidates = suction_problems(recordings, library("aspiration"))
    lag = next(c for c in candidates if c.key == "regulator_lag[form=0]")
    pressure = [p for p in problems if p.name == "pressure"]
    found = compare(pressure, [replace(lag, blocks=("pressure",))]).hypotheses[0]
    known = Qualified(qualification(), "q.yaml")
    assert known.nats(found, 0.01) == pytest.approx(np.log(CHANGED))
    assert known.changes(found) == ["regulator_lag has come since: its tau was below 5 ms"]
    assert Qualified(qualification(), "q.yaml", "expired").nats(found, 0.01) == 0.0
    assert known.nats(Hypothesis((), {}), 0.01) == 0.0
    said = {"effect": "regulator_lag", "class": ("regulator_lag", "latency"), "probability": 0.9}
    there = Qualified(qualification(findings=(said,)), "q.yaml")  # a finding of two: either is as probable
    expected = 0.45 * (1.0 - CHANGED)
    assert there.expected(found) == pytest.approx(expected)
    assert there.nats(found, 0.01) == pytest.approx(np.log(expected / (1.0 - expected) * 99.0))
    assert replace(there, reason="expired").expected(found) == 0.0


def test_another_serial_number_is_told_and_not_believed(tmp_path: Path) -> None:
    recordings = own.suction_session("aspiration", np.random.default_rng(2), legs=LEGS[:1])
    numbered = [replace(r, info=replace(r.info, calibration={SERIAL: {"value": "A2", "unit": ""}})) for r in recordings]
    (tmp_path / "q.yaml").write_text(dump(qualification()))
    assert read(tmp_path / "q.yaml", recordings).believed  # its day is within the qualification's
    assert read(tmp_path / "q.yaml", numbered).reason == "it is of serial number A1, not of A2"
    old = tmp_path / "old.yaml"
    old.write_text(dump(qualification(date=datetime(2020, 1, 1, tzinfo=UTC))))
    assert "expired" in read(old, recordings).reason


@pytest.mark.slow
def test_the_report_says_what_it_gained_or_why_it_is_not_believed(tmp_path: Path) -> None:
    recordings = own.suction_session("aspiration", np.random.default_rng(2), legs=LEGS)
    (tmp_path / "q.yaml").write_text(dump(qualification()))
    said = as_json(diagnose(recordings, quick=True, qualification=tmp_path / "q.yaml"))["qualification"]
    assert said["believed"]
    assert {"gained", "changed", "set_without", "file", "date"} <= said.keys()
    (tmp_path / "other.yaml").write_text(dump(qualification(instrument="cutometer")))
    report = as_json(diagnose(recordings, quick=True, qualification=tmp_path / "other.yaml"))
    assert not report["qualification"]["believed"]
    assert any("not believed: it is of a cutometer" in remark for remark in report["remarks"])
