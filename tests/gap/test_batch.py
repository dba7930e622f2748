"""Many cases at once: skin alone of a session with references, with a qualification by these or without."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from acquire.qualifications import load_qualification
from acquire.recording import write_bundle
from gap import batch
from gap.design import simulated as own
from protocols.specimens import stated
from tests.gap.qualify.test_qualify import qualification


@pytest.fixture
def cases(tmp_path: Path) -> Path:
    """A case of two recordings, a gauge step and skin."""
    step = own.step_hold(0.0, 1.0, 1.0)
    known = stated("gauge step", {"height": "1.000 mm"})
    legs = [own.Leg(step.quantity_tables, step.duration, "gauge step", known=known), own.step_hold(-20e3, 1.0, 1.0)]
    for k, r in enumerate(own.suction_session("cutometer", np.random.default_rng(1), legs=legs)):
        write_bundle(r, tmp_path / "cases" / "case-a" / f"r{k}")
    return tmp_path / "cases"


def test_skin_alone_is_diagnosed_with_or_without_a_qualification(
    cases: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[tuple[list[str], str]] = []

    def diagnose(recordings: list[Any], qualification: Path | None = None) -> dict[str, Any]:
        serial = load_qualification(qualification).serial if qualification else ""
        given.append(([r.info.specimen for r in recordings], serial))
        return {"verdict": "none"}

    def qualify(recordings: list[Any]) -> SimpleNamespace:
        assert "gauge step" in [r.info.specimen for r in recordings]
        return SimpleNamespace(qualification=qualification())

    monkeypatch.setattr(batch, "diagnose", diagnose)
    monkeypatch.setattr(batch, "as_json", dict)
    monkeypatch.setattr(batch, "qualify", qualify)
    for how in ("", *batch.QUALIFICATIONS):
        batch.diagnose_cases(cases, tmp_path / f"out-{how}", qualification=how)
        assert json.loads((tmp_path / f"out-{how}" / "case-a.json").read_text()) == {"verdict": "none"}
    assert given == [(["gauge step", "skin"], ""), (["skin"], "C7"), (["skin"], "")]
