"""The micro-robot's sheet as a forward model: one per law.

Paper M: a sheet under in-plane pre-stress is glued to a probe, held around a support's hole, and the probe is moved.
Parameters are the law's, the pre-stress sx, sy and two relaxation terms, the second off by default.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from ..api import Array, Cost, Experiment, ModelInfo, Parameter, Result
from ..laws import Law
from .history import history_force
from .options import Options
from .response import Response

AXES = ("x", "y", "z")
CHANNELS = tuple(f"force_{axis}" for axis in AXES)
LEFT = 0.05  # share of the skin between probe and hole that a path must leave, or elements fold
TEARS = 1.54  # stretch at which excised human skin fails on average (Ní Annaidh et al., JMBBM 5, 2012)


@dataclass(frozen=True)
class SheetModel:
    """A sheet of one law; implements ``skinrig_solver.api.Model``.

    Drive: ``probe_x|y|z`` [m], a missing one is zero. Channels: ``force_x|y|z`` [N], which the skin exerts on the
    probe. Geometry options: see ``options.Options``. Sensitivities are exact for samples on the rays of the path
    (rays.py), and to second order in the distance for samples off them.
    """

    law: Law

    @property
    def info(self) -> ModelInfo:
        sx, sy = self.law.prestress
        shared = (
            Parameter("sx", "Pa", 0.0, 1e6, sx, "pre-stress along x", self.law.source),
            Parameter("sy", "Pa", 0.0, 1e6, sy, "pre-stress along y", self.law.source),
            Parameter("gbar", "", 0.0, 0.95, 0.4, "relaxing share of the stress", "M"),
            Parameter("tau", "s", 1e-3, 1e4, 0.8, "its relaxation time", "M", "log"),
            Parameter("gbar2", "", 0.0, 0.95, 0.0, "share of a second relaxation", "assumed"),
            Parameter("tau2", "s", 1e-3, 1e5, 10.0, "its relaxation time", "assumed", "log"),
        )
        return ModelInfo(
            f"sheet_{self.law.name}",
            "sheet",
            self.law.parameters + shared,
            CHANNELS,
            f"sheet of skin under a three-axis probe, {self.law.name} law with quasi-linear viscoelasticity",
            self.law.source,
        )

    def simulate(
        self, experiment: Experiment, parameters: Mapping[str, float], sensitivities: Sequence[str] = ()
    ) -> Result:
        """Forces on the probe's path; see ``api.Model``."""
        began = perf_counter()
        info = self.info
        values = info.complete(parameters)
        columns = [info.symbols.index(info[symbol].symbol) for symbol in sensitivities]
        options = Options.read(experiment.geometry)
        positions = _path(experiment, options)
        if sensitivities and (options.relaxation == "history" or options.element == "solid"):
            raise ValueError("sensitivities need geometry options relaxation='convolution' and element='membrane'")
        response = Response(self.law, values, options)
        slopes = None
        if options.relaxation == "history":
            force = history_force(response, experiment.time, positions)
        else:
            force, derivatives = response.force(experiment.time, positions, bool(columns))
            if columns:
                slopes = {channel: derivatives[columns, :, k].T for k, channel in enumerate(CHANNELS)}
        if experiment.snapshots:
            fields = response.pictures(experiment.time, positions, experiment.snapshots)
        else:
            fields = () if response.field is None else (response.field,)
        work = response.work
        return Result(
            experiment.time,
            {channel: np.ascontiguousarray(force[:, k]) for k, channel in enumerate(CHANNELS)},
            tuple(sensitivities),
            slopes,
            Cost(1, perf_counter() - began, work.iterations, work.steps, work.cuts, 3 * len(options.mesh().nodes)),
            fields,
            {f"prestretch_{axis}": float(x) for axis, x in zip("xy", response.state.stretches, strict=True)},
            _tears(values, response.state.stretches),
        )


def _tears(values: Mapping[str, float], stretches: Iterable[float]) -> tuple[str, ...]:
    """Warnings of a pre-stress that skin would not stand."""
    return tuple(
        f"s{axis} = {values[f's{axis}']:.3g} Pa stretches the sheet to {x:.2f} times its length along {axis}; "
        f"skin tears near {TEARS}"
        for axis, x in zip("xy", stretches, strict=True)
        if x > TEARS
    )


def _path(experiment: Experiment, options: Options) -> Array:
    """The probe's positions (n, 3) [m]; refuses other instruments, drives by name, and a probe that meets the hole."""
    if experiment.instrument != "microrobot":
        raise ValueError(f"a sheet model needs a microrobot experiment, got {experiment.instrument!r}")
    names = [f"probe_{axis}" for axis in AXES]
    unknown = sorted(set(experiment.drive) - set(names))
    if unknown or not experiment.drive:
        what = f"drive {unknown[0]!r} is unknown" if unknown else "there is no drive"
        raise ValueError(f"{what}; a sheet model is driven by {', '.join(names)}")
    zero = np.zeros_like(experiment.time)
    positions = np.stack([experiment.drive.get(name, zero) for name in names], axis=1)
    aside = float(np.hypot(positions[:, 0], positions[:, 1]).max())
    free = options.hole_radius - options.probe_radius
    if aside > (1.0 - LEFT) * free:
        raise ValueError(
            f"probe_x and probe_y move the probe {1e3 * aside:.3g} mm aside, to or beyond the edge of the hole: "
            f"there are {1e3 * free:.3g} mm of free skin between them (hole_radius less probe_radius)"
        )
    return positions
