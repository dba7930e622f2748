"""The closed loop: a simulated rig answers on the same person, the loop goes on until it stops, the page tells it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from acquire.cli.app import run
from acquire.cli.check import limits_of
from gap.design import simulated as own
from gap.design.catalogue import catalogue
from gap.design.choice import Choice
from gap.loop import run as looping
from gap.loop.page import write_page
from gap.loop.policies import POLICIES, policy_of
from gap.loop.rigs import SimulatedRig, drawn, hidden_in_words, named

LEGS = [own.step_hold(-30e3, 5.0, 3.0), own.triangle(-30e3, 5.0, 1, 3.0)]
LIMITS = limits_of("cutometer", None)


def report(probability: float) -> dict[str, object]:
    cause = {"effects": ["leak"], "class": ["leak", "gauge_gain"], "probability": probability}
    return {"schema": "gap-report/1", "verdict": "effect", "sentences": ["One."], "causes": [cause],
            "none_probability": 0.9 - probability, "outside_probability": 0.1}  # fmt: skip


def test_a_rig_answers_after_its_session_with_its_effect(tmp_path: Path) -> None:
    acting = named(["leak:shortfall=0.2"], "cutometer")
    rig = SimulatedRig("cutometer", acting, 3, LEGS)
    before = rig.session
    asked = next(e for e in catalogue("cutometer", LEGS, LIMITS) if e.specimen == "rigid block")
    done = rig.answer(asked, tmp_path / "one")
    assert (done.info.experiment, done.info.specimen) == (asked.id, "rigid block")
    assert float(done.streams["pressure"].time[0]) >= float(before[-1].streams["pressure"].time[-1]) + 20.0
    # The leak is there as well: the pressure falls a fifth short.
    assert float(np.min(done.streams["pressure"].value)) == pytest.approx(-24e3, rel=0.05)
    again = rig.answer(asked, tmp_path / "two")
    assert float(again.streams["pressure"].time[0]) > float(done.streams["pressure"].time[-1])


def test_the_loop_goes_on_until_it_stops_and_tells_what_it_believed(tmp_path: Path, monkeypatch) -> None:
    seen: list[list[str]] = []

    def diagnosed(recordings, quick, jobs, qualification):
        seen.append([r.info.specimen for r in recordings])
        return 0.3 * len(seen)

    monkeypatch.setattr(looping, "diagnose", diagnosed)
    monkeypatch.setattr(looping, "as_json", report)
    block = next(e for e in catalogue("cutometer", LEGS, LIMITS) if e.specimen == "rigid block")

    def policy(said, recordings, limits, k):
        return Choice("cutometer", block if k == 0 else None, "" if k == 0 else "leak is certain", 0.9, ())

    steps = looping.run(SimulatedRig("cutometer", [], 3, LEGS), policy, LIMITS, tmp_path, most=3)
    assert seen == [["skin", "skin"], ["skin", "skin", "rigid block"]]
    assert [s.beliefs[0] for s in steps] == [("none", pytest.approx(0.6)), ("leak, gauge_gain", pytest.approx(0.6))]
    text = looping.as_text(steps)
    assert "Stop: leak is certain." in text
    page = write_page(steps, tmp_path / "loop.html", "leak").read_text()
    assert "After 1 experiment " in page
    assert "leak, gauge gain" in page
    assert (tmp_path / "experiment-1" / "answer" / "recording.yaml").exists()
    assert (tmp_path / "report-1.json").exists()


@pytest.mark.parametrize("name", ["random", "fixed"])
def test_other_policies_keep_to_limits_and_specimens(name: str) -> None:
    session = SimulatedRig("cutometer", [], 3, LEGS).session
    chosen = [POLICIES[name](1, ["skin", "rigid block"])({}, session, LIMITS, k).experiment for k in range(4)]
    assert {e.specimen for e in chosen if e is not None} <= {"skin", "rigid block"}
    assert POLICIES[name](1, ["nothing"])({}, session, LIMITS, 0).experiment is None
    with pytest.raises(ValueError, match="unknown policy 'best'"):
        policy_of("best")


def test_effects_are_drawn_alike_for_a_seed_and_told() -> None:
    assert hidden_in_words(drawn("cutometer", 4)) == hidden_in_words(drawn("cutometer", 4))
    assert len({hidden_in_words(drawn("cutometer", k)) for k in range(6)}) > 3
    assert hidden_in_words(named(["none"], "cutometer")) == "nothing"


def test_one_experiment_splits_the_class_of_the_demonstration(tmp_path: Path) -> None:
    """Light that fades or a muscle that tightens: a drift of a gauge step was once taken for its noise."""
    asked = ["--specimen", "gauge step", "--specimen", "rigid block", "--quick", "--most", "1"]
    out = tmp_path / "loop"
    assert run(["gap", "loop", "cutometer", "--effect", "illumination_drift:change=0.5", *asked, "-o", str(out)]) == 0
    reports = [json.loads((out / f"report-{k}.json").read_text("utf-8")) for k in (0, 1)]
    before, after = (r["causes"][0]["class"] for r in reports)
    assert len(before) > 1
    assert after == ["illumination_drift"]
