"""Which of several laws recordings speak for: their evidence, on the same data and with the same noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..api import Model
from ..registry import models
from .cases import cases
from .posterior import Posterior, posterior
from .problem import Problem
from .result import FitResult
from .run import Observer, Progress, fit
from .spec import Spec
from .target import Noise

DECISIVE = 5.0  # difference of log evidence, 150 to 1, below which laws are called as good as each other


@dataclass(frozen=True)
class Law:
    """One model's fit and posterior; ``log_evidence`` and its error by importance sampling."""

    name: str
    fit: FitResult
    posterior: Posterior

    @property
    def log_evidence(self) -> float:
        return self.posterior.log_evidence[0]

    @property
    def error(self) -> float:
        return self.posterior.log_evidence[1]


@dataclass(frozen=True)
class Comparison:
    """Laws with the best first. ``noise`` [SI of its channel] is each compared curve's deviation in all of them."""

    laws: tuple[Law, ...]
    noise: tuple[float, ...]

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        best = self.laws[0].log_evidence
        return {
            "noise": self.noise,
            "laws": [
                {
                    "model": law.name,
                    "free": [e.free.symbol for e in law.fit.estimates],
                    "vaf": law.fit.vaf,
                    "log_evidence": law.log_evidence,
                    "error": law.error,
                    "below_best": best - law.log_evidence,
                    "fit_trusted": law.fit.trusted,
                    "posterior_trusted": law.posterior.trusted,
                }
                for law in self.laws
            ],
        }

    def in_words(self) -> str:
        """A table and a sentence for a terminal."""
        best, size = self.laws[0], max(len(law.name) for law in self.laws)
        lines = [f"{'model':<{size}}  free      VAF  log evidence      below the best"]
        for law in self.laws:
            doubt = "" if law.posterior.trusted else "  (posterior not to be trusted)"
            lines.append(
                f"{law.name:<{size}}  {len(law.fit.estimates):4d}  {100 * law.fit.vaf:5.2f} %"
                f"  {law.log_evidence:10.1f} ± {law.error:<4.1f}  {best.log_evidence - law.log_evidence:10.1f}{doubt}"
            )
        rivals = [law.name for law in self.laws[1:] if best.log_evidence - law.log_evidence < DECISIVE]
        if rivals:
            lines.append(f"the data do not tell {best.name} from {' and '.join(rivals)}")
        else:
            lines.append(f"the data speak for {best.name}")
        if not best.fit.describes:
            lines.append(f"{best.name} leaves what is no noise: none of these laws is the right one")
        return "\n".join(lines)


def compare(
    recordings: Sequence[Any],
    laws: Sequence[str | Model],
    specs: Mapping[str, Spec | Mapping[str, Any]] | None = None,
    executor: Executor | None = None,
    progress: Observer | None = None,
) -> Comparison:
    """Fit every law and integrate its posterior; ``specs`` by model name (priors, starts), else the papers' parameters.

    The noise of all is that of the law whose residuals are smallest: with a noise of its own each law would explain its
    misfit as noise. Without priors a law pays for the whole range between its bounds. Raises SpecError, RecordingError,
    FitError; ValueError for fewer than two laws or for channels that differ.
    """
    if len(laws) < 2:
        raise ValueError("a comparison needs two laws at least")
    fits = [_fitted(recordings, law, specs or {}, executor, progress) for law in laws]
    channels = [[(c.label, c.channel) for c in result.curves] for result, _ in fits]
    if any(own != channels[0] for own in channels):
        raise ValueError("laws can be compared on the same channels of the same recordings only")
    best = min((result for result, _ in fits), key=lambda r: r.objective)
    noise = Noise(tuple(c.noise for c in best.curves), tuple(c.persistence for c in best.curves))
    found = []
    for result, problem in fits:
        z = np.array([f.coordinate(result.parameters[f.symbol]) for f in problem.variables.free])

        def told(what: str, name: str = result.info.name) -> None:
            if progress is not None:
                progress(Progress(f"{name}: {what}", 0, 0, float("nan"), 0.0))

        found.append(Law(result.info.name, result, posterior(problem, z, noise, result.spec.seed, executor, told)))
    found.sort(key=lambda law: -law.log_evidence)
    return Comparison(tuple(found), noise.deviation)


def _fitted(
    recordings: Sequence[Any],
    law: str | Model,
    specs: Mapping[str, Spec | Mapping[str, Any]],
    executor: Executor | None,
    progress: Observer | None,
) -> tuple[FitResult, Problem]:
    model = models()[law] if isinstance(law, str) else law
    result = fit(recordings, specs.get(model.info.name), model=law, executor=executor, progress=progress)
    variables = result.spec.variables(model.info)
    return result, Problem(law, cases(recordings, result.spec, model.info), variables, executor)
