"""`acquire gap` from the command line: diagnose, a user's effects and rigs, effects, plan, and the blind check."""

from __future__ import annotations

import io
import json
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from acquire.cli.app import run
from acquire.cli.stages import Stages
from acquire.recording import write_bundle
from gap.blind.lock import unseal
from gap.data.quantities import quantity
from gap.design import simulated
from gap.design.simulated_cases import detectability, make_own
from tests.conftest import Folder
from tests.standins import example

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
WARM_UP = ROOT / "examples/user_effect/pump_warm_up.py"


def called(capsys, *arguments: object) -> tuple[int, str, str]:
    status = run([str(a) for a in arguments])
    out, err = capsys.readouterr()
    return status, out, err


@pytest.fixture(scope="module")
def cold_session(tmp_path_factory) -> Path:
    """Bundles of the session that examples/user_effect makes."""
    folder = tmp_path_factory.mktemp("cold")
    for k, recording in enumerate(example("user_effect", "make_session").session()):
        write_bundle(recording, folder / f"r{k + 1:02d}")
    return folder


def test_an_effect_of_the_users_own_is_found(capsys, cold_session: Path, tmp_path: Path) -> None:
    out = tmp_path / "gap"
    status, text, _ = called(capsys, "gap", "diagnose", cold_session, "--effects", WARM_UP, "-o", out)
    assert status == 0
    report = json.loads((out / "gap.json").read_text())
    assert report["verdict"] == "effect"
    assert report["causes"][0]["class"] == ["pump_warm_up"]
    assert report["causes"][0]["parameters"]["warming"]["value"] == pytest.approx(40.0, rel=0.05)
    assert report["causes"][0]["shrink"]["waveform"] > 0.9
    assert report["sentences"][0] in text
    assert (out / "gap.html").stat().st_size > 50_000


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_is_told_the_stage_and_the_time_left(monkeypatch) -> None:
    now = [100.0]
    monkeypatch.setattr("acquire.cli.stages.time.monotonic", lambda: now[0])
    terminal, pipe = Terminal(), io.StringIO()
    with Stages(terminal) as stages, Stages(pipe) as silent:
        stages("reading", 0.0)
        now[0] = 110.0
        stages("screening 74 effects", 0.25)
        silent("screening 74 effects", 0.25)
        assert terminal.getvalue().endswith("10 s  screening 74 effects, about 30 s left")
    assert terminal.getvalue().endswith("\r\x1b[K")
    assert pipe.getvalue() == ""


def test_a_first_look_is_quicker_and_asks_for_no_experiment(capsys, cold_session: Path, tmp_path: Path) -> None:
    status, text, _ = called(capsys, "gap", "diagnose", cold_session, "--effects", WARM_UP, "--quick", "--json")
    report = json.loads(text)
    assert status == 0
    assert report["causes"][0]["class"] == ["pump_warm_up"]
    assert report["next_experiment"] == {}
    assert "--advise" in report["next_experiment_note"]


def test_the_simulation_alone_has_parameters_and_no_cause(capsys, cold_session: Path, tmp_path: Path) -> None:
    status, text, _ = called(capsys, "gap", "diagnose", cold_session, "--nominal", "-o", tmp_path)
    report = json.loads((tmp_path / "gap.json").read_text())
    assert status == 0
    assert (report["causes"], report["term"], report["undetectable_below"]) == ([], None, {})
    assert report["gap"]["after"] == report["gap"]["before"] > 1.0
    fitted = report["model"]["regulator_time"]
    assert 0.0 < fitted["se"] < fitted["value"]
    assert "No effect was fitted" in text
    page = (tmp_path / "gap.html").read_text(encoding="utf-8")
    assert "nearest candidates" not in page
    assert 'class="badge' not in page
    said = quantity(fitted["value"], fitted["unit"], fitted["se"])
    assert f"regulator time {said}" in " ".join(text.split())
    assert said in page


def test_without_it_the_cause_is_unknown(capsys, cold_session: Path) -> None:
    status, text, _ = called(capsys, "gap", "diagnose", cold_session, "--json")
    report = json.loads(text)
    assert status == 0
    assert report["verdict"] == "unknown"
    assert report["unknown_probability"] > 0.5


@pytest.mark.parametrize(
    ("text", "message"),
    [("x = 1", "defines no effect for instrument cutometer"), ("1 / 0", "fails on import: ZeroDivisionError")],
)
def test_a_file_of_effects_that_cannot_be_used_is_named(capsys, cold_session, tmp_path, text, message) -> None:
    path = tmp_path / "mine.py"
    path.write_text(text)
    status, _, err = called(capsys, "gap", "diagnose", cold_session, "--effects", path)
    assert status == 2
    assert f"{path}: " in err
    assert message in err


