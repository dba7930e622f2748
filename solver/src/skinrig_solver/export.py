"""Fields as files that ParaView and others open: VTU, one a time with a PVD of their times, and one XDMF time series.

Needs meshio: ``pip install 'skinrig-solver[view]'``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .api import Array, Field

MEANING: dict[str, tuple[str, str]] = {
    "displacement": ("m", "from the state that node positions refer to; three components"),
    "layer": ("", "number of the tissue layer (or sheet), see layer_names"),
    "cauchy_stress": ("Pa", "xx, yy, zz, xy, yz, xz"),
    "stress_max": ("Pa", "largest principal Cauchy stress, tension positive"),
    "stress_von_mises": ("Pa", "von Mises' equivalent Cauchy stress"),
    "pressure": ("Pa", "minus a third of the Cauchy stress's trace"),
    "stretch_max": ("", "largest principal stretch"),
    "stretch_min": ("", "smallest principal stretch"),
    "volume_ratio": ("", "volume over its value at rest"),
}
HISTORY = ("", "state variable of the material's law, in the law's own unit")
_FLAT = "x, y, z"
_SECTION = "x is the radius (or the width of a plane section), y the height, z the hoop (or normal) direction"


def write(fields: Sequence[Field], folder: Path, name: str) -> list[Path]:
    """Write the fields of one run, earliest first, and an index of names and units; returns the files.

    ``<name>_0000.vtu`` and so on with biquadratic cells (mid-nodes and centre included), ``<name>.pvd`` that gives each
    its time, ``<name>.xdmf``, and ``<name>.json``. Raises ImportError that says what to install;
    ValueError for no fields; OSError.
    """
    try:
        import meshio
    except ImportError as error:
        raise ImportError(f"files of fields need {error.name}: pip install 'skinrig-solver[view]'") from error
    if not fields:
        raise ValueError(f"{name}: the model gave no fields")
    folder.mkdir(parents=True, exist_ok=True)
    ordered = sorted(fields, key=lambda f: f.time)
    meshes = [_mesh(meshio, field) for field in ordered]
    snapshots = [folder / f"{name}_{k:04d}.vtu" for k in range(len(meshes))]
    for mesh, path in zip(meshes, snapshots, strict=True):
        mesh.write(path)
    collection, index = folder / f"{name}.pvd", folder / f"{name}.json"
    collection.write_text(_collection([f.time for f in ordered], snapshots), encoding="utf-8")
    index.write_text(json.dumps(_index(ordered, snapshots), indent=1) + "\n", encoding="utf-8")
    return [*snapshots, collection, _series(meshio, ordered, meshes, folder / f"{name}.xdmf"), index]


def file_name(label: str) -> str:
    """A recording's label as a file name."""
    return re.sub(r"[^\w.+-]+", "_", label).strip("._") or "run"


def _mesh(meshio: Any, field: Field) -> Any:
    return meshio.Mesh(
        _three(field.nodes),
        [("quad9", field.cells)],
        point_data={"displacement": _three(field.displacement), **field.values},
        cell_data={"layer": [field.layer.astype(np.int32)]},
    )


def _three(vectors: Array) -> Array:
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def _series(meshio: Any, fields: Sequence[Field], meshes: Sequence[Any], path: Path) -> Path:
    """One XDMF file; its mesh is written once, since only the displacement moves.

    Numbers stand in the XML itself: with HDF5 meshio would write them to the working directory.
    """
    with meshio.xdmf.TimeSeriesWriter(path, data_format="XML") as writer:
        writer.write_points_cells(meshes[0].points, meshes[0].cells)
        for field, mesh in zip(fields, meshes, strict=True):
            writer.write_data(field.time, point_data=mesh.point_data, cell_data=mesh.cell_data)
    return path


def _collection(times: Sequence[float], files: Sequence[Path]) -> str:
    rows = "".join(
        f'    <DataSet timestep="{time!r}" file="{file.name}"/>\n' for time, file in zip(times, files, strict=True)
    )
    return (
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n'
        f"  <Collection>\n{rows}  </Collection>\n</VTKFile>\n"
    )


def _index(fields: Sequence[Field], files: Sequence[Path]) -> dict[str, Any]:
    names = ["displacement", "layer", *fields[0].values]
    return {
        "schema": "skinrig-fields/1",
        "axes": _SECTION if fields[0].nodes.shape[1] == 2 else _FLAT,
        "length_unit": "m",
        "layer_names": list(fields[0].layer_names),
        "times": [{"time": f.time, "file": file.name} for f, file in zip(fields, files, strict=True)],
        "quantities": [
            {"name": n, "unit": unit, "meaning": words} for n in names for unit, words in [MEANING.get(n, HISTORY)]
        ],
    }
