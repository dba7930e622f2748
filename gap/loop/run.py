"""The loop itself, and the tree of what was believed after each answer."""

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


@dataclass(frozen=True)
class Step:
    """A report, and what was chosen after it (nothing after the last one); ``seconds`` of this process that diagnosis
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
    first: Mapping[str, Any] | None = None,
) -> list[Step]:
    """Diagnose what a rig has recorded, let it answer up to ``most`` experiments, and diagnose after each.

    Experiment k and its answer go into ``folder/experiment-k``, reports into ``folder/report-k.json``. ``first`` is the
    report on the session alone, where there is one already.
    """
    recordings: list[Recording] = list(rig.session)
    steps: list[Step] = []
    for k in range(most + 1):
        begin = clock.process_time()
        report = first if first is not None and k == 0 else as_json(diagnose(recordings, quick=quick, jobs=jobs))
        diagnosed = clock.process_time()
        write_text(folder / f"report-{k}.json", json.dumps(report, indent=1) + "\n")
        tell(" ".join(report["sentences"]))
        choice = policy(report, recordings, limits, k) if k < most else None
        steps.append(Step(report, choice, (diagnosed - begin, clock.process_time() - diagnosed)))
        if choice is None or choice.experiment is None:
            break
        tell(choice.text)
        place = folder / f"experiment-{k + 1}"
        done = rig.answer(choice.experiment, place)
        asked = read(place)
        kept, answers = believed([done], {asked.id: asked})
        for a in answers:
            if a.fault:
                tell(a.text)
        recordings += kept
    return steps


def as_text(steps: Sequence[Step], shown: int = 4) -> str:
    """The tree of what was believed, in plain text."""
    lines = []
    for k, step in enumerate(steps):
        lines.append(f"{'  ' * k}after {k} experiments: {step.report['verdict']}")
        lines += [f"{'  ' * k}  {p:5.2f}  {name}" for name, p in step.beliefs[:shown]]
        if step.choice is not None:
            lines.append(f"{'  ' * k}  └ {step.choice.text}")
    return "\n".join(lines)
