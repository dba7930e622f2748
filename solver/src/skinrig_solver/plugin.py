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
