"""The fault campaign judges: a row fails when it should, and its inputs are the same for the same seed."""

from __future__ import annotations

import importlib
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.faults.__main__ import FAMILIES, _one, clocked, parts
from benchmarks.faults.hostile import _judged
from benchmarks.faults.inputs import TABLE
from benchmarks.faults.mutate import record, spoil_journal, spoiled
from benchmarks.faults.proofs import PROOFS
from benchmarks.faults.table import Campaign, Row, load, markdown, save, told


def test_a_row_fails_by_its_limit_and_by_a_problem() -> None:
    row = Row("cable", "vented", "s", 0.5)
    row.trial(0.4)
    row.trial(0.6)
    row.trial(math.nan)
    row.trial(0.1, "no recording")
    row.trial()
    assert row.trials == 5
    assert len(row.failures) == 3
    assert "FAIL cable: 5 trials, 3 failures" in told(row)
    assert "| cable | vented | 5 | 3 |" in markdown([row], "somewhere")


@pytest.mark.parametrize(
    ("status", "said", "touched", "word"),
    [
        (0, "", [], ""),
        (2, "acquire: a.csv:3: no number", [], ""),
        (1, "a.csv", [], "status 1"),
        (2, "", [], "without a word"),
        (2, "no number", [], "names no file"),
        (2, "a.csv\nTraceback (most recent call last)", [], "a traceback"),
        (0, "", ["/etc/passwd"], "wrote or changed"),
    ],
)
def test_how_a_hostile_file_is_answered_is_judged(status: int, said: str, touched: list[str], word: str) -> None:
    found = _judged(status, said, ["a.csv"], touched)
    assert word in found
    assert bool(found) == bool(word)


def test_the_same_seed_spoils_alike() -> None:
    journal = b"".join(record(kind, n, json.dumps({"a": n}).encode()) for n, kind in enumerate((1, 2, 5, 7)))
    for spoil, data in ((spoiled, TABLE.encode()), (spoil_journal, journal)):
        once = [spoil(data, np.random.default_rng([1, k])) for k in range(20)]
        assert once == [spoil(data, np.random.default_rng([1, k])) for k in range(20)]
        assert sum(one != data for one in once) > 10


def test_results_are_kept_and_merged(tmp_path: Path) -> None:
    """A known row is not measured again; another share or seed is another campaign."""
    rows = {"links/pulled": [Row("cable", "vented", part="links/pulled", revision="abc", load=0.5)]}
    rows["links/pulled"][0].trial(0.123456, "hm")
    path, campaign = tmp_path / "results" / "faults.json", Campaign(7, 0.1)
    save(rows, campaign, path)
    (kept,) = load(path, campaign)["links/pulled"]
    assert (kept.figures, kept.failures, kept.revision, kept.load) == ([0.1235], ["hm"], "abc", 0.5)
    assert not load(path, Campaign(8, 0.1))
    assert not load(path, Campaign(7, 1.0))
    assert not load(tmp_path / "none.json", campaign)


def test_every_part_has_a_name_and_a_judge() -> None:
    named = parts()
    assert {name.partition("/")[0] for name in named} == set(FAMILIES)
    assert all(isinstance(clocked(name), bool) for name in named)


def test_every_part_has_a_control_without_which_it_fails() -> None:
    """`benchmarks.faults.proofs` still finds what it takes out."""
    assert set(PROOFS) == set(parts())
    for removal in PROOFS.values():
        for place in removal.patched:
            module, _, path = place.partition(":")
            found: Any = importlib.import_module(module)
            for name in path.split("."):
                found = getattr(found, name)


def test_a_part_that_dies_is_a_failed_row(tmp_path: Path) -> None:
    (row,) = _one("links/no-such-part", Campaign(1, 0.1), tmp_path / "a.json")
    assert row.failures
