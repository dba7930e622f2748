"""An earlier qualification of the instrument as a prior: priors of its parameters, effects that it lacks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from acquire.qualifications import Parameter, Qualification, day_of, load_qualification, serial_of
from acquire.recording.model import Recording
from gap.data.quantities import quantity
from gap.inference.evidence import Fit, Hypothesis
from gap.inference.hypothesis import FROZEN
from gap.inference.problem import Problem

CHANGED = 0.05
"""Probability that an effect which a qualification would have seen has come since (assumed)."""
DRIFT = 0.1
"""Of a parameter's tolerance: how far it may have drifted since (assumed)."""
CLEARLY = 4.0
"""Standard deviations from where a parameter was, from which on it has changed."""


@dataclass(frozen=True)
class Qualified:
    """A qualification, its ``file``, and why it is not believed ('' where it is)."""

    qualification: Qualification
    file: str
    reason: str = ""

    @property
    def believed(self) -> bool:
        return not self.reason

    @property
    def remark(self) -> str:
        """A remark for the report: that it is not believed, or was not passed; '' where neither holds."""
        q = self.qualification
        if not self.believed:
            return f"qualification {self.file} is not believed: {self.reason}"
        if q.passed:
            return ""
        off = [f.effect for f in q.findings] or [name for name, p in q.parameters.items() if p.passed is False]
        found = ", ".join(off) or "of unknown cause"
        return f"qualification {self.file} was not passed ({found}): parameters are taken as it found them"

    def nats(self, h: Hypothesis, prior: float) -> float:
        """The log-probability that a hypothesis loses by effects that the qualification would have seen, at the
        strength they have here, and gains by one that it found; ``prior`` is that of an effect otherwise."""
        if not self.believed:
            return 0.0
        now = max(self.expected(h), prior)
        odds = np.log(now / (1.0 - now)) - np.log(prior / (1.0 - prior))
        return float(odds + sum(np.log(CHANGED) for _ in self._unseen(h)))

    def expected(self, h: Hypothesis) -> float:
        """The probability that an effect of a hypothesis acts because the qualification found it; 0 where it found
        none of them. It may have been repaired since."""
        names = {e.name for e in h.effects}
        found = [(f, (*f.indistinguishable, *f.effect.split(" + "))) for f in self.qualification.findings]
        shares = [f.probability / max(len(f.indistinguishable), 1) for f, known in found if names & set(known)]
        return max(shares, default=0.0) * (1.0 - CHANGED) if self.believed else 0.0

    def changes(self, h: Hypothesis) -> list[str]:
        """Effects of a hypothesis that were not there when the instrument was qualified, in words."""
        bounds = self.qualification.effects
        said = []
        for name in self._unseen(h):
            b = bounds[name]
            said.append(
                f"{name} has come since: its {b.parameter} was below {quantity(b.value, b.unit, None, b.parameter)}"
            )
        return said

    def _unseen(self, h: Hypothesis) -> Iterable[str]:
        known = {f.effect for f in self.qualification.findings}
        for e in h.effects:
            bound = self.qualification.effects.get(e.name)
            if bound is None or e.name in known:
                continue
            values = h.values(e)
            null = next((p.null or 0.0 for p in e.parameters if p.name == bound.parameter), None)
            if null is not None and abs(values[bound.parameter] - null) > bound.value:
                yield e.name


def read(path: Path, recordings: Sequence[Recording]) -> Qualified:
    """The qualification in a file, and whether it may be believed of the instrument of ``recordings``, on their day.

    Raises RecordingError, OSError.
    """
    q = load_qualification(path)
    serials = {serial_of(r.info) for r in recordings} - {""}
    days = [day for r in recordings if (day := day_of(r.info)) is not None]
    reasons = [q.against(recordings[0].info.instrument, serial, max(days, default=None)) for serial in serials or {""}]
    return Qualified(q, str(path), next(filter(None, reasons), ""))


def inform(problems: Sequence[Problem], qualified: Qualified) -> list[str]:
    """Narrow the priors of the problems' nuisance to where the qualification found the instrument; which parameters."""
    told = []
    for problem in problems:
        for name, known in qualified.qualification.parameters.items():
            at = _place(problem, name)
            if at is None:
                continue
            k, mean, slope = at
            target = _solved(problem, name, known, k, mean, slope)
            sd = float(np.hypot(known.se, DRIFT * (known.tolerance or 0.0)) / abs(slope))
            wider = [w for w in (problem.prior_sd, *problem.prior_scales) if w[k] > sd]
            if not wider:
                continue
            problem.prior_mean[k] = target
            for widths in wider:
                widths[k] = sd
            told.append(name)
    return list(dict.fromkeys(told))


def moved(problems: Mapping[str, Problem], fits: Mapping[str, Fit], qualified: Qualified) -> list[str]:
    """Parameters that are clearly not where the qualification found them, in words."""
    said = []
    for block, problem in problems.items():
        for name, known in qualified.qualification.parameters.items():
            at = _place(problem, name)
            if at is None:
                continue
            k, _, _ = at
            away = (fits[block].nuisance[k] - problem.prior_mean[k]) / problem.prior_sd[k]
            if abs(away) > CLEARLY:
                value, unit = problem.quantities(fits[block].nuisance)[name]
                was = quantity(known.value, known.unit, known.se, name)
                said.append(f"{name} was {was} and is {quantity(value, unit, None, name)}")
    return list(dict.fromkeys(said))


def _place(problem: Problem, name: str) -> tuple[int, float, float] | None:
    """Which nuisance a quantity is read from, its prior mean, and the quantity's slope; None where that is not one."""
    mean = problem.prior_mean
    here = problem.quantities(mean)
    if name not in here:
        return None
    found = []
    for k in np.flatnonzero(problem.prior_sd > FROZEN):
        other = mean.copy()
        other[k] += 1e-4 * problem.prior_sd[k]
        slope = (problem.quantities(other)[name][0] - here[name][0]) / (1e-4 * problem.prior_sd[k])
        if slope:
            found.append((int(k), float(mean[k]), float(slope)))
    return found[0] if len(found) == 1 else None


def _solved(problem: Problem, name: str, known: Parameter, k: int, mean: float, slope: float) -> float:
    """The nuisance at which the quantity is what the qualification found."""
    there = problem.prior_mean.copy()
    there[k] = mean
    for _ in range(5):
        there[k] += (known.value - problem.quantities(there)[name][0]) / slope
    return float(there[k])
