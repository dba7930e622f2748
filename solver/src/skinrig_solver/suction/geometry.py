"""Options of a suction experiment and the mesh they ask for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ..api import Array, Experiment
from ..fem.mesh import Mesh, block, graded

GROWTH = (0.5, 1.5, 1.1)  # of cells from the rim inwards, outwards and down: the fewest unknowns for .5 % in six cases


@dataclass(frozen=True)
class SuctionGeometry:
    """Everything about the set-up that is not a material parameter (SI).

    Parameters
    ----------
    opening_radius : radius of the probe's opening [m]
    layers : (name, thickness [m]) pairs from the surface down
    radius : outer radius of the modelled tissue [m]; its side is free, its bottom fixed
    rim_fillet : radius of the opening's rounded edge [m]; assumed 0.1 opening radii where not given
    probe_radius : outer radius of the annulus [m]
    probe : 'held' keeps the probe where the preload left it; 'floating' lets spring and vacuum press it down throughout
    preload_time : duration of the preload [s]
    zero_at_start : report heights from the first sample on (as the Cutometer does) or from the undeformed surface
    rise_time : time in which a pressure present at the first sample was reached [s]
    mesh, steps : density of the mesh and of the time steps, 1 for about 0.5 % error of the apex
    """

    opening_radius: float
    layers: tuple[tuple[str, float], ...]
    radius: float
    rim_fillet: float
    probe_radius: float = np.inf
    probe: str = "held"
    preload_time: float = 1.0
    zero_at_start: bool = True
    rise_time: float = 0.01
    mesh: float = 1.0
    steps: float = 1.0

    def __post_init__(self) -> None:
        positive = ("opening_radius", "radius", "rim_fillet", "preload_time", "rise_time", "mesh", "steps")
        for name in positive:
            if not getattr(self, name) > 0.0:
                raise ValueError(f"geometry option {name} must be positive, is {getattr(self, name)}")
        if self.probe not in ("held", "floating"):
            raise ValueError(f"geometry option probe must be 'held' or 'floating', is {self.probe!r}")
        for layer, thickness in self.layers:
            if not thickness > 0.0:
                raise ValueError(f"geometry option layers: {layer} has thickness {thickness}")
        edge = self.opening_radius + self.rim_fillet
        if not self.probe_radius > edge:
            raise ValueError(
                f"geometry option probe_radius {self.probe_radius} m does not reach beyond the rim, {edge} m"
            )
        if not self.radius > 2.0 * edge:
            raise ValueError(f"geometry option radius {self.radius} m is less than twice the opening, {edge} m")

    @staticmethod
    def of(experiment: Experiment, layer_names: tuple[str, ...], defaults: Mapping[str, Any]) -> SuctionGeometry:
        """The experiment's options over ``defaults``; refuses unknown names and layers."""
        known = {f.name for f in fields(SuctionGeometry)}
        options = dict(experiment.geometry)
        for name in options:
            if name not in known:
                raise ValueError(f"suction has no geometry option {name!r}; it has {', '.join(sorted(known))}")
        layers = options.get("layers", defaults["layers"])
        pairs = tuple((str(n), float(h)) for n, h in (layers.items() if isinstance(layers, Mapping) else layers))
        for name, _ in pairs:
            if name not in layer_names:
                raise ValueError(f"geometry option layers: no layer {name!r}; the model has {', '.join(layer_names)}")
        merged = {**defaults, **options, "layers": pairs}
        merged.setdefault("rim_fillet", 0.1 * merged["opening_radius"])
        return SuctionGeometry(**merged)

    def stretched(self, factors: Sequence[float]) -> tuple[Array, list[Array]]:
        """Nodes of `build` with each layer's thickness scaled, and their derivative by each factor: (N, 2) [m]."""
        nodes = self.build().nodes
        depths = np.concatenate([[0.0], np.cumsum([thickness for _, thickness in self.layers])])
        moves = []
        for k, (_, thickness) in enumerate(self.layers):
            move = np.zeros_like(nodes)
            move[:, 1] = -np.interp(-nodes[:, 1], depths, thickness * (np.arange(len(depths)) > k))
            moves.append(move)
        return nodes + sum((f - 1.0) * move for f, move in zip(factors, moves, strict=True)), moves

    def build(self) -> Mesh:
        """Cells refined towards rim and surface; grid lines at the bore, the fillet's end and the probe's edge."""
        a, fillet = self.opening_radius, self.rim_fillet
        h = 0.5 * min(fillet, 0.25 * a) / self.mesh
        inwards, outwards, downwards = (1.0 + growth / self.mesh for growth in GROWTH)
        inner = graded(a, 0.0, h, inwards)[::-1]
        across = graded(a, a + fillet, h, 1.0)
        outer = [graded(a + fillet, self.radius, 1.5 * h, outwards)]
        if self.probe_radius < self.radius:
            first = graded(a + fillet, self.probe_radius, 1.5 * h, outwards)
            outer = [first, graded(self.probe_radius, self.radius, first[-1] - first[-2], outwards)]
        r = np.concatenate([inner, across[1:], *(part[1:] for part in outer)])
        top, size, z, rows = 0.0, h, [np.zeros(1)], []
        for number, (_, thickness) in enumerate(self.layers):
            part = graded(top, top - thickness, size, downwards)
            size, top = float(part[-2] - part[-1]), top - thickness
            z.append(part[1:])
            rows.append(np.full(len(part) - 1, number))
        names = tuple(name for name, _ in self.layers)
        return block(r, np.concatenate(z), np.concatenate(rows), names, axisymmetric=True)
