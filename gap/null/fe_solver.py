"""Finite-element models of a solver plug-in, found through the entry point group ``acquire.solvers``.

Nothing here imports the plug-in: its models are objects that take an experiment and parameters by name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from acquire.plugins import plugins
from sim_devices.chain import FloatArray


@dataclass(frozen=True)
class Experiment:
    """The input of a model: drive (n,) by name, SI, on ``time`` (n,) s, and geometry options."""

    instrument: str
    time: FloatArray
    drive: Mapping[str, FloatArray]
    geometry: Mapping[str, Any] = field(default_factory=dict)
    label: str = ""


@dataclass
class FeModel:
    """A model of the plug-in that counts its solves."""

    name: str
    model: Any
    solves: int = 0

    @property
    def problem(self) -> str:
        """``suction``, ``sheet`` or another kind of problem."""
        return str(self.model.info.problem)

    @property
    def symbols(self) -> tuple[str, ...]:
        return tuple(self.model.info.symbols)

    @property
    def defaults(self) -> dict[str, float]:
        return dict(self.model.info.defaults)

    def simulate(
        self, experiment: Experiment, parameters: Mapping[str, float], sensitivities: Sequence[str] = ()
    ) -> tuple[FloatArray, FloatArray]:
        """Channels (c, n) in the model's order and their derivatives (c, n, m) by the named parameters.

        Raises ValueError for parameters the model refuses, and for equations that it cannot solve, with its reason.
        """
        self.solves += 1
        try:
            result = self.model.simulate(experiment, parameters, tuple(sensitivities))
        except RuntimeError as error:
            raise ValueError(f"finite elements {self.name}: {error}") from error
        names = self.model.info.channels
        values = np.stack([result.channels[c] for c in names])
        if not sensitivities:
            return values, np.empty((*values.shape, 0))
        return values, np.stack([result.sensitivities[c] for c in names])


def fe_model(name: str) -> FeModel:
    """The model ``name`` of any installed solver plug-in.

    Raises ValueError that names the missing part: the plug-in, its import, or the model.
    """
    found = plugins("acquire.solvers")
    if not found:
        raise ValueError(
            f"finite-element tissue {name!r} needs a solver plug-in (entry point group acquire.solvers) and none is "
            "installed: install skinrig-solver, or diagnose without --solver"
        )
    known: list[str] = []
    for plugin in found.values():
        if plugin.working:
            solver = plugin.object() if isinstance(plugin.object, type) else plugin.object
            models = solver.models()
            if name in models:
                return FeModel(name, models[name])
            known += models
    broken = [f"; {p.value} does not load: {p.error}" for p in found.values() if p.error]
    raise ValueError(f"no finite-element model {name!r}; there are {', '.join(known) or 'none'}{''.join(broken)}")
