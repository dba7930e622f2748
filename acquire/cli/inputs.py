"""Recordings named on the command line: files, bundles, or folders that hold any number of either."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any


def found(paths: Sequence[Path]) -> list[Path]:
    """Recordings and bundles at ``paths``, in order. Raises FileNotFoundError for a folder without any."""
    every: list[Path] = []
    for path in paths:
        if path.is_dir() and not (path / "recording.yaml").exists():
            bundles = sorted(p.parent for p in path.rglob("recording.yaml"))
            inside = bundles + sorted(p for p in path.rglob("*.h5"))
            if not inside:
                raise FileNotFoundError(f"{path}: no recording (*.h5) and no bundle (recording.yaml) in this folder")
            every += inside
        else:
            every.append(path)
    return every


def load_all(paths: Sequence[Path]) -> list[Any]:
    """The recordings at ``paths``. Raises FileNotFoundError, RecordingError."""
    from acquire.recording import load

    return [load(path) for path in found(paths)]
