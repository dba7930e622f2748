"""The fingertip's cross-section in plane strain: how far the pad rises, and which layer decides it."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from functools import lru_cache
from time import perf_counter

import numpy as np

from ..api import Array, Cost, Experiment, ModelInfo, Parameter, Result
from ..fem.body import Body
from ..fem.snapshots import Snapshots
from ..fem.types import Directions, Load
from ..materials.yeoh_qlv import yeoh_qlv
from ..suction.march import Run
from ..suction.schedule import interpolation, segments
from .section import LAYERS, FingerGeometry

LAW = yeoh_qlv(1)
POISSON = {"bone": 0.30, "subcutis": 0.48, "dermis": 0.48, "epidermis": 0.48, "nail": 0.30}
_SOURCE = "assumed, of the order of Maeno et al. (1998)"
_LOCK = threading.Lock()  # bodies are workspaces shared between runs


class FingerSection:
    """Neo-Hookean layers, one Young's modulus each (Poisson's ratios assumed: ``POISSON``)."""

    info = ModelInfo(
        name="finger_section",
        problem="finger",
        parameters=(
            Parameter("bone.E", "Pa", 1e7, 1e11, 1.7e10, "Young's modulus of bone", _SOURCE, "log"),
            Parameter("subcutis.E", "Pa", 1e3, 1e7, 3.4e4, "Young's modulus of subcutis", _SOURCE, "log"),
            Parameter("dermis.E", "Pa", 1e3, 1e8, 8.0e4, "Young's modulus of dermis", _SOURCE, "log"),
            Parameter("epidermis.E", "Pa", 1e3, 1e8, 1.36e5, "Young's modulus of epidermis", _SOURCE, "log"),
            Parameter("nail.E", "Pa", 1e5, 1e10, 1.7e8, "Young's modulus of nail", _SOURCE, "log"),
        ),
        channels=("deflection",),
        description="Half a fingertip's cross-section under suction between two rims, plane strain",
        source="paper F (finger cross-section); dimensions and moduli assumed",
    )

    def simulate(
        self, experiment: Experiment, parameters: Mapping[str, float], sensitivities: Sequence[str] = ()
    ) -> Result:
        """Channel ``deflection`` [m]: rise of the pad's centre under the drive ``pressure`` [Pa, suction negative]."""
        started = perf_counter()
        values = self.info.complete(parameters)
        columns = [LAYERS.index(self.info[s].symbol.split(".")[0]) for s in sensitivities]
        if set(experiment.drive) != {"pressure"}:
            raise ValueError(f"model finger_section needs the drive 'pressure', got {sorted(experiment.drive)}")
        geometry = FingerGeometry.of(experiment.geometry)
        pieces = segments(experiment.time, experiment.drive["pressure"], 0.01)
        with _LOCK:
            body = _body(geometry)
            centre = int(body.mesh.edges["outside"][0, 0])
            directions = None
            if columns:
                modulus = LAW.parameters.index("G")
                law = tuple(np.where(np.array(columns) == k, modulus, -1) for k in range(len(LAYERS)))
                directions = Directions(law, np.zeros(len(columns)), np.zeros(len(columns)))
            run = Run(body, [_layer(name, values[f"{name}.E"]) for name in LAYERS], directions)
            rise, slopes = [0.0], [np.zeros(len(columns))]
            times = experiment.snapshots or (pieces[-1].stop,)
            snapshots = Snapshots(run, times, interpolation(pieces, np.array(times)), bool(experiment.snapshots))

            def visit(time: float) -> None:
                rise.append(float(run.state.u[centre, 1]))
                if run.tangents is not None:
                    slopes.append(run.tangents.du[body.number[centre, 1]].copy())
                snapshots.visit()

            for piece in pieces:
                run.advance(piece, Load, visit)
            fields = snapshots.fields()
        weights = interpolation(pieces, experiment.time)
        derivative: Array | None = None
        if columns:
            by_modulus = np.array([1.0 / (2.0 * (1.0 + POISSON[LAYERS[k]])) for k in columns])  # dG/dE
            derivative = weights @ np.array(slopes) * by_modulus
        return Result(
            time=experiment.time,
            channels={"deflection": weights @ np.array(rise)},
            parameters=tuple(sensitivities),
            sensitivities=None if derivative is None else {"deflection": derivative},
            cost=Cost(1, perf_counter() - started, run.newton, run.steps, run.cuts, body.size),
            fields=fields,
        )


def _layer(name: str, modulus: float) -> Array:
    values = {"G": modulus / (2.0 * (1.0 + POISSON[name])), "nu": POISSON[name], "tau1": 1.0}
    return np.array([values.get(symbol, 0.0) for symbol in LAW.parameters])


@lru_cache(maxsize=8)
def _body(geometry: FingerGeometry) -> Body:
    mesh = geometry.build()
    fixed = np.zeros(mesh.nodes.shape, dtype=bool)
    fixed[np.unique(mesh.edges["symmetry"]), 0] = True
    outside = mesh.edges["outside"]
    x, y = mesh.nodes[outside][:, :, 0], mesh.nodes[outside][:, :, 1]
    margin, pad = 1e-9, np.all(y > 0.0, axis=1)
    loaded = outside[pad & (x.max(axis=1) <= geometry.opening + margin)]
    rim = outside[
        pad & (x.min(axis=1) >= geometry.opening - margin) & (x.max(axis=1) <= geometry.opening + geometry.rim + margin)
    ]
    fixed[np.unique(rim), 1] = True  # the rim holds the skin down, and lets it slide
    if geometry.support == "bone":
        fixed[np.unique(mesh.edges["cavity"])] = True
    else:
        nail = mesh.elements[mesh.layer == LAYERS.index("nail")]
        fixed[np.intersect1d(np.unique(nail), np.unique(outside))] = True
    return Body(mesh, LAW, fixed, loaded, None, geometry.opening)


FINGER_SECTION = FingerSection()
