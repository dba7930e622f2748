"""The loop on blind cases: one diagnosis of a session for all policies, reports by step, the benchmark's table."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from benchmarks.blind import loop as benchmark
from gap.blind.lock import seal
from gap.design.catalogue import catalogue
from gap.design.choice import Choice
from gap.loop import blind
from gap.loop.run import Step
from tests.gap.loop.test_loop import LEGS, LIMITS


def said(effect: str, probability: float) -> dict[str, Any]:
    """A report that claims an effect."""
    cause = {"effects": [effect], "class": [effect], "probability": probability}
    return {"schema": "gap-report/1", "verdict": "effect", "causes": [cause], "set": [effect, "outside"],
            "where": [{"stage": "sensor", "probability": probability}]}  # fmt: skip


@pytest.fixture
def cases(tmp_path: Path) -> Path:
    """Two cases, a visible one and a faint one, with their key; nothing is recorded in them."""

    def hidden(name: str, free: float) -> dict[str, Any]:
        effect = {"concept": "sensor_gain", "stage": "sensor", "delta": 9.0}
        return {"case": name, "tier": "T2", "instrument": "cutometer", "effects": [effect], "delta": 9.0,
                "delta_free": free, "reference": False}  # fmt: skip

    for name in ("case-a", "case-b"):
        (tmp_path / "T2" / name).mkdir(parents=True)
    plain = json.dumps({"cases": [hidden("case-a", 8.0), hidden("case-b", 0.2)]})
    (tmp_path / "T2-key").mkdir()
    (tmp_path / "T2-key" / "key.bin").write_bytes(seal(plain.encode(), ""))
    return tmp_path / "T2"


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[Mapping[str, Any] | None]:
    """Runs of the loop, by the first report that they were given; the answer turns right after one experiment."""
    given: list[Mapping[str, Any] | None] = []
    asked = next(e for e in catalogue("cutometer", LEGS, LIMITS) if e.specimen == "gauge step")

    def run(rig, choose, limits, work, most, quick, jobs, first):
        given.append(first)
        before = Step(first or said("leak", 0.6), Choice("cutometer", asked, "", 0.9, ()), (8.0, 2.0))
        return [before, Step(said("sensor_gain", 0.9), Choice("cutometer", None, "certain", 0.9, ()), (9.0, 0.0))]

    monkeypatch.setattr(blind, "run", run)
    recorded = SimpleNamespace(info=SimpleNamespace(instrument="cutometer"))
    monkeypatch.setattr(blind, "BlindRig", lambda *given: SimpleNamespace(session=[recorded]))
    return given


def test_policies_share_the_diagnosis_of_the_session_and_a_case_is_run_once(cases: Path, started) -> None:
    root = cases.parent
    for policy in ("ours", "random", "ours"):
        blind.loop_case(cases / "case-a", root / policy, policy, alone=root / "alone")
    assert [first is None for first in started] == [True, False]
    assert started[1] == said("leak", 0.6)
    hits = [blind.answered(root / "ours", k, blind.key_of(cases), only=["case-a"])[0].hit(1) for k in range(4)]
    assert hits == [False, True, True, True]  # it stopped after one: the last report is kept
    steps = json.loads((root / "ours" / "steps" / "case-a.json").read_text())
    assert [s["specimen"] for s in steps] == ["gauge step", ""]
    assert steps[0]["seconds"] == {"diagnosis": 8.0, "choice": 2.0}


def test_the_table_counts_experiments_minutes_and_seconds_of_visible_cases(cases: Path, started) -> None:
    assert benchmark.visible(blind.key_of(cases), 3.0, nothing=False) == ["case-a"]
    for policy in ("ours", "random"):
        blind.loop_case(cases / "case-a", cases.parent / f"T2-{policy}", policy)
    both = benchmark.finished(cases.parent, "T2", ["ours", "random"], ["case-a", "case-c"], 3)
    assert both == [("T2", "case-a")]
    assert benchmark.finished(cases.parent, "T2", ["ours", "fixed"], ["case-a"], 3) == []
    table = benchmark.table(cases.parent, "ours", both, 3)
    assert (table["n"], table["needed"]) == (1, 1.0)
    assert [row["right class first"] for row in table["after"]] == [0.0, 1.0, 1.0, 1.0]
    assert [row["CPU seconds of this step"] for row in table["after"]] == [10.0, 9.0, 0.0, 0.0]
    assert table["after"][0]["minutes of bench time so far"] == 0.0
    assert table["after"][3]["minutes of bench time so far"] == pytest.approx(1.8, abs=0.2)
    assert table["after"][1]["in the set"] == 1.0
    random = table | {"needed": 2.0}
    text = benchmark.as_markdown("one case", {"ours": table, "random": random})
    assert "That is 50 % of a random choice's" in text
    assert "| case-a | sensor_gain | 8.0 | no, yes, yes, yes | at rest on gauge step |" in text
