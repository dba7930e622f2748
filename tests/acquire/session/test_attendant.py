"""Other terminals see what runs; hooks hear of ends, trips and stalls."""

from __future__ import annotations

import http.server
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from acquire import attendant
from acquire.cli.app import run
from acquire.engine import State
from acquire.notify import Hook, Notifier, hooks
from acquire.recording import recover
from acquire.session import Session
from acquire.station import load_station, simulated_station
from drivers.claims import runtime_folder


@pytest.fixture(autouse=True)
def own_runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A runtime folder of this test's own: nobody else's sessions show."""
    (tmp_path / "runtime").mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))
    monkeypatch.setattr("acquire.attendant.PERIOD", 0.05)


@pytest.fixture
def told(tmp_path: Path) -> Callable[[], list[dict[str, Any]]]:
    return lambda: [json.loads(line) for line in (tmp_path / "told").read_text().splitlines()]


@pytest.fixture
def hook(tmp_path: Path) -> Hook:
    (tmp_path / "told").touch()
    program = f"import sys; open({str(tmp_path / 'told')!r}, 'a').write(sys.stdin.read() + chr(10))"
    return Hook(command=(sys.executable, "-c", program))


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def shown(capsys: pytest.CaptureFixture[str]) -> list[dict[str, Any]]:
    capsys.readouterr()
    assert run(["status", "--json"]) == 0
    return list(json.loads(capsys.readouterr().out)["sessions"])


def test_another_terminal_sees_the_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["status"]) == 0
    assert capsys.readouterr().out == "nothing runs\n"
    with Session(simulated_station(seed=1), speed=5, out=tmp_path) as session:
        engine, plan = session.prepare("demo-cutometer")
        engine.arm(plan)
        engine.start()
        until(lambda: shown(capsys)[0]["instruments"][0].get("elapsed", 0) > 0.5)
        (one,) = shown(capsys)
        (row,) = one["instruments"]
        assert (one["pid"], one["alive"], one["station"]) == (os.getpid(), True, "simulated bench")
        assert (row["name"], row["state"], row["run"]) == ("cutometer", "running", plan.info.id)
        assert run(["status"]) == 0
        assert "cutometer: running, demo-cutometer, segment" in capsys.readouterr().out
        (path,) = runtime_folder().glob("session-*")
        assert path.stat().st_mode & 0o077 == 0
    assert shown(capsys) == []


def test_a_program_that_was_killed_is_named_with_its_journal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = [sys.executable, "-c", "from acquire.cli import main; main()", "run", "demo-cutometer", "--sim"]
    with subprocess.Popen([*command, "-o", str(tmp_path / "out")], stderr=subprocess.PIPE) as process:
        until(lambda: any(r["state"] == "running" for s in shown(capsys) for r in s["instruments"]))
        process.kill()
    (one,) = shown(capsys)
    assert (one["pid"], one["alive"]) == (process.pid, False)
    (journal,) = (tmp_path / "out").glob("*.journal")
    assert run(["status"]) == 0
    words = capsys.readouterr().out
    assert "ENDED WITHOUT A WORD" in words
    assert f"acquire recover {journal}" in words
    assert run(["safe", "--sim"]) == 0  # who sees to its instruments takes it off the list
    assert shown(capsys) == []


def test_what_left_no_journal_is_forgotten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = [sys.executable, "-c", "from acquire.cli import main; main()", "run", "demo-cutometer", "--sim"]
    with subprocess.Popen([*command, "-o", "out"], stderr=subprocess.PIPE, cwd=tmp_path) as process:
        until(lambda: any(r["state"] == "running" for s in shown(capsys) for r in s["instruments"]))
        process.kill()
    (journal,) = (Path(row["journal"]) for one in shown(capsys) for row in one["instruments"])
    assert journal.is_absolute()  # it is found from wherever one asks
    recover(journal).unlink()
    assert shown(capsys)  # the journal is still there
    journal.unlink()
    assert shown(capsys) == []
    assert not list(runtime_folder().glob("session-*"))


def test_an_end_is_told_with_the_recording(
    tmp_path: Path, hook: Hook, told: Callable[[], list[dict[str, Any]]]
) -> None:
    with Session(simulated_station(seed=1), speed=50, out=tmp_path, notify=[hook]) as session:
        outcome = session.run("demo-cutometer")
    (fact,) = told()
    assert (fact["schema"], fact["event"], fact["state"]) == ("notify/1", "end", "completed")
    assert fact["recording"] == str(outcome.recording)
    assert "subject" not in fact


def test_trip_and_stall_are_told_while_it_goes_on(
    tmp_path: Path, hook: Hook, told: Callable[[], list[dict[str, Any]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(attendant, "PAUSED", 0.3)
    with Session(simulated_station(seed=1), speed=5, out=tmp_path, notify=[hook]) as session:
        engine, plan = session.prepare("demo-cutometer")
        engine.arm(plan)
        engine.start()
        until(lambda: engine.state is State.RUNNING)
        engine.pause()
        until(lambda: [f["event"] for f in told()] == ["stall"])
        session.stop("red button")
        until(lambda: len(told()) == 3)
        assert [f["event"] for f in told()] == ["stall", "trip", "end"]
        assert told()[1]["reason"] == "estop: red button"


@pytest.fixture
def web() -> Iterator[tuple[str, list[bytes]]]:
    heard: list[bytes] = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            heard.append(self.rfile.read(int(self.headers["Content-Length"])))
            self.send_response(204)
            self.end_headers()

        def log_message(self, *args: object) -> None:
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/hook", heard
        server.shutdown()
        thread.join()


def test_a_webhook_gets_it_and_a_broken_one_does_no_harm(
    web: tuple[str, list[bytes]], caplog: pytest.LogCaptureFixture
) -> None:
    url, heard = web
    broken = Hook(command=("/no/such/program",)), Hook(webhook="http://127.0.0.1:9/"), Hook(on=("trip",), webhook=url)
    notifier = Notifier([*broken, Hook(webhook=url)])
    notifier.tell("end", {"reason": "", "recording": Path("a.h5")})
    notifier.close()
    assert [json.loads(body)["recording"] for body in heard] == ["a.h5"]
    assert caplog.text.count("notify ") == 2


def test_a_station_s_own_hooks_are_used_on_demand_only() -> None:
    text = "schema: station/1\ninstruments: {cutometer: {simulated: true}}\nnotify:\n  - {command: [true]}\n"
    text = text.replace("[true]", "['true']")
    of_station = load_station(text).notify
    assert hooks((), of_station) == ()
    assert hooks(("station",), of_station) == of_station
    assert hooks(("say 'it is over'", "https://lab/x"), ()) == (
        Hook(command=("say", "it is over")),
        Hook(webhook="https://lab/x"),
    )
    with pytest.raises(ValueError, match="no 'notify'"):
        hooks(("station",), ())
    with pytest.raises(ValueError, match=r":4:.*begins with http"):
        load_station(text.replace("command: ['true']", "webhook: 'file:///etc/passwd'"))
