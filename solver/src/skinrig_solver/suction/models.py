"""The suction models: a law, its layers and their parameters, run through `march`."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from time import perf_counter
from typing import Any

import numpy as np

from ..api import Array, Cost, Experiment, ModelInfo, Result
from ..fem.body import Body
from ..fem.mesh import Index
from ..fem.snapshots import Snapshots
from ..fem.types import Directions, Load, Rim
from ..law import Law
from .geometry import SuctionGeometry
from .march import Run
from .schedule import Segment, interpolation, segments

THICKNESS = (
    "thickness_factor"  # of a layer's thickness in the geometry; optional, 1 where a model has no such parameter
)
_LOCK = threading.Lock()  # bodies are workspaces shared between runs


@dataclass(frozen=True)
class SuctionModel:
    """A law on a stack of layers. ``defaults`` maps an instrument to its default geometry options.

    A law parameter of a layer is the model parameter ``<layer>.<name>``, or ``<name>`` where there is one layer only;
    besides, every model has ``friction`` and ``spring_force``, and may have ``[<layer>.]thickness_factor``.
    """

    info: ModelInfo
    law: Law
    layers: tuple[str, ...]
    defaults: Mapping[str, Mapping[str, Any]]

    def geometry(self, experiment: Experiment) -> SuctionGeometry:
        """The experiment's geometry, checked."""
        if experiment.instrument not in self.defaults:
            raise ValueError(
                f"model {self.info.name} simulates {' and '.join(self.defaults)}, not {experiment.instrument!r}"
            )
        return SuctionGeometry.of(experiment, self.layers, self.defaults[experiment.instrument])

    def simulate(
        self, experiment: Experiment, parameters: Mapping[str, float], sensitivities: Sequence[str] = ()
    ) -> Result:
        """Channel ``apex_height`` [m] of the drive ``pressure`` [Pa]; see :class:`SuctionGeometry` for the options."""
        started = perf_counter()
        values = self.info.complete(parameters)
        geometry = self.geometry(experiment)
        if set(experiment.drive) != {"pressure"}:
            raise ValueError(f"model {self.info.name} needs the drive 'pressure', got {sorted(experiment.drive)}")
        for symbol in sensitivities:
            if self.info[symbol].symbol == "spring_force" and values[symbol] == 0.0:
                raise ValueError("the sensitivity to spring_force exists only for a positive force")
        pressure = experiment.drive["pressure"]
        pieces = segments(experiment.time, pressure, geometry.rise_time, geometry.steps)
        weights = interpolation(pieces, experiment.time)
        with _LOCK:
            recorder = self._march(geometry, values, tuple(sensitivities), pieces, experiment.snapshots)
            fields = recorder.snapshots.fields()
        run = recorder.run
        return Result(
            time=experiment.time,
            channels={"apex_height": weights @ np.array(recorder.height)},
            parameters=tuple(sensitivities),
            sensitivities={"apex_height": weights @ np.array(recorder.derivative)} if sensitivities else None,
            cost=Cost(1, perf_counter() - started, run.newton, run.steps, run.cuts, run.body.size),
            fields=fields,
            notes={"zero_displacement": recorder.bulge_at_start, "probe_height": run.state.height},
        )

    def _march(
        self,
        geometry: SuctionGeometry,
        values: Mapping[str, float],
        wanted: tuple[str, ...],
        pieces: list[Segment],
        moments: tuple[float, ...],
    ) -> _Recorder:
        body = _body(self.law, geometry)
        symbols = self._symbols(geometry)
        factors = {own[THICKNESS]: values.get(own[THICKNESS], 1.0) for own in symbols}
        nodes, moves = geometry.stretched(list(factors.values()))
        if not np.array_equal(nodes, body.mesh.nodes):
            body.place(replace(body.mesh, nodes=nodes))
        tissue = [np.array([values[own[s]] for s in self.law.parameters]) for own in symbols]
        run = Run(body, tissue, self._directions(symbols, wanted, dict(zip(factors, moves, strict=True))))
        friction, spring = values["friction"], values["spring_force"]
        if "friction" in wanted:
            friction = max(friction, 1e-6)  # the one-sided derivative at no friction
        if spring > 0.0:
            start = pieces[0].start
            preload = Segment(start - geometry.preload_time, start, 0.0, spring, PRELOAD_STEPS, 1.0)
            run.advance(preload, lambda force: Load(0.0, None, force, friction, force / spring), lambda _: None)
        held = None if geometry.probe == "floating" and spring > 0.0 else run.state.height
        times = moments or (max(pieces, key=lambda s: abs(s.drive_stop)).stop, pieces[-1].stop)
        snapshots = Snapshots(run, times, interpolation(pieces, np.array(times)), bool(moments))
        recorder = _Recorder(run, body, geometry.zero_at_start, snapshots)
        area = np.pi * (geometry.opening_radius + geometry.rim_fillet) ** 2
        for piece in pieces:
            run.advance(piece, lambda p: Load(p, held, spring - p * area, friction), recorder.visit)
        return recorder

    def _symbols(self, geometry: SuctionGeometry) -> list[dict[str, str]]:
        """For each layer, the symbols of the law's parameters and of the thickness by their names in the law."""
        names = (*self.law.parameters, THICKNESS)
        return [{n: f"{layer}.{n}" if len(self.layers) > 1 else n for n in names} for layer, _ in geometry.layers]

    def _directions(
        self, symbols: list[dict[str, str]], wanted: tuple[str, ...], moves: Mapping[str, Array]
    ) -> Directions | None:
        """The parameters ``wanted``, in this order, as a body differentiates by them; ``moves`` of thicknesses."""
        if not wanted:
            return None
        order = {symbol: k for k, symbol in enumerate(wanted)}
        return Directions(
            law=tuple(_places(wanted, [own[s] for s in self.law.parameters]) for own in symbols),
            friction=np.array([float(s == "friction") for s in wanted]),
            force=np.array([float(s == "spring_force") for s in wanted]),
            shape=tuple((order[s], move) for s, move in moves.items() if s in order),
        )


