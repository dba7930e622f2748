"""The object that `skinrig` finds through the entry point ``acquire.solvers``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from .api import Experiment, Model, Result
from .registry import models


class SkinrigSolver:
    """Forward models and identification for the three instruments."""

    name = "skinrig"

    def models(self) -> Mapping[str, Model]:
        """All forward models by name."""
        return models()

    def simulate(
        self, model: str, experiment: Experiment, parameters: Mapping[str, float], sensitivities: Sequence[str] = ()
    ) -> Result:
        """Run one model: see :meth:`skinrig_solver.api.Model.simulate`."""
        return models()[model].simulate(experiment, parameters, sensitivities)

    def fit(
        self, recordings: Sequence[Any], spec: Any = None, *, jobs: int = 1, cluster: str = "", **options: Any
    ) -> Any:
        """Identify parameters on ``jobs`` processes or a dask cluster: see :func:`skinrig_solver.fit.fit`."""
        from .fit import fit, workers  # a fit pulls in the optimisers; listing models must not

        with workers(jobs, cluster) as executor:
            return fit(recordings, spec, executor=executor, **options)

    def plan(
        self, fitted: Mapping[str, Any], parameter: str, experiments: Mapping[str, tuple[Experiment, float]]
    ) -> list[Any]:
        """The gain of further experiments for a parameter: see :func:`skinrig_solver.fit.plan.plan`.

        ``fitted`` is the data of a ``fit.json``; ``experiments`` maps a name to an experiment and its minutes.
        """
        from .fit.plan import Candidate, known, plan

        candidates = [Candidate(name, run, minutes) for name, (run, minutes) in experiments.items()]
        return plan(str(fitted.get("model")), known(fitted), candidates, parameter)

    def compare(self, recordings: Sequence[Any], laws: Sequence[str], *, jobs: int = 1, **options: Any) -> Any:
        """Which of several models recordings speak for: see :func:`skinrig_solver.fit.compare.compare`."""
        from .fit import workers
        from .fit.compare import compare

        with workers(jobs) as executor:
            return compare(recordings, laws, executor=executor, **options)

    def live(self, model: str, instrument: Any, time: Any, setpoints: Mapping[str, Any], **options: Any) -> Any:
        """A fit while a run goes on: see :class:`skinrig_solver.fit.live.LiveFit`."""
        from .fit.live import LiveFit

        return LiveFit(model, instrument, time, setpoints, **options)

    def models_of(self, instrument: str) -> list[str]:
        """Names of the models that can be fitted to an instrument's recordings."""
        from .fit.cases import INSTRUMENTS

        return [name for name, model in models().items() if instrument in INSTRUMENTS[model.info.problem]]

    def experiment(self, *arguments: Any, **options: Any) -> Experiment:
        """An :class:`skinrig_solver.api.Experiment`, for callers that do not import this package."""
        return Experiment(*arguments, **options)
