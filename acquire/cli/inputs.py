"""Recordings named on the command line: files, bundles, or folders that hold any number of either."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

BUNDLE = "recording.yaml"


def holds_others(path: Path) -> bool:
    """Whether it is a folder that is no bundle itself."""
    return path.is_dir() and not (path / BUNDLE).exists()


def bundles(folder: Path) -> list[Path]:
    """Folders of the bundles in a folder, in order."""
    return sorted(p.parent for p in folder.rglob(BUNDLE))


def found(paths: Sequence[Path]) -> list[Path]:
    """Recordings and bundles at ``paths``, in order; one that is named twice is no repeat, and counts once.

    Raises FileNotFoundError for a folder without any.
    """
    every: list[Path] = []
    for path in paths:
        if holds_others(path):
            inside = bundles(path) + sorted(p for p in path.rglob("*.h5"))
            if not inside:
                raise FileNotFoundError(f"{path}: no recording (*.h5) and no bundle ({BUNDLE}) in this folder")
            every += inside
        else:
            every.append(path)
    once: dict[Path, Path] = {}
    for path in every:
        once.setdefault(path.absolute(), path)
    return list(once.values())


def load_all(paths: Sequence[Path]) -> list[Any]:
    """The recordings at ``paths``. Raises FileNotFoundError, RecordingError."""
    from acquire.recording import load

    return [load(path) for path in found(paths)]
