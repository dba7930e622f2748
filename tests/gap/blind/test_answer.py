"""Answers of a hidden rig: experiments done on the same person and instrument, and what the rig refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from gap.blind import Refused, make, perform
from gap.blind.specimens import ROBOT, SUCTION

STEP = "t,pressure\n0,0\n1,0\n1,-20000\n6,-20000\n6,0\n9,0\n"
MOVES = "t,x,y,z\n0,0,0,0\n1,0,0,0\n3,0.001,0,0\n5,0,0,0\n7,0,0.0008,0\n9,0,0,0\n10,0,0,0\n"


def asked(folder: Path, specimen: str, table: str, **more: object) -> Path:
    folder.mkdir(exist_ok=True)
    said = {"schema": "gap-experiment/1", "id": "an-id", "specimen": specimen, "rest_before": 60.0} | more
    (folder / "experiment.yaml").write_text(yaml.safe_dump(said))
    (folder / "setpoints.csv").write_text(table)
    return folder


@pytest.fixture(scope="module")
def cases(tmp_path_factory) -> dict[str, Path]:
    """A case of each instrument without references."""
    root = tmp_path_factory.mktemp("blind")
    made = {}
    for instrument in ("cutometer", "microrobot"):
        make("T2", 1, 3, root / instrument, [instrument], references="none", style="dense")
        made[instrument] = next(p for p in (root / instrument).iterdir() if p.is_dir())
    return made


def channel(bundle: Path, name: str, unit: float) -> np.ndarray:
    said = yaml.safe_load((bundle / "recording.yaml").read_text())
    table = np.genfromtxt(bundle / "data.csv", delimiter=",", names=True)
    return table[said["channels"][name]["column"]] * unit


def last(bundle: Path) -> float:
    return float(np.genfromtxt(bundle / "data.csv", delimiter=",", names=True)["t"][-1])


def first(bundle: Path) -> float:
    return float(np.genfromtxt(bundle / "data.csv", delimiter=",", names=True)["t"][0])


def test_a_case_answers_on_skin_and_on_every_reference_in_turn(cases, tmp_path: Path) -> None:
    case = cases["cutometer"]
    assert all("skin" in (p / "recording.yaml").read_text() for p in case.iterdir())
    before = max(last(p) for p in case.iterdir())
    skin = perform(case, asked(tmp_path / "e0", "skin", STEP), tmp_path / "skin")
    said = yaml.safe_load((skin / "recording.yaml").read_text())
    assert (said["experiment"], said["specimen"]) == ("an-id", "skin")
    assert first(skin) >= before + 59.0
    assert channel(skin, "apex_height", 1e-3).max() > 2e-5
    end = last(skin)
    for k, specimen in enumerate(SUCTION):
        table = "t,pressure\n0,0\n10,0\n" if specimen == "gauge step" else STEP
        got = perform(case, asked(tmp_path / f"e{k + 1}", specimen, table), tmp_path / specimen)
        assert first(got) > end
        end = last(got)
        height = channel(got, "apex_height", 1e-3)
        if specimen == "gauge step":
            said = yaml.safe_load((got / "recording.yaml").read_text())
            assert said["specimen_properties"]["height"] == {"value": 0.3e-3, "se": 2e-6, "unit": "m"}
            assert height[-100:].mean() == pytest.approx(0.3e-3, rel=0.5)
        if specimen == "manometer":
            assert channel(got, "pressure_reference", 100.0).min() == pytest.approx(-20000, rel=0.2)


def test_a_robot_answers_in_several_directions_on_every_reference(cases, tmp_path: Path) -> None:
    case = cases["microrobot"]
    for k, specimen in enumerate(ROBOT):
        table = "t,x,y,z\n0,0,0,0\n8,0,0,0\n" if specimen == "dead weight" else MOVES
        got = perform(case, asked(tmp_path / f"e{k}", specimen, table), tmp_path / specimen)
        force = np.stack([channel(got, f"force_{a}", 1.0) for a in "xyz"], axis=1)
        if specimen == "reference spring":
            x, y = (channel(got, f"probe_{a}", 1e-3) for a in "xy")
            assert (x.max(), y.max()) == (pytest.approx(1e-3, rel=0.3), pytest.approx(0.8e-3, rel=0.3))
            assert force[np.argmax(x), 0] == pytest.approx(-400.0 * x.max(), rel=0.4)
            command = np.genfromtxt(got / "command.csv", delimiter=",", names=True)
            assert command["probe_y"].max() == pytest.approx(0.8)
        if specimen == "dead weight":
            assert force[-200:, 2].mean() == pytest.approx(-0.02 * 9.80665, rel=0.5)


@pytest.mark.parametrize(
    ("specimen", "table", "more", "message"),
    [
        ("silicone", STEP, {}, "this rig has no 'silicone'"),
        ("skin", STEP.replace("-20000", "-90000"), {}, "is beyond 50000"),
        ("skin", STEP.replace("-20000", "20000"), {}, "is beyond"),
        ("skin", STEP.replace("9,0", "5,0"), {}, "times must not fall"),
        ("skin", STEP.replace("9,0", "9999,0"), {}, "be at most 600 s"),
        ("skin", MOVES, {}, "needs the columns t, pressure"),
        ("skin", "t,pressure\n0,x\n", {}, "is no experiment"),
        ("skin", STEP, {"instrument": "microrobot"}, "is for the microrobot"),
        ("skin", STEP, {"schema": "other"}, "is no experiment of schema"),
    ],
)
def test_what_the_rig_cannot_do_is_refused(cases, tmp_path: Path, specimen, table, more, message) -> None:
    with pytest.raises(Refused, match=message):
        perform(cases["cutometer"], asked(tmp_path / "e", specimen, table, **more), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_experiment_that_says_stop_is_told_as_such(cases, tmp_path: Path) -> None:
    said = asked(tmp_path / "nx", "", "", id="", stop=True, reason="rim friction is certain")
    (said / "setpoints.csv").unlink()
    with pytest.raises(Refused, match="nx says to stop: there is nothing to measure: rim friction is certain"):
        perform(cases["cutometer"], said, tmp_path / "out")
