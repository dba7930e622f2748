"""The layout that reviews rely on: no file longer than a reader holds in the head."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = (
    "acquire",
    "benchmarks",
    "drivers",
    "examples",
    "gap",
    "protocols",
    "sim_devices",
    "skinrig",
    "solver",
    "tests",
    "tools",
)
MOST = 400  # lines


def test_no_file_is_too_long() -> None:
    lengths = {
        path.relative_to(ROOT).as_posix(): len(path.read_text().splitlines())
        for folder in FOLDERS
        for path in (ROOT / folder).rglob("*.py")
    }
    assert len(lengths) > 400  # it looks where the files are
    assert {path: n for path, n in lengths.items() if n > MOST} == {}
