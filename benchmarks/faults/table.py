"""Rows of the campaign's table: how trials are counted, printed, kept and merged."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

SHOWN = 3  # failures that a row tells
#: Subject of a row's statement.
SOURCES = ("acquire", "drivers", "protocols", "sim_devices", "benchmarks/faults")


@dataclass
class Row:
    """One fault: how often it was tried, how often the instrument or a recording failed its requirement.

    ``figures`` are the measurements of each trial, in ``unit``, with at most ``limit`` allowed (inf: told only).
    ``exception`` says which of the fault's kinds cannot be noticed, and why. ``part`` of the campaign made the row in
    ``seconds``, under a ``load`` (the host's, of one minute, at its end), of the sources at ``revision``.
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
    part: str = ""
    revision: str = ""

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
    """Arguments of a part: seed, share of the full number of trials, and how long fuzzing a slow target may take."""

    seed: int
    share: float
    budget: float = float("inf")  # s of processor time

    def count(self, full: int, least: int = 3) -> int:
        """How many trials of ``full`` are made."""
        return max(min(least, full), round(self.share * full))

    def random(self, name: str) -> np.random.Generator:
        """Random numbers of a row, the same whichever other rows run."""
        return np.random.default_rng([self.seed, *name.encode()])


#: Makes rows, each when it is done.
Part = Callable[[Campaign], Iterable[Row]]


def timed(rows: Iterable[Row], part: str) -> Iterator[Row]:
    """Rows with how long each took, the host's load at its end, their part and revision."""
    began = time.monotonic()
    for row in rows:
        row.seconds = time.monotonic() - began
        row.load = os.getloadavg()[0]
        row.part, row.revision = part, revision()
        yield row
        began = time.monotonic()


def revision() -> str:
    """The commit of the sources, with a '+' where they were changed since; '' without git."""
    root = Path(__file__).parents[2]

    def git(*words: str) -> str:
        return subprocess.run(["git", "-C", str(root), *words], capture_output=True, text=True, check=True).stdout

    try:
        return git("rev-parse", "--short=7", "HEAD").strip() + ("+" if git("status", "-s", "--", *SOURCES) else "")
    except (OSError, subprocess.CalledProcessError):
        return ""


def told(row: Row) -> str:
    """One row as lines for a terminal."""
    verdict = "ok  " if not row.failures else "FAIL"
    head = f"{verdict} {row.fault}: {row.trials} trials, {len(row.failures)} failures"
    lines = [", ".join(part for part in (head, row.worst, f"{row.seconds:.0f} s, load {row.load:.1f}") if part)]
    lines += [f"       {failure}" for failure in row.failures[:SHOWN]]
    return "\n".join(lines)


HEAD = """# The fault campaign

Seeded faults on simulated instruments, each in a process of its own; whether it is vented is asked of the instrument.
`make faults` runs all of it and writes this page, `make faults-ci` a tenth (minutes, part of `.ci/run`). Times
count from the fault to the instrument's safe state, less the time that this computer kept every thread waiting. Parts
that were run at different times are one table: each row has its revision and the computer's load at its end.

Tried by tests instead, each with a real window or clock: a window frozen by its own process, closed or killed while a
person looks (`tests/acquire/gui/test_safety.py`), a computer that was suspended (`tests/acquire/engine/test_stops.py`).
`python -m benchmarks.faults.proofs` shows that each part below fails when a control is taken out, [the safety
file](safety.md#without-the-control) the same of its tests. The soak's instrument runs ten times as fast: its rates are
those of its own clock, so that an hour of samples passes in minutes, through a host that keeps real time.
"""


def markdown(rows: Sequence[Row], about: str) -> str:
    """The table for the documentation."""
    titles = ("fault", "must hold", "trials", "failures", "worst", "stated exception", "s", "load", "at")
    lines = [HEAD, about, "", f"| {' | '.join(titles)} |", "|" + "---|" * len(titles)]
    for row in rows:
        counts = (str(row.trials), str(len(row.failures)), row.worst, row.exception)
        cells = (row.fault, row.must, *counts, f"{row.seconds:.0f}", f"{row.load:.1f}", row.revision)
        lines.append(f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |")
    return "\n".join(lines) + "\n"


def about(campaign: Campaign, rows: Sequence[Row]) -> str:
    """The campaign's host, extent and duration, in a sentence."""
    trials, failures = sum(row.trials for row in rows), sum(len(row.failures) for row in rows)
    minutes = sum(row.seconds for row in rows) / 60
    return (
        f"`python -m benchmarks.faults --share {campaign.share:g} --seed {campaign.seed}`: {trials} trials, {failures} "
        f"failures; {minutes:.0f} min of parts, some side by side, on {os.cpu_count()} cores ({platform.machine()}, "
        f"Python {platform.python_version()})."
    )


def save(rows: Mapping[str, Sequence[Row]], campaign: Campaign, path: Path) -> None:
    """The rows of each part, figures included, as JSON."""
    path.parent.mkdir(parents=True, exist_ok=True)
    content = {
        "seed": campaign.seed,
        "share": campaign.share,
        "cores": os.cpu_count(),
        "rows": [
            asdict(row) | {"figures": [float(f"{x:.4g}") for x in row.figures]}
            for part in rows.values()
            for row in part
        ],
    }
    path.write_text(json.dumps(content, indent=None).replace('}, {"fault"', '},\n{"fault"') + "\n", encoding="utf-8")


def load(path: Path, campaign: Campaign) -> dict[str, list[Row]]:
    """Rows by part, as they were saved; none where they are of another campaign, or there are none."""
    if not path.exists():
        return {}
    content = json.loads(path.read_text(encoding="utf-8"))
    if (content["seed"], content["share"]) != (campaign.seed, campaign.share):
        return {}
    found: dict[str, list[Row]] = {}
    for one in content["rows"]:
        found.setdefault(one["part"], []).append(Row(**one))
    return found
