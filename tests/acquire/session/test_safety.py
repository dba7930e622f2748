"""Whatever happens to the host, the simulated device ends vented and still: asserted at the device, not at the host."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from acquire.cli.app import run
from acquire.engine import Aborted, RunEngine, State
from acquire.recording import open_recording
from acquire.recording.recovery import recover
from acquire.session import Session
from acquire.station import load_station, simulated_station
from sim_devices.servers import BackDoor, serve

# The command by which each instrument acts on the skin, and how the truth shows it.
ACTING: dict[str, tuple[str, Callable[[BackDoor], bool]]] = {
    "cutometer": ("cutometer-instant-300", lambda door: door.truth().signals.get("line_pressure", 0.0) < -20e3),
    "aspiration": ("aspiration-instant-133", lambda door: door.truth().signals.get("line_pressure", 0.0) < -8e3),
    "microrobot": ("demo-microrobot", lambda door: abs(door.truth().signals.get("tip_x", 0.0)) > 0.4e-3),
}
SPEED = 5.0


def eventually(condition: Callable[[], bool], timeout: float = 10.0) -> None:
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.005)


@pytest.fixture(params=list(ACTING))
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    before = set(threading.enumerate())
    with Session(simulated_station(seed=1), speed=SPEED, out=tmp_path, frame_size=(160, 120)) as session:
        yield session
    left = {t for t in threading.enumerate() if t.is_alive()} - before
    assert not left, f"threads left behind: {left}"


@pytest.fixture
def acting(session: Session, kind: str) -> tuple[RunEngine, BackDoor]:
    """An engine in the middle of a run, with the device acting on the skin."""
    name, acts = ACTING[kind]
    engine, plan = session.prepare(name)
    engine.arm(plan)
    engine.start()
    door = session.back_door(kind)
    eventually(lambda: acts(door))
    return engine, door


def test_abort(acting: tuple[RunEngine, BackDoor]) -> None:
    engine, door = acting
    engine.abort()
    door.wait_vented()
    outcome = engine.wait(10)
    assert outcome.status is State.ABORTED
    assert outcome.recording is not None
    assert open_recording(outcome.recording).info.status == "aborted"


def test_a_pulled_cable(acting: tuple[RunEngine, BackDoor]) -> None:
    engine, door = acting
    door.unplug()
    door.wait_vented()
    outcome = engine.wait(10)
    assert outcome.trip is not None
    assert outcome.trip.code in ("link", "stale")
    assert outcome.recording is not None


def test_a_tripped_limit(acting: tuple[RunEngine, BackDoor], kind: str) -> None:
    engine, door = acting
    door.nan({"microrobot": "axis_position_1"}.get(kind, "pressure"))
    door.wait_vented()
    outcome = engine.wait(10)
    assert outcome.trip is not None
    assert outcome.trip.code == "nan"


def test_a_link_that_falls_silent(acting: tuple[RunEngine, BackDoor]) -> None:
    engine, door = acting
    door.stall(2.0)
    door.wait_vented()  # its watchdog: the host cannot reach it
    outcome = engine.wait(10)
    assert outcome.trip is not None


def test_a_frozen_engine(acting: tuple[RunEngine, BackDoor], monkeypatch: pytest.MonkeyPatch) -> None:
    engine, door = acting
    thaw = threading.Event()
    monkeypatch.setattr(engine, "_turn", lambda: thaw.wait(20))
    try:
        door.wait_vented()
    finally:
        thaw.set()
        monkeypatch.undo()
    outcome = engine.wait(10)
    assert outcome.trip is not None
    assert outcome.trip.code == "device"  # the device says that it stopped by itself


def test_a_dead_supervisor(session: Session, acting: tuple[RunEngine, BackDoor], kind: str) -> None:
    engine, door = acting
    os.kill(session.supervisor(kind).pid, signal.SIGKILL)
    door.wait_vented()
    outcome = engine.wait(10)
    assert outcome.trip is not None
    assert outcome.trip.code in ("supervisor", "device")


def test_a_window_that_no_longer_answers(tmp_path: Path, kind: str) -> None:
    name, acts = ACTING[kind]
    with Session(simulated_station(seed=1), speed=SPEED, out=tmp_path, watched=("window",), frame_size=(160, 120)) as s:
        alive = threading.Event()
        alive.set()

        def window() -> None:
            while alive.is_set():
                s.tick("window")
                time.sleep(0.02)

        thread = threading.Thread(target=window)
        thread.start()
        try:
            engine, plan = s.prepare(name)
            engine.arm(plan)
            engine.start()
            door = s.back_door(kind)
            eventually(lambda: acts(door))
        finally:
            alive.clear()
            thread.join()
        door.wait_vented()
        assert engine.wait(10).status is State.TRIPPED


@pytest.mark.parametrize("error", [RuntimeError("a bug"), KeyboardInterrupt()])
def test_an_exception_in_the_caller(session: Session, kind: str, error: BaseException) -> None:
    name, acts = ACTING[kind]

    def watch(progress: object) -> None:
        if acts(session.back_door(kind)):
            raise error

    with pytest.raises(type(error)):
        session.run(name, watch=watch)
    session.back_door(kind).wait_vented()
    outcome = session.engine(kind).wait(10)
    assert outcome.status is State.ABORTED
    assert outcome.recording is not None


@pytest.fixture
def elsewhere(tmp_path: Path) -> Iterator[tuple[BackDoor, subprocess.Popen[str], Path]]:
    """A host in a process of its own, sucking, while the instrument is another process's, as a real one is."""
    with serve("cutometer", "tcp", speed=SPEED) as server:
        station, out = tmp_path / "station.yaml", tmp_path / "out"
        entry = f"{{address: '{server.entry.address}', simulated: true}}"
        station.write_text(f"schema: station/1\ninstruments:\n  cutometer: {entry}\n")
        command = [sys.executable, "-c", "from acquire.cli import main; main()", "run", "cutometer-instant-300"]
        command += ["--station", str(station), "-o", str(out)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as host:
            try:
                eventually(lambda: ACTING["cutometer"][1](server.back_door), 30)
                time.sleep(0.3)
                yield server.back_door, host, out
            finally:
                host.kill()


def test_a_killed_host(elsewhere: tuple[BackDoor, subprocess.Popen[str], Path]) -> None:
    door, host, out = elsewhere
    host.kill()
    door.wait_vented()
    (journal,) = out.glob("*.journal")
    recording = open_recording(recover(journal))
    assert recording.info.status == "recovered"
    assert recording.streams["pressure"].value.min() < -20e3
    assert recording.setpoints["pressure"].value.min() == -30e3


def test_ctrl_c_on_the_command_line(elsewhere: tuple[BackDoor, subprocess.Popen[str], Path]) -> None:
    door, host, _ = elsewhere
    host.send_signal(signal.SIGINT)
    door.wait_vented()
    out, err = host.communicate(timeout=20)
    assert host.returncode == 5
    assert "aborted by a person (SIGINT)" in err
    assert open_recording(out.strip()).info.status == "aborted"


def test_a_stopped_host_trips_when_it_goes_on(elsewhere: tuple[BackDoor, subprocess.Popen[str], Path]) -> None:
    door, host, _ = elsewhere
    host.send_signal(signal.SIGSTOP)
    try:
        door.wait_vented()  # its watchdog: nobody beats
    finally:
        time.sleep(0.5)
        host.send_signal(signal.SIGCONT)
    out, err = host.communicate(timeout=20)
    assert host.returncode == 4, err
    recording = open_recording(out.strip())
    assert recording.info.status == "tripped"
    assert recording.info.trip_reason.partition(":")[0] in ("host", "device", "stale")
    door.wait_vented()


def again(process: subprocess.Popen[str], *options: str) -> subprocess.CompletedProcess[str]:
    """``acquire`` once more on the same station."""
    run = list(process.args)[:-2] if isinstance(process.args, list) else []
    station = run[run.index("--station") + 1]
    return subprocess.run([*run[:3], *options, "--station", station], capture_output=True, text=True, timeout=60)


def test_the_next_run_after_a_crash_starts_and_tells_what_it_found(
    elsewhere: tuple[BackDoor, subprocess.Popen[str], Path], tmp_path: Path
) -> None:
    door, host, out = elsewhere
    host.kill()
    door.wait_vented()
    eventually(lambda: door.truth().state == "fault")
    seen = again(host, "devices", "--connect")
    assert "fault: no heartbeat" in seen.stdout
    assert door.truth().state == "fault"  # looking changes nothing
    brief = tmp_path / "brief.yaml"
    step = "{type: hold, suction: 100 mbar, duration: 0.2 s}"
    brief.write_text(f"schema: protocol/1\nname: brief\ninstrument: cutometer\nsteps: [{step}]\n")
    next_one = again(host, "run", str(brief), "-o", str(out / "next.h5"))
    assert next_one.returncode == 0, next_one.stderr
    assert "was left in fault: no heartbeat" in next_one.stderr


def test_a_fault_of_the_instrument_s_own_waits_for_acquire_safe(
    elsewhere: tuple[BackDoor, subprocess.Popen[str], Path],
) -> None:
    door, host, out = elsewhere
    host.kill()
    door.wait_vented()
    with door._sim.lock:
        door._sim.firmware.trip("pressure -31500 is outside -30000 to 0")
    for _ in range(2):  # once more is no acknowledgement
        refused = again(host, "run", "cutometer-instant-300", "-o", str(out / "next.h5"))
        assert refused.returncode == 3
        assert "acquire safe" in refused.stderr
        assert door.truth().state == "fault"
    safe = again(host, "safe")
    assert safe.returncode == 0, safe.stderr
    assert "cutometer: safe; pressure" in safe.stdout
    assert door.truth().state == "safe"


def test_acquire_safe_says_so_when_it_cannot(elsewhere: tuple[BackDoor, subprocess.Popen[str], Path]) -> None:
    door, host, _ = elsewhere
    host.kill()
    door.wait_vented()
    door.unplug()
    lost = again(host, "safe")
    assert lost.returncode == 3
    assert "NOT SEEN TO BE SAFE: cutometer" in lost.stderr


@pytest.fixture
def vouched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[BackDoor, Path]]:
    """An instrument elsewhere that the station takes for a real one, and a runtime folder of this test's own."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    tmp_path.chmod(0o700)
    with serve("cutometer", "tcp", speed=SPEED) as server:
        station = tmp_path / "station.yaml"
        entry = f"{{address: '{server.entry.address}', i_have_verified_the_codec: true}}"
        station.write_text(f"schema: station/1\ninstruments:\n  cutometer: {entry}\n")
        yield server.back_door, station


def test_an_emergency_stop_outlives_its_program_until_a_person_acknowledges_it(
    vouched: tuple[BackDoor, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    door, station = vouched
    with Session(load_station(station), out=tmp_path) as session:
        engine, plan = session.prepare("cutometer-instant-300")
        engine.arm(plan)
        engine.start()
        session.stop("red button")
        assert engine.wait(10).status is State.TRIPPED
    door.wait_vented()
    for _ in range(2):  # once more is no acknowledgement
        assert run(["run", "demo-cutometer", "--station", str(station), "-o", str(tmp_path)]) == 3
        assert "red button" in capsys.readouterr().err
    assert run(["safe", "--station", str(station)]) == 0
    with Session(load_station(station), out=tmp_path) as session:
        engine = session.open("cutometer")
        session.stop("red button")
        eventually(lambda: engine.state is State.TRIPPED)
        engine.reset()  # a person's, in the same program
    with Session(load_station(station), out=tmp_path) as session:
        assert session.open("cutometer").state is State.READY


def test_an_instrument_that_does_not_answer_keeps_no_other_waiting(
    vouched: tuple[BackDoor, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    door, station = vouched
    with socket.create_server(("127.0.0.1", 0)) as mute:
        mute_at = f"{{instrument: cutometer, address: 'socket://127.0.0.1:{mute.getsockname()[1]}', simulated: true}}"
        station.write_text(station.read_text().replace("  cutometer", f"  mute: {mute_at}\n  cutometer"))
        with Session(load_station(station), out=tmp_path) as session, ThreadPoolExecutor(1) as hand:
            stuck = hand.submit(session.open, "mute")
            eventually(lambda: "mute" in session.engines and session.engine("mute").state is State.CONNECTING)
            assert session.open("cutometer").state is State.READY
            assert not stuck.done()
            session.engine("mute").abort()
            with pytest.raises(Aborted):
                stuck.result(10)
        assert run(["safe", "--station", str(station)]) == 3
        out, err = capsys.readouterr()
    assert "cutometer: safe" in out
    assert "NOT SEEN TO BE SAFE: mute:" in err
    assert door.truth().vented
