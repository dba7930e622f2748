"""Public recordings where this machine has them, their stand-ins everywhere, and the tests judged by the clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.standins import write

Folder = Callable[[str], Path]

#: Folders whose tests drive byte-level instruments with watchdogs, or windows; elsewhere a file says so by its mark.
REAL_TIME = ("acquire/gui", "acquire/session", "conformance", "sim_devices/servers")


@pytest.hookimpl(tryfirst=True)  # ahead of the hook of xdist that reads the groups
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of `REAL_TIME`, and name the groups that share a worker of pytest-xdist (``--dist loadgroup``).

    A machine that stands still for a quarter of a second trips their watchdogs, so these tests, and no others, may
    fail once: they are run again, and the report says so. They follow one another in one worker, as two engines on one
    processor starve each other. Every other file is a group of its own, since its tests share fixtures.
    """
    root = Path(__file__).parent
    for item in items:
        place = item.path.relative_to(root).as_posix()
        if place.startswith(REAL_TIME):
            item.add_marker("real_time")
        real_time = item.get_closest_marker("real_time") is not None
        if real_time:
            item.add_marker(pytest.mark.flaky(reruns=1))
        if item.config.pluginmanager.hasplugin("xdist"):  # absent with -p no:xdist
            item.add_marker(pytest.mark.xdist_group("real_time" if real_time else place))


@pytest.fixture(scope="session", autouse=True)
def own_folders(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Folders of the tests' own for files that programs keep per user: `acquire status` lists no run of a test."""
    with pytest.MonkeyPatch.context() as patch:
        for variable in ("XDG_RUNTIME_DIR", "XDG_DATA_HOME"):
            folder = tmp_path_factory.mktemp(variable.lower())
            folder.chmod(0o700)
            patch.setenv(variable, str(folder))
        yield


@pytest.fixture(scope="session")
def stand_in(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """``stand_in("emps")``: the folder of the generated stand-in of a data set."""
    root = tmp_path_factory.mktemp("standins")
    return cache(lambda name: write(name, root / name))


@pytest.fixture(scope="session", params=["stand-in", "published"])
def recordings(request: pytest.FixtureRequest) -> Folder:
    """``recordings("emps")``: a test runs once on the stand-in and once on the published files, if they are here."""
    folder: Folder = request.getfixturevalue("stand_in" if request.param == "stand-in" else "public_data")
    return folder
