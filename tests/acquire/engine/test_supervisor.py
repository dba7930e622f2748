"""The heartbeat's keeper: permissions come while everybody watched is heard, and only then."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator

import pytest

from acquire.supervisor import PATIENCE, PERIOD, Supervisor


@pytest.fixture
def keeper() -> Iterator[Supervisor]:
    keeper = Supervisor(("engine", "window"))
    yield keeper
    keeper.close()
    assert not keeper.alive


def tick(keeper: Supervisor, seconds: float, *names: str) -> int:
    """Permissions given while ``names`` are heard for ``seconds``."""
    before, end = keeper.permissions(), time.monotonic() + seconds
    while time.monotonic() < end:
        for name in names:
            keeper.tick(name)
        time.sleep(0.01)
    return keeper.permissions() - before


def permitted(keeper: Supervisor, *names: str) -> bool:
    """Whether permissions come while ``names`` are heard, sooner or later."""
    return any(tick(keeper, 0.2, *names) > 0 for _ in range(25))


def test_nothing_is_permitted_before_everybody_is_heard(keeper: Supervisor) -> None:
    assert tick(keeper, 0.3, "engine") == 0
    assert permitted(keeper, "engine", "window")


def test_silence_of_one_is_enough(keeper: Supervisor) -> None:
    assert permitted(keeper, "engine", "window")
    tick(keeper, PATIENCE + 2 * PERIOD, "engine")
    assert tick(keeper, 0.3, "engine") == 0
    assert permitted(keeper, "engine", "window")


def test_names_nobody_watches_do_not_count(keeper: Supervisor) -> None:
    assert tick(keeper, 0.3, "engine", "somebody") == 0
    with pytest.raises(ValueError, match="identifier"):
        Supervisor(("two words",))


def test_a_killed_keeper_permits_nothing_and_is_noticed(keeper: Supervisor) -> None:
    assert permitted(keeper, "engine", "window")
    os.kill(keeper.pid, signal.SIGKILL)
    deadline = time.monotonic() + 2
    while keeper.alive and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not keeper.alive
    assert tick(keeper, 0.2, "engine", "window") == 0


def test_ctrl_c_does_not_end_it(keeper: Supervisor) -> None:
    assert permitted(keeper, "engine", "window")
    os.kill(keeper.pid, signal.SIGINT)
    assert permitted(keeper, "engine", "window")


def test_it_ends_with_the_application() -> None:
    keeper = Supervisor()
    assert keeper._process.stdin is not None
    keeper._process.stdin.close()  # what the system does when the application dies
    assert keeper._process.wait(2) == 0
    keeper.close()
