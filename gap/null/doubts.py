"""Reference specimens that are not what they say: one of them misfits, and the instrument is not to blame for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gap.inference.evidence import Fit
from gap.inference.least_squares import fit, under
from gap.inference.problem import Problem
from gap.null.robot_reference import ReferenceForceBlock
from gap.null.suction_reference import ReferenceBlock

LEAST = 40.0
"""Fall of χ² and prior together that a specimen's doubt must bring: chance never does."""
MARGIN = 0.8
"""Share of what the instrument's best effect would bring, which a doubt must reach to be believed rather."""


@dataclass(frozen=True)
class Doubt:
    """A ``specimen`` (with its numbers) whose properties do not hold, by the fall of χ² if they need not; ``runs`` are
    the numbers of its recordings."""

    specimen: str
    fall: float
    runs: tuple[int, ...]

    def __str__(self) -> str:
        return f"{self.specimen}: it is not what it says (χ² falls by {self.fall:.0f} if it need not be)"


def doubts(problems: Mapping[str, Problem], null: Mapping[str, Fit], best: Mapping[str, Fit]) -> list[Doubt]:
    """The reference specimens, worst first, that misfit more than the instrument's ``best`` effect can explain.

    ``null`` and ``best`` are fits by block. Each specimen in turn is let go: its height, stiffness, mass or memory need
    not be as stated. A fault of the instrument shows on all specimens, a wrong reference on one.
    """
    found = []
    for name, problem in problems.items():
        if not isinstance(problem, ReferenceBlock | ReferenceForceBlock):
            continue
        explained = null[name].objective - best[name].objective
        for label, (widths, runs) in problem.loosened().items():
            start = null[name].nuisance
            free = fit(under(problem, problem.prior_mean, widths), nuisance=start, iterations=8)
            fall = null[name].objective - free.objective
            if fall > LEAST and fall > MARGIN * explained:
                found.append(Doubt(label, fall, runs))
    found.sort(key=lambda doubt: -doubt.fall)
    # One wrong reference strains what it shares with the others: only the worst is named, and those as bad.
    return [doubt for doubt in found if doubt.fall > 0.9 * found[0].fall]
