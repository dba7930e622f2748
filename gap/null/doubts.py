"""Reference specimens that are not as stated: one of them misfits, and the instrument is not to blame for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gap.inference.evidence import Hypothesis
from gap.inference.least_squares import fit, under
from gap.inference.problem import Problem
from gap.null.robot_reference import ReferenceForceBlock
from gap.null.suction_reference import ReferenceBlock

LEAST = 40.0
"""Fall of χ² and prior together that a specimen's doubt must bring: chance never does."""
OF_CURVES = 60.0
"""The same under suction: a sound membrane whose curve bends in its own way brings 40."""
TIE = 10.0
"""Fall by which an effect must do better to be believed: one that shows on a single specimen may be the specimen's."""


@dataclass(frozen=True)
class Doubt:
    """A ``specimen`` (with its numbers) whose properties do not hold, by the fall of χ² if they need not; ``runs`` are
    the numbers of its recordings; ``effect`` is the one that explains them as well, '' if none does."""

    specimen: str
    fall: float
    runs: tuple[int, ...]
    effect: str = ""

    def __str__(self) -> str:
        said = f"{self.specimen}: it is not as stated (χ² falls by {self.fall:.0f} if it need not be)"
        return f"{said}, or {self.effect} acts, which would explain as much" if self.effect else said


def doubts(problems: Mapping[str, Problem], null: Hypothesis, tried: Sequence[Hypothesis]) -> list[Doubt]:
    """The reference specimens, worst first, that misfit more than any effect ``tried`` on the instrument can explain.

    Each specimen in turn is let go: its height, stiffness, mass or memory need not be as stated. A fault of the
    instrument shows on all specimens, a wrong reference on one.
    """
    found = []
    for name, problem in problems.items():
        if not isinstance(problem, ReferenceBlock | ReferenceForceBlock):
            continue
        alone = null.fits[name]
        best = min(tried, key=lambda h: h.fits[name].objective, default=null)
        least = OF_CURVES if isinstance(problem, ReferenceBlock) else LEAST
        explained = alone.objective - best.fits[name].objective
        for label, (widths, runs) in problem.loosened().items():
            free = fit(under(problem, problem.prior_mean, widths), nuisance=alone.nuisance, iterations=8)
            fall = alone.objective - free.objective
            if fall > max(least, explained - TIE):
                as_well = best.effects if fall < explained + TIE else ()
                found.append(Doubt(label, fall, runs, as_well[0].name if as_well else ""))
    found.sort(key=lambda doubt: -doubt.fall)
    # One wrong reference strains the parameters it shares with the others: only the worst is named, and those as bad.
    return [doubt for doubt in found if doubt.fall > 0.9 * found[0].fall]
