"""The loop as one self-contained page: the beliefs after each answer, and the experiments."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from acquire.files import write_text
from gap.loop.run import Step
from gap.report.pages import render


def write_page(steps: Sequence[Step], path: Path, hidden: str = "") -> Path:
    """Write the page. ``hidden`` is the true effect, where that is known. Raises CannotWrite."""
    return write_text(path, render("gap.loop", "loop.html", steps=steps, hidden=hidden))
