"""The loop as one self-contained page: what was believed after each answer, and what was asked for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from acquire.files import write_text
from gap.loop.run import Step


def write_page(steps: Sequence[Step], path: Path, hidden: str = "") -> Path:
    """Write the page. ``hidden`` is what really acts, where that is known. Raises CannotWrite."""
    from jinja2 import Environment, PackageLoader

    environment = Environment(loader=PackageLoader("gap.loop", "templates"), autoescape=True)
    environment.filters["plain"] = lambda text: text.replace("_", " ")
    return write_text(path, environment.get_template("loop.html").render(steps=steps, hidden=hidden))
