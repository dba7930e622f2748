"""The loop on blind cases: one diagnosis of a session for all policies, reports by step, the benchmark's table."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from acquire.recording import load
from acquire.recording.model import Recording
from benchmarks.blind import loop as benchmark
from gap.blind.lock import seal
from gap.design.catalogue import catalogue
from gap.design.choice import Choice
from gap.design.experiment import Experiment
from gap.loop import blind
from gap.loop import run as looping
from gap.loop.rigs import SimulatedRig
from gap.loop.run import Step
from tests.gap.loop.test_loop import LEGS, LIMITS


def said(effect: str, probability: float) -> dict[str, Any]:
    """A report that claims an effect."""
    cause = {"effects": [effect], "class": [effect], "probability": probability}
    return {"schema": "gap-report/1", "verdict": "effect", "sentences": ["One."], "causes": [cause],
            "set": [effect, "outside"], "where": [{"stage": "sensor", "probability": probability}]}  # fmt: skip


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
def diagnosed(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The recordings that each diagnosis was given; the cause turns right, and is claimed, with any reference."""
    given: list[list[str]] = []

    def diagnose(recordings, quick, jobs, qualification):
        given.append([r.info.specimen for r in recordings])
        return said("leak", 0.4) if set(given[-1]) == {"skin"} else said("sensor_gain", 0.7)

    class Rig(SimulatedRig):
        def __init__(self, case: Path, passphrase: str, skin_alone: bool) -> None:
            super().__init__("cutometer", [], 3, LEGS)

        def answer(self, experiment: Experiment, folder: Path) -> Recording:
            answer = folder / "answer"
            return load(answer) if answer.exists() else super().answer(experiment, folder)

    monkeypatch.setattr(looping, "diagnose", diagnose)
    monkeypatch.setattr(looping, "as_json", dict)
    monkeypatch.setattr(blind, "BlindRig", Rig)
    return given


def test_policies_share_reports_of_what_they_ask_for_alike(cases: Path, diagnosed: list[list[str]]) -> None:
    root = cases.parent
    for out in ("fixed", "again", "fixed"):
        blind.loop_case(cases / "case-a", root / out, "fixed", shared=root / "shared", until_claimed=True)
    assert diagnosed == [["skin", "skin"], ["skin", "skin", "rigid block"]]
    for out in ("fixed", "again"):
        after = [blind.answered(root / out, k, blind.key_of(cases), only=["case-a"])[0] for k in range(4)]
        assert [c.hit(1) for c in after] == [False, True, True, True]  # it stopped at the claim: the report is kept
        steps = json.loads((root / out / "steps" / "case-a.json").read_text())
        assert [s["specimen"] for s in steps] == ["rigid block", ""]
        assert "sensor_gain is claimed" in steps[1]["stopped"]
    blind.loop_case(cases / "case-a", root / "alone", "fixed", shared=root / "alone-shared")
    assert len(diagnosed) == 2 + 4  # nothing shared, and not certain: on to the third experiment


def test_chance_asks_each_case_for_other_experiments(
    cases: Path, diagnosed: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One seed drew the same three experiments for all cases: a fixed order by another name."""
    seeds, policy_of = [], blind.policy_of
    monkeypatch.setattr(
        blind, "policy_of", lambda name: lambda seed, at_hand: seeds.append(seed) or policy_of(name)(seed, at_hand)
    )
    for name in ("case-a", "case-b", "case-a"):
        blind.loop_case(cases / name, cases.parent / f"out-{len(seeds)}", "random", most=0, seed=7)
    assert seeds[0] == seeds[2] != seeds[1]


def test_only_cases_that_are_not_claimed_go_on(cases: Path, diagnosed: list[list[str]]) -> None:
    root = cases.parent
    work = [benchmark.Work(root, "T2", n, "", 3, 1, False, "") for n in ("case-a", "case-b")]
    assert benchmark.run_cases(work[:1]) == "T2 case-a"
    seen, left = benchmark.undecided(root, "T2", ["case-a", "case-b"], 5)
    assert ([c.name for c in seen], left) == (["case-a"], ["case-a"])
    claimed = root / "T2-alone" / "0" / "case-b.json"
    claimed.write_text(json.dumps(said("sensor_gain", 0.9)))
    seen, left = benchmark.undecided(root, "T2", ["case-b", "case-a"], 5)
    assert ([c.name for c in seen], left) == (["case-b", "case-a"], ["case-a"])
    assert benchmark.over_all(seen, {"after": [{"right class first": 0.0}], "n": 1}) == [0.5]


@pytest.fixture
def through(cases: Path, monkeypatch: pytest.MonkeyPatch) -> list[benchmark.Named]:
    """The visible case, which has been through two policies: a claim after one experiment."""
    asked = next(e for e in catalogue("cutometer", LEGS, LIMITS) if e.specimen == "gauge step")

    def run(*given: Any, **named: Any) -> list[Step]:
        before = Step(said("leak", 0.6), Choice("cutometer", asked, "", 0.9, ()), (8.0, 2.0))
        return [before, Step(said("sensor_gain", 0.9), Choice("cutometer", None, "certain", 0.9, ()), (9.0, 0.0))]

    monkeypatch.setattr(blind, "run", run)
    recorded = SimpleNamespace(info=SimpleNamespace(instrument="cutometer"))
    monkeypatch.setattr(blind, "BlindRig", lambda *given: SimpleNamespace(session=[recorded]))
    for policy in ("ours", "random"):
        blind.loop_case(cases / "case-a", cases.parent / f"T2-{policy}", policy)
    return benchmark.finished(cases.parent, "T2", ["ours", "random"], ["case-a", "case-c"], 3)


def test_the_table_is_of_visible_cases_that_every_policy_has_been_through(
    cases: Path, through: list[benchmark.Named]
) -> None:
    assert benchmark.visible(blind.key_of(cases), 3.0, nothing=False) == ["case-a"]
    assert through == [("T2", "case-a")]
    assert benchmark.finished(cases.parent, "T2", ["ours", "fixed"], ["case-a"], 3) == []


def test_the_table_counts_experiments_minutes_and_seconds(cases: Path, through: list[benchmark.Named]) -> None:
    table = benchmark.table(cases.parent, "ours", through, 3)
    assert (table["n"], table["needed"]) == (1, 1.0)
    assert [row["right class first"] for row in table["after"]] == [0.0, 1.0, 1.0, 1.0]
    assert [row["CPU seconds of this step"] for row in table["after"]] == [10.0, 9.0, 0.0, 0.0]
    assert table["after"][0]["minutes of bench time so far"] == 0.0
    assert table["after"][3]["minutes of bench time so far"] == pytest.approx(1.8, abs=0.2)
    assert table["after"][1]["in the set"] == 1.0


def test_the_table_in_words_tells_the_share_of_a_random_choice(cases: Path, through: list[benchmark.Named]) -> None:
    table = benchmark.table(cases.parent, "ours", through, 3)
    text = benchmark.as_markdown("one case", {"ours": table, "random": table | {"needed": 2.0}})
    assert "That is 50 % of a random choice's" in text
    assert "| case-a | sensor_gain | 8.0 | no, yes, yes, yes | at rest on gauge step |" in text
