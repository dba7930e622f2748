"""Rows of the campaign's table: how trials are counted, printed and kept."""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

SHOWN = 3  # failures that a row tells


@dataclass
class Row:
    """One fault: how often it was tried, how often the instrument or a recording did not do what it must.

    ``figures`` are what was measured of each trial, in ``unit``, with at most ``limit`` allowed (inf: told only).
    ``exception`` says which of the fault's kinds cannot be noticed, and why.
    """

    fault: str
    must: str
    unit: str = ""
    limit: float = float("inf")
    exception: str = ""
    trials: int = 0
    failures: list[str] = field(default_factory=list)
    figures: list[float] = field(default_factory=list)
    seconds: float = 0.0
    load: float = 0.0

    def trial(self, figure: float | None = None, problem: str = "") -> None:
        """Count one trial; it failed if there is a ``problem`` or the ``figure`` is above the limit."""
        self.trials += 1
        if figure is not None:
            self.figures.append(figure)
            if not problem and not figure <= self.limit:
                problem = f"{figure:.3g} {self.unit} (at most {self.limit:g})"
        if problem:
            self.failures.append(problem)

    @property
    def worst(self) -> str:
        """The worst figure and the median, in words."""
        if not self.figures:
            return ""
        unit = f" {self.unit}" if self.unit else ""
        return f"{max(self.figures):.3g}{unit} (median {np.median(self.figures):.3g})"


@dataclass(frozen=True)
class Campaign:
    """What a family of rows is given: its seed and the share of the full number of trials."""

    seed: int
    share: float

    def count(self, full: int, least: int = 3) -> int:
        """How many trials of ``full`` are made."""
        return max(min(least, full), round(self.share * full))

    def random(self, name: str) -> np.random.Generator:
        """Random numbers of a row, the same whichever other rows run."""
        return np.random.default_rng([self.seed, *name.encode()])


#: A family yields its rows, each when it is done.
Family = Callable[[Campaign], Iterator[Row]]


def timed(rows: Iterator[Row]) -> Iterator[Row]:
    """Rows with how long each took and the host's load at its end."""
    began = time.monotonic()
    for row in rows:
        row.seconds = time.monotonic() - began
        row.load = os.getloadavg()[0]
        yield row
        began = time.monotonic()


def told(row: Row) -> str:
    """One row as lines for a terminal."""
    verdict = "ok  " if not row.failures else "FAIL"
    head = f"{verdict} {row.fault}: {row.trials} trials, {len(row.failures)} failures"
    lines = [", ".join(part for part in (head, row.worst, f"{row.seconds:.0f} s, load {row.load:.1f}") if part)]
    lines += [f"       {failure}" for failure in row.failures[:SHOWN]]
    return "\n".join(lines)


HEAD = """# The fault campaign

Seeded faults on simulated instruments, each in a process of its own; whether it is vented is asked of the instrument.
`make faults` runs all of it (hours) and writes this page, `make faults-ci` a tenth (minutes, part of `.ci/run`). Times
count from the fault to the instrument's safe state, less what this computer kept every thread waiting.

Tried by tests instead: the window frozen or killed (`tests/acquire/gui/test_safety.py`), clocks that are set and a
computer that was suspended (`tests/acquire/engine/test_stops.py`), disks that are read-only, slow or taken away
(`tests/acquire/engine/test_recorder.py`). `python -m benchmarks.faults.mutations` shows that the tests of
[the safety file](safety.md) fail without the controls they are for.
"""


def markdown(rows: Sequence[Row], about: str) -> str:
    """The table for the documentation."""
    titles = ("fault", "must hold", "trials", "failures", "worst", "stated exception")
    lines = [HEAD, about, "", f"| {' | '.join(titles)} |", "|" + "---|" * len(titles)]
    for row in rows:
        cells = (row.fault, row.must, str(row.trials), str(len(row.failures)), row.worst, row.exception)
        lines.append(f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |")
    return "\n".join(lines) + "\n"


def about(campaign: Campaign, seconds: float) -> str:
    """On what the campaign ran, in a sentence."""
    load = ", ".join(f"{value:.1f}" for value in os.getloadavg())
    return (
        f"`python -m benchmarks.faults --share {campaign.share:g} --seed {campaign.seed}`: {seconds / 60:.0f} min on "
        f"{os.cpu_count()} cores ({platform.machine()}, Python {platform.python_version()}); load at the end {load}."
    )


def save(rows: Sequence[Row], campaign: Campaign, seconds: float, path: Path) -> None:
    """All rows, figures included, as JSON."""
    path.parent.mkdir(parents=True, exist_ok=True)
    content = {
        "seed": campaign.seed,
        "share": campaign.share,
        "seconds": round(seconds, 1),
        "cores": os.cpu_count(),
        "load": os.getloadavg(),
        "rows": [asdict(row) | {"figures": [float(f"{x:.4g}") for x in row.figures]} for row in rows],
    }
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
