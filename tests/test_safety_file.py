"""docs/safety.md is true as far as a machine can tell: numbers, names of tests, requirements, the list of packages."""

from __future__ import annotations

import importlib
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from benchmarks.faults.holes import HOLES
from benchmarks.faults.holes import line as hole
from benchmarks.faults.mutations import REMOVALS
from benchmarks.faults.mutations import line as line_of

ROOT = Path(__file__).parent.parent
TEXT = (ROOT / "docs/safety.md").read_text(encoding="utf-8")


def rows(first: str) -> list[list[str]]:
    """The rows of the table whose header begins with ``first``."""
    lines = TEXT.splitlines()
    begin = next(k for k, line in enumerate(lines) if line.startswith(f"| {first} |"))
    found = []
    for line in lines[begin + 2 :]:
        if not line.startswith("|"):
            break
        found.append([cell.strip() for cell in line.strip("|").split(" | ")])
    return found


HAZARDS = {row[0]: row for row in rows("id")}


def test_hazards_are_numbered_and_complete() -> None:
    assert list(HAZARDS) == [f"H{number:02d}" for number in range(1, len(HAZARDS) + 1)]
    assert {len(row) for row in HAZARDS.values()} == {7}
    assert all(cell for row in HAZARDS.values() for cell in row)
    assert {row[2] for row in HAZARDS.values()} <= {"S1", "S2", "S3", "S4"}


def test_requirements_are_stated_and_used() -> None:
    stated = [row[0] for row in rows("requirement")]
    used = {name for row in HAZARDS.values() for name in row[4].split()}
    assert used == set(stated)
    assert len(set(stated)) == len(stated)


def test_what_is_referred_to_is_there() -> None:
    for name in re.findall(r"\bH\d\d\b", TEXT):
        assert name in HAZARDS
    for path in re.findall(r"`((?:tests|acquire|drivers|benchmarks)/[\w/.]+)`", TEXT):
        assert (ROOT / path).exists(), path


@pytest.fixture(scope="module")
def known() -> set[str]:
    """Names of all tests."""
    files = (ROOT / "tests").rglob("test_*.py")
    return {name for path in files for name in re.findall(r"^\s*def (test_\w+)", path.read_text("utf-8"), re.MULTILINE)}


@pytest.mark.parametrize("hazard", HAZARDS)
def test_every_test_that_is_named_exists(hazard: str, known: set[str]) -> None:
    cell = HAZARDS[hazard][5]
    named = re.findall(r"`(test_\w+)(?:\[[^`]*\])?`", cell)
    assert named or "`tests/" in cell, "a hazard without a test"
    assert not [name for name in named if name not in known]


def test_every_hazard_s_control_was_removed_once() -> None:
    """The table is of the removals as they are now, and each was noticed."""
    assert list(REMOVALS) == list(HAZARDS)
    assert [f"| {' | '.join(cells)} |" for cells in rows("hazard")] == [line_of(hazard, "yes") for hazard in REMOVALS]


def test_every_hole_has_its_tests() -> None:
    assert list(HOLES) == list(range(1, 17))
    assert [f"| {' | '.join(cells)} |" for cells in rows("hole")] == [hole(number) for number in HOLES]
    for _, tests in HOLES.values():
        for test in tests:
            path, _, name = test.partition("::")
            assert f"def {name}(" in (ROOT / path).read_text(encoding="utf-8"), test


def test_every_package_is_listed() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    used = [
        *project["dependencies"],
        *project["optional-dependencies"]["gui"],
        *project["optional-dependencies"]["cluster"],
    ]
    needed = {re.split(r"[\[<>=!~ ]", requirement)[0].lower() for requirement in used}
    listed = {name.strip().lower() for row in rows("package") for name in row[0].split(",")}
    assert listed == needed


@pytest.mark.parametrize("hazard", REMOVALS)
def test_a_control_that_is_removed_belongs_to_its_hazard(hazard: str) -> None:
    """The patch of `benchmarks.faults.mutations` still finds what it removes, and its test is the hazard's."""
    removal = REMOVALS[hazard]
    assert removal.test.rpartition("::")[2] in HAZARDS[hazard][5]
    for place in removal.patched:
        module, _, path = place.partition(":")
        found: Any = importlib.import_module(module)
        for name in path.split("."):
            found = getattr(found, name)
