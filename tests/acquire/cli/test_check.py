import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from acquire.cli.check import check

app = typer.Typer()
app.command()(check)
runner = CliRunner()


def test_says_duration_steps_and_limits() -> None:
    result = runner.invoke(app, ["fingertip-levels"])
    assert result.exit_code == 0
    assert "8 min 45 s" in result.stdout
    assert "-450 … 0 mbar, steps at once; allowed -500 … 0 mbar" in result.stdout


def test_json_is_si() -> None:
    result = runner.invoke(app, ["microrobot-face", "--json"])
    found = json.loads(result.stdout)
    assert found["duration"] == 480
    assert found["quantities"]["probe"]["high"] == pytest.approx(1.2e-3)
    assert found["quantities"]["probe"]["rate"] == pytest.approx(0.24e-3)


def test_a_fault_exits_2_with_file_and_line(tmp_path: Path) -> None:
    bad = tmp_path / "bad.yaml"
    bad.write_text(
        "schema: protocol/1\nname: x\ninstrument: cutometer\nsteps:\n"
        "  - {type: hold, suction: 900 mbar, duration: 1 s}\n"
    )
    result = runner.invoke(app, [str(bad)])
    assert result.exit_code == 2
    assert f"{bad}:5:5: steps[0]: pressure -900 mbar is outside" in result.stderr
    result = runner.invoke(app, [str(bad), "--json"])
    assert result.exit_code == 2
    assert json.loads(result.stdout)["problems"][0]["line"] == 5


@pytest.mark.parametrize("name", ["demo-cutometer", "demo-microrobot"])
def test_draws_a_preview(name: str, tmp_path: Path) -> None:
    picture = tmp_path / "preview.png"
    assert runner.invoke(app, [name, "--png", str(picture)]).exit_code == 0
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_lists_the_library_and_prints_the_schema() -> None:
    assert "demo-aspiration" in runner.invoke(app, []).stdout
    assert json.loads(runner.invoke(app, ["--schema"]).stdout)["title"] == "Protocol"


def test_a_station_may_allow_less(tmp_path: Path) -> None:
    station = tmp_path / "station.yaml"
    station.write_text(
        "schema: station/1\ninstruments:\n  cutometer:\n    simulated: {}\n"
        "    limits: {pressure: {low: -250 mbar, high: 0 mbar}}\n"
    )
    result = runner.invoke(app, ["demo-cutometer", "--station", str(station)])
    assert result.exit_code == 2
    assert "outside -250 mbar … 0 mbar (hardware ∩ station ∩ protocol limits)" in result.stderr
    missing = runner.invoke(app, ["demo-aspiration", "--station", str(station)])
    assert "has no aspiration" in str(missing.exception)


def test_limits_of_measured_channels_are_shown(tmp_path: Path) -> None:
    path = tmp_path / "gentle.yaml"
    head = "schema: protocol/1\nname: gentle\ninstrument: cutometer\nlimits: {apex_height: {high: 1.5 mm}}\n"
    path.write_text(f"{head}steps: [{{type: hold, suction: 100 mbar, duration: 1 s}}]\n")
    told = runner.invoke(app, [str(path)])
    assert "apex_height measured; allowed unbounded … 1.5 mm" in told.stdout


def test_a_rate_or_dwell_alone_of_a_measured_channel_is_shown(tmp_path: Path) -> None:
    path = tmp_path / "slow.yaml"
    limits = "limits: {apex_height: {rate: 2 mm/s, dwell: 20 s}}"
    head = f"schema: protocol/1\nname: slow\ninstrument: cutometer\n{limits}\n"
    path.write_text(f"{head}steps: [{{type: hold, suction: 100 mbar, duration: 1 s}}]\n")
    told = runner.invoke(app, [str(path)])
    assert "apex_height measured; allowed 2 mm/s, 20 s away from rest" in told.stdout
