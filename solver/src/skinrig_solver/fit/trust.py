"""Why a fit is not to be trusted, in plain words; nothing is said where it is."""

from __future__ import annotations

from collections.abc import Sequence

from scipy import stats

from .problem import Evaluation, Problem
from .statistics import Estimate, Uncertainty, listed

CHANCE = 1e-3  # how often noise alone may look like a response


def silent(problem: Problem, optimum: Evaluation, known: Uncertainty) -> str:
    """Why the recordings hold no signal that the model explains; '' where they do.

    An F test of the fit against curves that do not respond (their mean where the zero is not known, zero elsewhere),
    over each curve's own noise and as many samples as are independent.
    """
    rise, parameters = 0.0, max(sum(not side for side in known.on_bound), 1)
    own = zip(problem.groups(), known.noise, known.persistence, strict=True)
    for (number, channel, where), noise, together in own:
        case = problem.cases[number]
        weight = case.weight[channel] / case.scale[channel]
        used = weight > 0.0
        if not used.any():
            continue
        data, power = case.data[channel][used], weight[used] ** 2
        level = float(power @ data / power.sum()) if channel in case.floating else 0.0
        left = optimum.residual[where][used] / weight[used]
        gain = float((data - level) @ (data - level) - left @ left)
        rise += gain / max(noise**2 * together, 1e-300)
    if rise > 0.0 and stats.f.sf(rise / parameters, parameters, known.freedom) < CHANCE:
        return ""
    return "the recordings hold no response that stands out of their noise: a curve that stays where it is does as well"


def reasons(fatal: Sequence[str], found: Sequence[Estimate], converged: bool) -> list[str]:
    """``fatal`` ones first, then the faults of single parameters."""
    told = [text for text in fatal if text]
    if not converged:
        told.append("the optimiser stopped before it converged")
    at = [e.free.symbol for e in found if e.at]
    poor = [e.free.symbol for e in found if not e.at and not e.identifiable]
    if at:
        told.append(f"{listed(at)} ended on {'its bound' if len(at) == 1 else 'their bounds'}")
    if poor and not any(fatal):
        told.append(f"{listed(poor)} {'is' if len(poor) == 1 else 'are'} not identifiable from these recordings")
    return told