def test_a_folder_without_recordings_and_a_wrong_model_are_refused(capsys, cold_session, tmp_path) -> None:
    status, _, err = called(capsys, "gap", "diagnose", tmp_path)
    assert status == 2
    assert "no recording" in err
    status, _, err = called(capsys, "gap", "diagnose", cold_session, "--model", tmp_path / "none.py:Rig")
    assert status == 2
    assert "there is no file" in err


def test_a_rig_of_ones_own_from_its_files(capsys, stand_in: Folder, tmp_path: Path) -> None:
    tanks = example("cascaded_tanks").make_bundle("estimation", tmp_path / "tanks", stand_in("cascaded_tanks"))
    model = ROOT / "examples/cascaded_tanks/model.py:Tanks"
    status, text, _ = called(capsys, "gap", "diagnose", tanks, "--model", model, "--json")
    assert status == 0
    assert "saturation" in json.loads(text)["causes"][0]["class"]


def test_effects_are_listed(capsys) -> None:
    status, text, _ = called(capsys, "gap", "effects", "cutometer", "--json")
    listed = json.loads(text)
    assert status == 0
    assert len(listed) >= 12
    assert all(e["meaning"] and e["remedy"] and e["parameters"] for e in listed)
    assert called(capsys, "gap", "effects")[0] == 0


def test_the_plan_knows_what_a_protocol_cannot_tell_apart(capsys) -> None:
    status, text, _ = called(capsys, "gap", "plan", "demo-cutometer", "--json")
    plan = json.loads(text)
    assert status == 0
    assert plan["instrument"] == "cutometer"
    assert plan["detectability"]["regulator_lag"] > 5
    assert min(plan["detectability"].values()) < 3  # not everything shows in half a minute
    assert all(len(group) > 1 for group in plan["indistinguishable"])
    # One unknown scale of height and one unknown stiffness: no protocol splits them.
    assert {"sensor_gain", "scale_error"} & {*plan["invisible"], *(n for g in plan["indistinguishable"] for n in g)}


def test_a_plan_for_several_instruments_is_refused(capsys) -> None:
    status, _, err = called(capsys, "gap", "plan", "demo-cutometer", "demo-microrobot")
    assert status == 2
    assert "several instruments (cutometer, microrobot)" in err


def labels_of(key: Path, passphrase: str = "") -> list[dict]:
    return json.loads(unseal(key.read_bytes(), passphrase))["cases"]


def tells(path: Path, folder: Path, words: Collection[str]) -> bool:
    """Whether a file or its name within a folder has one of some words."""
    content = path.read_text() if path.is_file() else ""
    return any(w in content or w in str(path.relative_to(folder)) for w in words)


def sealed(capsys, tmp_path: Path) -> dict[Path, Path]:
    """Two cases of each of two tiers, made by the command: folders and their keys."""
    sets = {}
    for tier, seed in (("T0", 4), ("T2", 5)):
        out = tmp_path / tier
        arguments = ("--tier", tier, "--n", 2, "--seed", seed, "--instrument", "cutometer", "--passphrase", "x")
        assert called(capsys, "gap", "blind", "make", *arguments, "-o", out)[0] == 0
        sets[out] = tmp_path / f"{tier}-key" / "key.bin"
    return sets


def test_blind_check_end_to_end_without_leaking_labels(capsys, tmp_path: Path) -> None:
    """A few cases of two tiers: made, diagnosed, scored; nothing in a case folder names an effect."""
    sets, reports = sealed(capsys, tmp_path), tmp_path / "reports"
    for folder, key in sets.items():
        words = {e["concept"] for case in labels_of(key, "x") for e in case["effects"]} | {"effect", "tier"}
        assert not key.is_relative_to(folder)
        assert not [path for path in folder.rglob("*") if tells(path, folder, words)]
        status, _, err = called(capsys, "gap", "blind", "diagnose", folder, "-o", reports)
        assert status == 0
        assert "2/2" in err
    status, text, _ = called(capsys, "gap", "blind", "score", reports, *sets.values(), "--passphrase", "x", "--json")
    card = json.loads(text)
    assert status == 0
    assert (card["cases"], card["missing_reports"]) == (4, 0)
    assert {"top-1", "stage", "false alarms T0", "calibration error"} <= {f["name"] for f in card["figures"]}
    assert "target" in called(capsys, "gap", "blind", "score", reports, *sets.values(), "--passphrase", "x")[1]
    assert called(capsys, "gap", "blind", "score", reports, *sets.values(), "--passphrase", "y")[0] == 2


