"""What an effect changes in the data, at points of its prior: where the data say to look, and where it is seen."""

from __future__ import annotations

import numpy as np

from gap.inference.evidence import Fit, Hypothesis
from gap.inference.hypothesis import Candidate, to_unit
from gap.inference.linear import Projector
from gap.inference.problem import Problem
from sim_devices.chain import FloatArray, Parameter

SMALL = (3.0, 60.0)
"""σ by which a point should change the data for straight lines to say something."""
APART = 2.5
"""Factor by which the change of a point may differ from the residual for a fit to start well from it."""
BISECTIONS = 7
"""Steps at most to find one."""
NEARER = 0.15
"""How much nearer to nothing the next point is, where all that are known are too large."""


class _Points:
    """Points (k,) of a candidate's prior with the changes (n,) that each makes in every block, and the size of these:
    in σ as they are, and beside the nuisance."""

    def __init__(
        self, candidate: Candidate, problems: dict[str, Problem], base: Hypothesis, own: dict[str, Projector]
    ) -> None:
        self.candidate, self.base, self._problems, self._own = candidate, base, problems, own
        self.units: list[FloatArray] = []
        self.columns: dict[str, list[FloatArray]] = {b: [] for b in candidate.blocks}
        self.sizes: list[tuple[float, float]] = []

    def look(self, unit: FloatArray) -> None:
        raw, beside = 0.0, 0.0
        for b, column in self.columns.items():
            column.append(_trace(self._problems[b], self.base.fits[b], self.candidate, unit))
            raw += float(np.sum(np.square(column[-1])))
            beside += max(self._own[b].chi2(column[-1]), 0.0)
        self.units.append(unit)
        self.sizes.append((float(np.sqrt(raw)), float(np.sqrt(beside))))

    @property
    def left(self) -> float:
        """σ that the base leaves above the noise in the candidate's blocks."""
        excess = (self.base.fits[b].chi2 - len(self.base.fits[b].residual) for b in self.columns)
        return float(np.sqrt(sum(max(e, 0.0) for e in excess)))

    def usual(self, at: int) -> list[int]:
        """Which points differ from the prior's middle, or from the first point, in the parameter ``at`` alone."""

        def others(u: FloatArray) -> FloatArray:
            return np.delete(u, at)

        middle = [k for k, u in enumerate(self.units) if np.all(others(u) == 0.5)]
        return middle or [k for k, u in enumerate(self.units) if np.array_equal(others(u), others(self.units[0]))]

    def between(self, at: int, which: int, low: float, high: float, along: list[int]) -> None:
        """Look for a point whose size is between ``low`` and ``high`` σ, by halves between those ``along`` the
        parameter ``at`` that are smaller and larger; adds to these. A limit is small where no signal meets it, at the
        upper end of its prior, of which the usual points may all be far. Of a parameter of either sign the point beyond
        the value that does nothing is looked at, too."""
        p = self.candidate.parameters[at]
        nothing = nowhere(p)
        both = 0.0 < nothing < 1.0
        for _ in range(BISECTIONS):
            known = [(abs(self.units[k][at] - nothing), self.sizes[k][which]) for k in along]
            if any(low <= size <= high for _, size in known):
                return
            below = max((away for away, size in known if size < low), default=0.0 if nothing else None)
            above = min((away for away, size in known if size > high), default=None)
            if below is None or above is None:
                return
            away = NEARER * above if both and below == 0.0 else 0.5 * (below + above)
            for there in (nothing - away, nothing + away):
                if 0.0 <= there <= 1.0:
                    unit = self.units[along[0]].copy()
                    unit[at] = there
                    self.look(unit)
                    along.append(len(self.units) - 1)


def nowhere(p: Parameter) -> float:
    """The prior quantile at which a strength does nothing."""
    if p.null is None or p.null <= p.low:
        return 0.0
    return 1.0 if p.null >= p.high else to_unit(p, p.null)


def traced(
    candidate: Candidate,
    problems: dict[str, Problem],
    base: Hypothesis,
    own: dict[str, Projector],
    points: list[FloatArray],
) -> tuple[tuple[FloatArray, ...], dict[str, FloatArray]]:
    """The points and, for each block, their changes, (n, points); with points where the effect begins to show and
    where it is as large as the base's rest, if none of them is there: a threshold leaves nothing to linearise
    below it, and too much far above."""
    seen = _Points(candidate, problems, base, own)
    for unit in points:
        seen.look(unit)
    several = [p.null is not None and (p.scale == "log" or p.low < p.null < p.high) for p in candidate.parameters]
    strengths = np.flatnonzero(several).tolist()
    if len(strengths) == 1:
        along, left = seen.usual(strengths[0]), seen.left
        seen.between(strengths[0], 0, *SMALL, along)
        if left * APART >= SMALL[1]:
            seen.between(strengths[0], 1, left / APART, left * APART, along)
    return tuple(seen.units), {b: np.column_stack(c) for b, c in seen.columns.items()}


def _trace(problem: Problem, f: Fit, candidate: Candidate, unit: FloatArray) -> FloatArray:
    """The projection that a candidate at ``unit`` (k,) takes from a fit's whitened residual (n,)."""
    active = {**f.active, candidate: candidate.values(unit)}
    trace = f.residual - problem.evaluate(f.nuisance, active, want_jacobian=False).residual
    # A point at which the simulation diverges says nothing.
    return np.asarray(trace) if np.all(np.isfinite(trace)) else np.zeros(len(trace))
