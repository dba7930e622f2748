"""The pytest plugin of a lab's own tests: fixtures that start simulated instruments (entry point ``pytest11``).

>>> def test_my_script(skinrig_session):                                       # doctest: +SKIP
...     outcome = skinrig_session().run("demo-cutometer")
...     assert outcome.recording is not None

Nothing of ours is imported before a fixture is used, so that the plugin costs other tests nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from acquire.session import Session
    from sim_devices.servers import Server


@pytest.fixture
def skinrig_session(tmp_path: Path) -> Iterator[Callable[..., Session]]:
    """Makes sessions on simulated instruments: ``skinrig_session(speed=50.0, tissue="forearm", effects=(), seed=0)``.

    Further arguments go to `acquire.session.Session`. Recordings go to ``tmp_path / "runs"``; everything is closed, and
    so vented, at the end of the test.
    """
    from acquire.session import Session
    from acquire.station import simulated_station

    with ExitStack() as stack:

        def make(
            speed: float = 50.0, tissue: str = "forearm", effects: tuple[str, ...] = (), seed: int = 0, **more: Any
        ) -> Session:
            station = more.pop("station", None) or simulated_station(tissue, effects, seed)
            return stack.enter_context(Session(station, speed=speed, **{"out": tmp_path / "runs", **more}))

        yield make


@pytest.fixture(scope="session")
def public_data() -> Callable[[str], Path]:
    """``public_data("emps")``: the checked folder of a public data set (`acquire.datasets`).

    The test is skipped, with the name of the data set and where it can be had, if this machine does not have it.
    """
    from acquire.datasets import DatasetMissing, folder

    def checked(name: str) -> Path:
        try:
            return folder(name)
        except DatasetMissing as error:
            pytest.skip(str(error))

    return checked


@pytest.fixture
def skinrig_instrument() -> Iterator[Callable[..., Server]]:
    """Switches on bare simulated instruments: ``skinrig_instrument("cutometer", link="tcp", speed=20.0)``.

    The arguments are those of `sim_devices.servers.serve`; the result's ``entry`` says where it is, its ``back_door``
    what is really so and what may go wrong.
    """
    from sim_devices.servers import serve

    with ExitStack() as stack:
        yield lambda *args, **more: stack.enter_context(serve(*args, **more))
