"""Fields of the fitted model: what the page shows, and files for ParaView."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..api import Experiment, Field
from ..export import file_name, write
from .problem import Problem, simulate

if TYPE_CHECKING:
    from .result import FitResult

FRAMES = 25  # fields of a recording where no times are named, evenly spread


def pictures(problem: Problem, values: Mapping[str, float]) -> dict[str, tuple[Field, ...]]:
    """Each case's fields at the largest load and at the end; none where that run fails."""
    found = {}
    for case in problem.cases:
        experiment = replace(
            case.experiment, snapshots=(largest_load(case.experiment), float(case.experiment.time[-1]))
        )
        result = simulate(problem.model, experiment, case.values(values), ())
        found[case.label] = () if isinstance(result, str) else result.fields
    return found


def largest_load(experiment: Experiment) -> float:
    """When [s] the drive is farthest from zero."""
    size = np.sum([values**2 for values in experiment.drive.values()], axis=0)
    return float(experiment.time[int(np.argmax(size))])


def write_fields(result: FitResult, folder: Path, times: Sequence[float] = ()) -> list[Path]:
    """Run the fitted model on every recording and write its fields: see `skinrig_solver.export.write`.

    ``times`` [s] count from a recording's first sample; without any, 25 are spread evenly and the largest load is one
    more. Raises ImportError that says what to install; ValueError naming a recording that is shorter; SolverError.
    """
    files: list[Path] = []
    names: set[str] = set()
    for label, experiment in result.experiments.items():
        name = file_name(label)
        while name in names:
            name += "_"
        names.add(name)
        even = np.linspace(experiment.time[0], experiment.time[-1], FRAMES)
        moments = tuple(times) or tuple(sorted({*even.tolist(), largest_load(experiment)}))
        values = {**result.parameters, **result.setups[label].parameters}
        run = result.model.simulate(replace(experiment, snapshots=moments), values)
        files += write(run.fields, folder, name)
    return files
