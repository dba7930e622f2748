"""Public recordings are named, checked and documented; none is in the repository."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from acquire import datasets
from acquire.datasets import DATASETS, Dataset, DatasetMissing, folder
from tests.standins import ROOT


@pytest.fixture
def table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A data set of one file in the folder that SKINRIG_DATA names."""
    content = b"a,b\n1,2\n"
    known = {"table.csv": hashlib.sha256(content).hexdigest()}
    monkeypatch.setattr(datasets, "DATASETS", {"mine": Dataset("https://example.org/mine", known)})
    monkeypatch.setenv(datasets.VARIABLE, str(tmp_path))
    path = tmp_path / "mine" / "table.csv"
    path.parent.mkdir()
    path.write_bytes(content)
    return path


def test_a_checked_folder(table: Path) -> None:
    assert folder("mine") == table.parent


def test_a_changed_file_is_refused(table: Path) -> None:
    table.write_bytes(table.read_bytes() + b"3,4\n")
    with pytest.raises(ValueError, match=r"table\.csv is not the published file"):
        folder("mine")


def test_a_missing_set_says_where_it_can_be_had(table: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table.unlink()
    with pytest.raises(DatasetMissing, match=r"data set mine: .*table\.csv is missing; .*https://example.org/mine"):
        folder("mine")
    monkeypatch.delenv(datasets.VARIABLE)
    with pytest.raises(DatasetMissing, match=r"data set mine: SKINRIG_DATA is not set"):
        folder("mine")


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(ValueError, match="unknown data set 'yours'; there is emps"):
        folder("yours")


def test_every_file_is_in_the_documentation() -> None:
    page = (ROOT / "docs/data.md").read_text(encoding="utf-8")
    for name, dataset in DATASETS.items():
        assert dataset.source.split(",")[0] in page
        for file, digest in dataset.files.items():
            assert f"| `{name}/{file}` | `{digest}` |" in page
