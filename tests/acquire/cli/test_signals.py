"""A person's signal in every phase of ``acquire run``: vented at the instrument, status 5, the recording kept."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from acquire.recording import open_recording
from acquire.recording.recovery import recover
from sim_devices.servers import BackDoor, serve

pytestmark = pytest.mark.real_time

ACQUIRE = [sys.executable, "-c", "from acquire.cli import main; main()"]
BRIEF = """\
schema: protocol/1
name: brief
instrument: cutometer
steps:
  - {type: hold, suction: 200 mbar, duration: 0.3 s}
"""


def eventually(condition: Callable[[], bool], timeout: float = 20.0) -> None:
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.005)


def start(tmp_path: Path, address: str) -> subprocess.Popen[str]:
    """``acquire run`` in a process of its own."""
    (tmp_path / "brief.yaml").write_text(BRIEF)
    (tmp_path / "station.yaml").write_text(
        "schema: station/1\ninstruments:\n  cutometer:\n"
        f"    {{address: '{address}', simulated: true, watchdog: 1 s, interlock: {{stale: 5 s}}}}\n"
    )
    command = [*ACQUIRE, "run", str(tmp_path / "brief.yaml"), "--station", str(tmp_path / "station.yaml")]
    return subprocess.Popen(
        [*command, "-o", str(tmp_path / "out")], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


@contextmanager
def host(tmp_path: Path, speed: float) -> Iterator[tuple[BackDoor, subprocess.Popen[str], Path]]:
    """The same on an instrument in this process, and where it records."""
    with serve("cutometer", "tcp", speed=speed) as server, start(tmp_path, server.entry.address) as process:
        try:
            yield server.back_door, process, tmp_path / "out"
        finally:
            process.kill()


def ended(process: subprocess.Popen[str], status: int) -> tuple[str, str]:
    out, err = process.communicate(timeout=30)
    assert process.returncode == status, err
    assert "Traceback" not in err
    return out.strip(), err


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_while_connecting(tmp_path: Path, name: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as nobody:  # takes the link and never answers
        nobody.settimeout(20)
        with start(tmp_path, f"socket://127.0.0.1:{nobody.getsockname()[1]}") as process:
            link, _ = nobody.accept()
            process.send_signal(getattr(signal, name))
            _, err = ended(process, 5)
            link.close()
    assert f"aborted by a person ({name})" in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_while_arming(tmp_path: Path, name: str) -> None:
    with host(tmp_path, 0.25) as (door, process, out):  # what has to be heard before arming takes a second
        eventually(lambda: bool(list(out.glob("*.journal"))))
        process.send_signal(getattr(signal, name))
        told, _ = ended(process, 5)
        assert open_recording(told).info.status == "aborted"
        assert door.wait_vented().state in ("safe", "idle")


def test_while_running_and_the_terminal_goes(tmp_path: Path) -> None:
    with host(tmp_path, 0.4) as (door, process, _):
        eventually(lambda: door.truth().signals.get("line_pressure", 0.0) < -5e3)
        assert process.stderr is not None
        process.stderr.close()  # nobody reads what it says any more: that alone ends nothing
        process.send_signal(signal.SIGHUP)
        door.wait_vented()
        told, _ = ended(process, 5)
        assert open_recording(told).info.status == "aborted"


def test_while_finalising_the_run_is_complete_already(tmp_path: Path) -> None:
    with host(tmp_path, 0.4) as (door, process, _):  # the tail of half a second takes 1.3 s
        eventually(lambda: door.truth().state == "running")
        eventually(lambda: door.truth().state == "safe")
        process.send_signal(signal.SIGTERM)
        process.send_signal(signal.SIGINT)
        told, _ = ended(process, 0)
        assert open_recording(told).info.status == "completed"
        door.wait_vented()


@pytest.mark.parametrize("phase", ["arming", "finalising"])
def test_killed_in_the_other_phases_the_next_run_starts(tmp_path: Path, phase: str) -> None:
    with host(tmp_path, 1.0) as (door, process, out):
        eventually(lambda: bool(list(out.glob("*.journal"))))
        if phase == "finalising":
            eventually(lambda: door.truth().state == "running")
            eventually(lambda: door.truth().state == "safe")
        process.kill()
        process.wait()
        door.wait_vented()
        args = process.args
        assert isinstance(args, list)
        again = subprocess.run([*args[:-1], str(out / "next.h5")], capture_output=True, text=True, timeout=60)
        assert again.returncode == 0, again.stderr
        assert open_recording(out / "next.h5").info.status == "completed"
        (journal,) = out.glob("*.journal")
        assert open_recording(recover(journal)).info.status == "recovered"


def test_a_reader_that_leaves_ends_nothing(tmp_path: Path) -> None:
    (tmp_path / "brief.yaml").write_text(BRIEF)
    command = [*ACQUIRE, "run", str(tmp_path / "brief.yaml"), "--sim", "--speed", "20", "-o", str(tmp_path / "a.h5")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        process.stderr.close()
        assert process.wait(30) == 0
    assert open_recording(tmp_path / "a.h5").info.status == "completed"


def test_before_anything_was_touched(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [*ACQUIRE, "run", "demo-cutometer", "--sim", "-o", str(tmp_path / "out")],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    with process:
        eventually(lambda: "signals" in threads(process.pid))
        process.send_signal(signal.SIGINT)
        ended(process, 5)
    assert not (tmp_path / "out").exists()


def threads(pid: int) -> str:
    """Whether the process listens for signals: Linux tells what it catches."""
    try:
        caught = next(x for x in Path(f"/proc/{pid}/status").read_text().splitlines() if x.startswith("SigCgt"))
    except (OSError, StopIteration):
        return ""
    return "signals" if int(caught.split()[1], 16) >> (signal.SIGTERM - 1) & 1 else ""
