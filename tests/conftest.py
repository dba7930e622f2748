"""Public recordings where this machine has them, and their stand-ins everywhere."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from tests.standins import write

Folder = Callable[[str], Path]


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
