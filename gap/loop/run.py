"""The loop itself, and the tree of beliefs after each answer."""

from __future__ import annotations

import json
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from acquire.files import write_text
from acquire.recording.model import Recording
from gap.design.answers import believed
from gap.design.choice import Choice
from gap.design.experiment import read
from gap.diagnosis import diagnose
from gap.loop.policies import Policy
from gap.loop.rigs import Rig
from gap.report.document import as_json
from protocols import Limits

MOST = 3
"""Experiments of a loop, unless asked for more."""
SECONDS = "seconds.txt"
"""Beside a shared report: the processor time that it took."""


@dataclass(frozen=True)
class Step:
    """A report, and the experiment chosen after it (none after the last); ``seconds`` of this process that diagnosis
    and choice took."""

    report: Mapping[str, Any]
    choice: Choice | None
    seconds: tuple[float, float] = (0.0, 0.0)

    @property
    def beliefs(self) -> list[tuple[str, float]]:
        """Classes with their probabilities, none and outside among them, the most probable first."""
        r = self.report
        rows = [(", ".join(c["class"]), float(c["probability"])) for c in r["causes"]]
        rows += [("none", r["none_probability"]), ("outside the library", r["outside_probability"])]
        return sorted(rows, key=lambda row: -row[1])


def run(
    rig: Rig,
    policy: Policy,
    limits: Limits,
    folder: Path,
    most: int = MOST,
    quick: bool = False,
    jobs: int = 1,
    tell: Callable[[str], None] = lambda text: None,
    shared: Path | None = None,
    qualification: Path | None = None,
) -> list[Step]:
    """Diagnose a rig's recordings, let it answer up to ``most`` experiments, and diagnose after each.

    Experiment k and its answer go into ``folder/experiment-k``, reports into ``folder/report-k.json``. Where a folder
    ``shared`` is given, answers and reports are kept there instead, by what was asked for one after another: loops on
    the same rig that ask for the same share them. ``qualification`` is the file of one of this instrument.
    """
    recordings: list[Recording] = list(rig.session)
    steps: list[Step] = []
    here = shared if shared is not None else folder
    for k in range(most + 1):
        file = here / ("report.json" if shared is not None else f"report-{k}.json")
        report, seconds = _kept(file) if shared is not None else ({}, 0.0)
        if not report:
            begin = clock.process_time()
            report = as_json(diagnose(recordings, quick=quick, jobs=jobs, qualification=qualification))
            seconds = clock.process_time() - begin
            if shared is not None:
                write_text(file.with_name(SECONDS), f"{seconds:.3f}\n")
            write_text(file, json.dumps(report, indent=1) + "\n")
        tell(" ".join(report["sentences"]))
        diagnosed = clock.process_time()
        choice = policy(report, recordings, limits, k) if k < most else None
        steps.append(Step(report, choice, (seconds, clock.process_time() - diagnosed)))
        if choice is None or choice.experiment is None:
            break
        tell(choice.text)
        asked_for = "-".join(f"{choice.experiment.waveform} on {choice.experiment.specimen}".split())
        place = here / (f"experiment-{k + 1}" if shared is None else asked_for)
        here = place if shared is not None else folder
        done = rig.answer(choice.experiment, place)
        asked = read(place)
        kept, answers = believed([done], {asked.id: asked})
        for a in answers:
            if a.fault:
                tell(a.text)
        recordings += kept
    return steps


def _kept(file: Path) -> tuple[dict[str, Any], float]:
    """A report that was made before, and the seconds it took; nothing where there is none."""
    if not file.exists():
        return {}, 0.0
    return json.loads(file.read_text(encoding="utf-8")), float(file.with_name(SECONDS).read_text(encoding="utf-8"))


def as_text(steps: Sequence[Step], shown: int = 4) -> str:
    """The tree of beliefs, in plain text."""
    lines = []
    for k, step in enumerate(steps):
        lines.append(f"{'  ' * k}after {k} experiments: {step.report['verdict']}")
        lines += [f"{'  ' * k}  {p:5.2f}  {name}" for name, p in step.beliefs[:shown]]
        if step.choice is not None:
            lines.append(f"{'  ' * k}  └ {step.choice.text}")
    return "\n".join(lines)
