"""YAML as it is written is read back as it was."""

from __future__ import annotations

from pathlib import Path

import pytest

from protocols.source import read, written


@pytest.mark.parametrize("text", ["0E0", "12E3", "1e3", "007", "3.50", ".5", "yes", "1:30", "two\nlines", "", "0x10"])
def test_a_text_that_looks_like_a_number_is_read_back_as_a_text(tmp_path: Path, text: str) -> None:
    """A serial number 12E3 in a qualification, or an event's 0E0, came back as a number."""
    file = tmp_path / "said.yaml"
    file.write_text(written({"serial": text, "value": 1e-7}), encoding="utf-8")
    assert read(file)[0] == {"serial": text, "value": 1e-7}
