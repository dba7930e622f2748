"""The command line's frame: commands, help, exit statuses."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from acquire.cli import app
from drivers.device import LinkLost
from protocols.errors import Problem, ProtocolError

COMMANDS = (
    "run",
    "check",
    "devices",
    "sim",
    "show",
    "export",
    "report",
    "import",
    "recover",
    "ls",
    "fit",
    "gui",
    "safe",
    "status",
    "gap",
)


def test_help_names_every_command_and_imports_nothing_heavy() -> None:
    code = (
        "import sys\nfrom acquire.cli.app import run\nstatus = run(['--help'])\n"
        "heavy = {'numpy', 'scipy', 'numba', 'h5py', 'matplotlib', 'pint', 'pydantic', 'yaml', 'PySide6'}\n"
        "print('heavy:', sorted(heavy & set(sys.modules)), 'status:', status)"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "heavy: [] status: 0" in out
    for command in COMMANDS:
        assert command in out


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run([command, "--help"]) == 0
    assert "Usage" in capsys.readouterr().out


@pytest.mark.parametrize("arguments", [["nope"], ["run"], ["run", "demo-cutometer", "--speed", "fast"], ["--nope"]])
def test_a_wrong_command_line_is_bad_input(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(arguments) == 2
    assert capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (ProtocolError((Problem("bad", "steps", 3, 1),), "p.yaml"), 2),
        (ValueError("bad"), 2),
        (FileNotFoundError("no file"), 2),
        (KeyError("no channel"), 2),
        (LinkLost("gone"), 3),
        (RuntimeError("a bug"), 1),
        (IndexError("a bug"), 1),
        (ZeroDivisionError("a bug"), 1),
    ],
)
def test_exit_status_of_an_exception(error: Exception, status: int) -> None:
    assert app.exit_status(error) == status


def test_a_fault_of_the_program_shows_where(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken() -> None:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(app, "COMMANDS", {"broken": ("acquire.cli.app", "DONE")})
    monkeypatch.setattr(app, "_load", lambda *_: broken)
    assert app.run(["broken"]) == app.BUG
    assert "Traceback" in capsys.readouterr().err


def test_the_version_is_told_without_a_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run(["--version"]) == app.DONE
    assert capsys.readouterr().out == f"skinrig {version('skinrig')}\n"


def test_ctrl_c_outside_a_run_is_an_abort(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(app, "application", interrupted)
    assert app.run(["ls"]) == app.ABORTED


def test_a_command_that_is_not_there_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(app, "COMMANDS", {"ghost": ("acquire.cli.ghost", "ghost"), "bad": ("tests.bad", "x")})
    assert app.run(["ghost", "a", "--b", "3"]) == 2
    assert "acquire ghost is not installed" in capsys.readouterr().err


def test_a_faulty_station_opens_no_window(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("PySide6")
    station = tmp_path / "station.yaml"
    station.write_text("schema: station/1\ninstruments:\n  cutometer: {adress: /dev/ttyUSB0}\n")
    for command in (["gui"], ["safe"], ["devices"], ["run", "demo-cutometer"]):
        assert app.run([*command, "--station", str(station)]) == 2
        assert "station.yaml:3:" in capsys.readouterr().err
    station.write_text("schema: station/1\ninstruments:\n  cutometer: {simulated: true}\n")
    assert app.run(["gui", "--station", str(station), "--notify", "station"]) == 2
    assert "has no 'notify'" in capsys.readouterr().err