def _places(wanted: Sequence[str], own: Sequence[str]) -> Index:
    """Where each of ``wanted`` stands in ``own``, −1 where it does not."""
    return np.array([own.index(s) if s in own else -1 for s in wanted])


PRELOAD_STEPS = 4


class _Recorder:
    """Collects the apex height above the rim, its derivatives, and fields."""

    def __init__(self, run: Run, body: Body, zeroed: bool, snapshots: Snapshots) -> None:
        self.run, self.body, self.snapshots = run, body, snapshots
        top = body.mesh.edges["top"][0, 0]
        self.apex = int(top)
        self.equation = int(body.number[self.apex, 1])
        self.bulge_at_start = self._bulge()
        self.zero = self.bulge_at_start if zeroed else 0.0
        self.zero_derivative = self._derivative() if zeroed else 0.0 * self._derivative()
        self.height: list[float] = [self._bulge() - self.zero]
        self.derivative: list[Array] = [self._derivative() - self.zero_derivative]

    def visit(self, time: float) -> None:
        self.height.append(self._bulge() - self.zero)
        self.derivative.append(self._derivative() - self.zero_derivative)
        self.snapshots.visit()

    def _bulge(self) -> float:
        return float(self.run.state.u[self.apex, 1]) - self.run.state.height

    def _derivative(self) -> Array:
        tangents = self.run.tangents
        if tangents is None:
            return np.zeros(0)
        derivative: Array = tangents.du[self.equation] - tangents.du[-1]
        return derivative


@lru_cache(maxsize=16)
def _body(law: Law, geometry: SuctionGeometry) -> Body:
    mesh = geometry.build()
    fixed = np.zeros(mesh.nodes.shape, dtype=bool)
    fixed[np.unique(mesh.edges["bottom"])] = True
    fixed[np.unique(mesh.edges["left"]), 0] = True
    top = mesh.edges["top"]
    radius = mesh.nodes[top][:, :, 0]
    margin = 1e-6 * geometry.opening_radius
    # suction acts up to where the flat of the rim begins; the tissue beyond the bore's middle may touch the probe
    loaded = top[radius.max(axis=1) <= geometry.opening_radius + geometry.rim_fillet + margin]
    facing = (radius.min(axis=1) >= 0.5 * geometry.opening_radius) & (
        radius.max(axis=1) <= geometry.probe_radius + margin
    )
    rim = Rim(top[facing], geometry.opening_radius, geometry.rim_fillet)
    return Body(mesh, law, fixed, loaded, rim, geometry.opening_radius)
