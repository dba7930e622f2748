"""``acquire qualify`` at the bench: nothing begins that a person has not asked for, and a signal ends it all."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from acquire.cli.app import ABORTED, BAD_INPUT, run
from acquire.cli.progress import Stop
from acquire.engine import Aborted
from acquire.recording import write_recording
from gap.qualify import bench
from tests.acquire.recording.samples import sample_recording

STEPS = [SimpleNamespace(name=f"s{k}", instruction="Mount it.") for k in (1, 2, 3)]


@pytest.fixture
def typing(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """The file that a person types into."""
    ours, theirs = os.pipe()
    with os.fdopen(ours) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        yield theirs
    os.close(theirs)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the steps that were begun; each takes its time at the end, when its run is over."""
    begun: list[str] = []

    def measure(session: object, name: str, steps: object, folder: Path, ask: bench.Ask, *more: object) -> None:
        for number, step in enumerate(STEPS, start=1):
            ask(number, step)  # type: ignore[arg-type]
            begun.append(step.name)
            if number == 2:
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(0.3)

    monkeypatch.setattr(bench, "measure", measure)
    return begun


@pytest.mark.skipif(os.name == "nt", reason="no signals to oneself")
def test_a_signal_between_two_steps_ends_the_qualification(asked: list[str], tmp_path: Path) -> None:
    """The run was over and its recording on its way to the disk: Ctrl-C was acknowledged, and suction came again."""
    assert run(["qualify", "cutometer", "--sim", "--yes", "-o", str(tmp_path)]) == ABORTED
    assert asked == ["s1", "s2"]


@pytest.mark.parametrize("answers", ["q\n", "no\n", "banana\nstop\n", ""])
def test_suction_begins_on_nothing_but_enter_or_yes(
    asked: list[str], typing: int, tmp_path: Path, answers: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    os.write(typing, f"\n{answers}".encode())
    if not answers:
        monkeypatch.setattr(Stop, "line", lambda self: (_ for _ in ()).throw(EOFError))
    monkeypatch.setattr(os, "kill", lambda *_: None)
    assert run(["qualify", "cutometer", "--sim", "-o", str(tmp_path)]) == ABORTED
    assert asked == (["s1"] if answers else [])


@pytest.mark.skipif(os.name == "nt", reason="no signals to oneself")
def test_a_signal_ends_the_wait_for_a_person(typing: int) -> None:
    with Stop() as stop:
        os.write(typing, b"yes \nand more\n")
        assert [stop.line(), stop.line()] == ["yes", "and more"]
        timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
        timer.start()
        with pytest.raises(Aborted, match="SIGINT"):
            stop.line()
        timer.join()


@pytest.mark.skipif(os.name == "nt", reason="no terminals")
def test_a_stray_enter_of_before_the_question_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pressed while a step ran, it would have begun the suction of the next."""
    ours, terminal = os.openpty()
    try:
        with os.fdopen(terminal) as stdin, Stop() as stop:
            monkeypatch.setattr("sys.stdin", stdin)
            os.write(ours, b"\n")
            timer = threading.Timer(0.3, os.write, (ours, b"q\n"))
            timer.start()
            assert stop.line() == "q"
            timer.join()
    finally:
        os.close(ours)


def test_recordings_of_another_instrument_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.h5"
    write_recording(sample_recording(100, frames=0), path)
    assert run(["qualify", "microrobot", "--recordings", str(path)]) == BAD_INPUT
    assert "not of microrobot" in capsys.readouterr().err


def test_a_validity_beyond_all_calendars_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["qualify", "cutometer", "--sim", "--days", "100000000", "-o", str(tmp_path)]) == BAD_INPUT
    assert "from 1 to 3650" in capsys.readouterr().err