def test_own_cases_are_repeatable_and_their_detectability_counts(tmp_path: Path) -> None:
    keys = [make_own(4, 8, tmp_path / name, instruments=("cutometer",)) for name in ("a", "b")]
    first, second = (labels_of(k) for k in keys)
    assert first == second
    assert {case["tier"] for case in first} == {"T0"}
    for case in first:
        assert len(case["effects"]) <= 1
        assert case["delta"] == (case["effects"][0]["delta"] if case["effects"] else 0.0)
    with pytest.raises(FileExistsError):
        make_own(1, 8, tmp_path / "a")
    with pytest.raises(ValueError, match="unknown instrument 'scale'"):
        make_own(1, 8, tmp_path / "c", instruments=("scale",))


def test_detectability_is_nought_for_equal_sessions_and_free_for_the_nuisance() -> None:
    legs = [simulated.step_hold(-40e3, 8.0, 5.0), simulated.triangle(-40e3, 6.0, 1, 5.0)]
    recordings = simulated.suction_session("cutometer", np.random.default_rng(5), legs=legs)
    assert detectability((recordings, recordings)) == 0.0

    def scaled(recording, channel: str, factor: float):
        series = recording.streams[channel]
        return replace(
            recording, streams={**recording.streams, channel: replace(series, value=np.asarray(series.value) * factor)}
        )

    # Height gain is what stiffness can imitate, gauge gain is not.
    height = detectability((recordings, [scaled(r, "apex_height", 1.02) for r in recordings]))
    gauge = detectability((recordings, [scaled(r, "pressure", 1.02) for r in recordings]))
    assert height < gauge / 5


def test_a_case_that_cannot_be_read_gets_a_report_that_says_so(capsys, tmp_path: Path) -> None:
    case = tmp_path / "cases/case-1/r01"
    case.mkdir(parents=True)
    (case / "recording.yaml").write_text("schema: recording-bundle/1\ninstrument: cutometer\n")
    assert called(capsys, "gap", "blind", "diagnose", tmp_path / "cases", "-o", tmp_path / "out")[0] == 0
    report = json.loads((tmp_path / "out/case-1.json").read_text())
    assert report["verdict"] == "unknown"
    assert report["remarks"]


def test_the_effects_of_any_rig_are_listed(capsys) -> None:
    status, text, _ = called(capsys, "gap", "effects", "rig", "--json")
    assert status == 0
    listed = {e["name"]: e for e in json.loads(text)}
    assert listed["coulomb_friction"]["needs"] == "velocity"
    status, text, _ = called(capsys, "gap", "effects", "rig")
    assert status == 0
    assert "low_pass" in text
    assert "form" in text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is not JSON"),
        ('{"schema": "other/1"}', "is not of schema gap-report/1"),
        ('{"schema": "gap-report/1"}', "has no list of causes"),
        (
            '{"schema": "gap-report/1", "causes": [{"probability": NaN}]}',
            "causes[0].probability: must be a number from",
        ),
        ('{"schema": "gap-report/1", "causes": [{}, {"probability": -0.1}]}', "causes[1].probability: must be"),
        ('{"schema": "gap-report/1", "causes": [{"probability": 1.5}]}', "from 0 to 1, not 1.5"),
        ('{"schema": "gap-report/1", "causes": [], "none_probability": "1"}', "none_probability: must be"),
        ('{"schema": "gap-report/1", "causes": [3]}', "causes[0]: must have keys"),
        ('{"schema": "gap-report/1", "causes": []}', "does not say where its recordings are"),
        ('{"schema": "gap-report/1", "causes": [], "recording_files": ["gone"]}', "its recording gone is not there"),
    ],
)
def test_no_next_experiment_from_what_is_no_report(capsys, tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "gap.json"
    path.write_text(text)
    status, _, err = called(capsys, "gap", "next", path, "-o", tmp_path / "next")
    assert status == 2
    assert f"{path}: " in err
    assert message in err
    assert not (tmp_path / "next").exists()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--specimen", "banana"], "specimen 'banana' is none of a cutometer; there is skin, rigid block"),
        (["--specimen", "dead weight"], "specimen 'dead weight' is none of a cutometer"),
        ([], "is on other-1, and these recordings are "),
    ],
)
def test_no_next_experiment_on_what_does_not_go_together(
    capsys, cold_session: Path, tmp_path: Path, more: list[str], message: str
) -> None:
    path = tmp_path / "gap.json"
    report = {"schema": "gap-report/1", "causes": [], "recordings": [] if more else ["other-1"]}
    path.write_text(json.dumps(report))
    given = ["gap", "next", path, "-o", tmp_path / "next", "--recordings", cold_session, *more]
    status, _, err = called(capsys, *given)
    assert status == 2
    assert message in err
    assert not (tmp_path / "next").exists()
