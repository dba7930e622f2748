"""``acquire run``, ``devices`` and ``sim`` as a person or a script calls them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from acquire.cli.app import run
from acquire.cli.progress import Reporter, in_words
from acquire.engine import Progress, State
from acquire.recording import open_recording
from sim_devices.servers import serve

pytestmark = pytest.mark.real_time

BRIEF = """\
schema: protocol/1
name: brief
instrument: cutometer
steps:
  - {type: hold, suction: 200 mbar, duration: 1 s}
  - {type: wait, duration: 1 s}
"""


@pytest.fixture
def brief(tmp_path: Path) -> str:
    path = tmp_path / "brief.yaml"
    path.write_text(BRIEF)
    return str(path)


def test_a_run_leaves_a_recording_that_tells_everything(
    brief: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--sim", "--speed", "50", "--subject", "P07", "--site", "cheek", "--repeat", "2", "--operator", "kim"]
    options += ["--tissue", "cheek", "--seed", "5", "--effect", "gauge_gain:error=0.05", "--notes", "warm", "--json"]
    options += ["--consent", "C12"]
    assert run(["run", brief, *options, "-o", str(tmp_path / "out")]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["status"], told["lost_samples"], told["instrument"]) == ("completed", 0, "cutometer")
    recording = open_recording(told["recording"])
    info = recording.info
    assert info.consent == "C12"
    assert (info.subject, info.site, info.repeat, info.operator, info.notes) == ("P07", "cheek", 2, "kim", "warm")
    assert info.protocol == BRIEF
    assert info.protocol_name == "brief"
    assert {"gauge_gain:error=0.05", "tissue: cheek", "seed: 5"} <= {
        line.strip().removeprefix("- ") for line in info.station.splitlines()
    }
    assert info.limits["pressure"] == (-50e3, 0.0)
    assert "skinrig" in info.versions
    assert set(recording.streams) == {"pressure", "apex_height"}


def test_a_file_name_may_be_given(brief: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "mine.h5"
    assert run(["run", brief, "--sim", "--speed", "100", "-o", str(out)]) == 0
    assert capsys.readouterr().out.strip() == str(out)
    assert run(["run", brief, "--sim", "--speed", "100", "-o", str(out)]) == 2
    assert "not overwritten" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["brief"], "say --sim"),
        (["no-such-protocol", "--sim"], "no-such-protocol: no such file"),
        (["brief", "--sim", "--tissue", "steel"], "steel"),
        (["brief", "--sim", "--effect", "gremlins"], "gremlins"),
        (["brief", "--sim", "--effect", "leak:colour=3"], "colour"),
        (["brief", "--sim", "--specimen", "jelly"], "jelly"),
        (["brief", "--sim", "--speed", "-1"], "--speed"),
        (["brief", "--sim", "--instrument", "toaster"], "toaster"),
        (["brief", "--sim", "--instrument", "microrobot"], "is for a cutometer"),
        (["brief", "--station", "nowhere.yaml"], "nowhere.yaml"),
    ],
)
def test_bad_input_is_refused_in_words(
    options: list[str], message: str, brief: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = [brief if o == "brief" else o for o in options]
    assert run(["run", *options, "-o", str(tmp_path / "out")]) == 2
    err = capsys.readouterr().err
    assert message in err
    assert "Traceback" not in err
    assert not (tmp_path / "out").exists()


def test_subject_and_station_limits_forbid_what_they_forbid(
    brief: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    station = tmp_path / "station.yaml"
    station.write_text(
        "schema: station/1\ninstruments:\n  cutometer:\n    simulated: true\n    limits: {pressure: {low: -450 mbar}}\n"
        "subjects:\n  P07: {pressure: {low: -150 mbar}}\n"
    )
    where = ["--station", str(station), "--speed", "100", "-o", str(tmp_path / "out")]
    assert run(["run", brief, *where, "--subject", "P08"]) == 0
    assert run(["run", brief, *where, "--subject", "P07"]) == 2
    err = capsys.readouterr().err
    assert "brief.yaml:5" in err
    assert "outside -150 mbar" in err
    assert "subject P07" in err


def test_a_real_port_with_an_unverified_dialect_is_refused(
    brief: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    station = tmp_path / "station.yaml"
    station.write_text("schema: station/1\ninstruments:\n  cutometer: {address: /dev/ttyS99}\n")
    assert run(["run", brief, "--station", str(station), "-o", str(tmp_path)]) == 3
    assert "i_have_verified_the_codec" in capsys.readouterr().err
    assert run(["run", brief, "--station", str(station), "--sim", "--speed", "100", "-o", str(tmp_path)]) == 0


def test_nobody_there_is_a_device_error(brief: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    station = tmp_path / "station.yaml"
    address = "'socket://127.0.0.1:9'"
    station.write_text(f"schema: station/1\ninstruments:\n  cutometer: {{address: {address}, simulated: true}}\n")
    assert run(["run", brief, "--station", str(station), "-o", str(tmp_path)]) == 3
    assert "127.0.0.1:9" in capsys.readouterr().err


def test_an_instrument_that_another_program_drives_is_refused_by_name(
    brief: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with serve("cutometer", "tcp") as server:
        first = server.open_rig().device
        first.connect()
        station = tmp_path / "station.yaml"
        station.write_text(
            f"schema: station/1\ninstruments:\n  cutometer: {{address: '{server.entry.address}', simulated: true}}\n"
        )
        for command in (["run", brief, "-o", str(tmp_path / "out")], ["safe"]):
            assert run([*command, "--station", str(station)]) == 3
            said = "".join(capsys.readouterr())
            assert f"(process {os.getpid()}, since" in said
            assert "drives this instrument" in said
        first.make_safe()  # undisturbed
        first.close()


def test_a_trip_has_its_own_exit_status(brief: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    station = tmp_path / "station.yaml"
    station.write_text(
        "schema: station/1\ninstruments:\n  cutometer:\n    simulated: true\n"
        "    interlock: {tracking: {pressure: {error: 5 mbar, duration: 20 ms}}}\n"
    )
    assert run(["run", brief, "--station", str(station), "--speed", "2", "--json", "-o", str(tmp_path)]) == 4
    told = json.loads(capsys.readouterr().out)
    assert told["status"] == "tripped"
    assert "tracking" in told["reason"]
    assert open_recording(told["recording"]).info.status == "tripped"


def test_devices_lists_drivers_and_who_answers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["devices", "--json"]) == 0
    drivers = {row["name"]: row for row in json.loads(capsys.readouterr().out)["acquire.instruments"]}
    assert set(drivers) >= {"cutometer", "aspiration", "microrobot"}
    assert not any(row["error"] for row in drivers.values())
    station = tmp_path / "station.yaml"
    station.write_text(
        "schema: station/1\ninstruments:\n  cutometer: {simulated: true}\n"
        "  far: {instrument: microrobot, address: 'socket://127.0.0.1:9', simulated: true}\n"
    )
    assert run(["devices", "--station", str(station), "--connect", "--json"]) == 0
    near, far = json.loads(capsys.readouterr().out)["station"]
    assert "MPA 580" in near["answer"]
    assert "ERROR" in far["answer"]


def test_a_served_instrument_is_reached_through_the_station_it_prints(
    brief: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = [sys.executable, "-c", "from acquire.cli import main; main()", "sim", "cutometer", "--speed", "50"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            text = ""
            while not text.endswith("simulated: true\n"):
                text += server.stdout.readline()
            station = tmp_path / "station.yaml"
            station.write_text(text)
            assert run(["run", brief, "--station", str(station), "-o", str(tmp_path / "a.h5")]) == 0
            assert run(["run", brief, "--station", str(station), "-o", str(tmp_path / "b.h5")]) == 0
            server.send_signal(signal.SIGTERM)
            assert server.wait(10) == 0
        finally:
            server.kill()
    assert len(capsys.readouterr().out.splitlines()) == 2


def test_progress_in_words(capsys: pytest.CaptureFixture[str]) -> None:
    progress = Progress(State.RUNNING, 2, 8, "hold", "1", {"level": "300 mbar"}, 3.0, 29.0)
    assert in_words(progress) == "running, segment 3/8 hold, level 300 mbar, 3.0 of 29.0 s"
    with Reporter("demo", 29.0) as reporter:
        reporter.update(progress)
        reporter.update(progress)
    assert capsys.readouterr().err == "demo: running, segment 3/8 hold, level 300 mbar, 3.0 of 29.0 s\n"


@pytest.mark.parametrize("name", ["stdout", "stderr"])
def test_a_run_whose_reader_closed_a_stream_is_a_run(
    brief: str, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, name, None)  # as Python has it after ``2>&-``
    status = run(["run", brief, "--sim", "--speed", "50", "-o", str(tmp_path / "a.h5")])
    getattr(sys, name).close()  # which was opened in its place
    assert status == 0
    assert (tmp_path / "a.h5").exists()


def test_a_file_is_no_folder_for_recordings(brief: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    assert run(["run", brief, "--sim", "-o", str(tmp_path / "notes.txt")]) == 2
    assert "notes.txt is a file: name a folder" in capsys.readouterr().err
