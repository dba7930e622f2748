"""Pictures of fields: a deformed section or sheet, its layers, stress and stretch; curved edges are curves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..api import Array, Field
from ..fem.mesh import point_shapes
from ..nodal import VTK
from .figures import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LAYERS = ("#f2c9a5", "#e8a0a0", "#b86b6b", "#c9c9d9", "#d9d2b0")
EDGE = "#6b5b53"
SHOWN = {  # quantity -> factor and words of its colour bar, colour map
    "stress_max": (1e-3, "largest principal stress, kPa", "RdYlBu_r"),
    "stretch_max": (1.0, "largest principal stretch", "viridis"),
    "displacement": (1e3, "displacement, mm", "magma_r"),
}
_FINE = 4  # parts of an element's side that its curve and colours are drawn by
_GRID = np.linspace(-1.0, 1.0, _FINE + 1)
_XI, _ETA = (g.ravel() for g in np.meshgrid(_GRID, _GRID))
_SHAPES = point_shapes(_XI, _ETA)[0][:, VTK]  # (25, 9) on the nodes in VTK's order
_AROUND = np.concatenate([
    np.arange(_FINE), (_FINE + 1) * np.arange(_FINE) + _FINE,
    (_FINE + 1) ** 2 - 1 - np.arange(_FINE), (_FINE + 1) * np.arange(_FINE, 0, -1),
])  # fmt: skip


def mesh(field: Field) -> Figure:
    """The deformed mesh: a plane or axisymmetric section by layer, a sheet by how far its points moved."""
    if _is_section(field):
        figure, (axis,) = _frames(field, 1)
        _draw_layers(axis, field)
        axis.legend(loc="lower right", fontsize=8, frameon=True)
        return figure
    return quantities(field, ("displacement",))


def quantities(field: Field, names: Sequence[str] = ("stress_max", "stretch_max")) -> Figure:
    """One picture of the deformed body for each of the named quantities, in colour."""
    figure, axes = _frames(field, len(names))
    for axis, name in zip(axes, names, strict=True):
        factor, words, colours = SHOWN[name]
        values = np.linalg.norm(field.displacement, axis=1) if name == "displacement" else field.values[name]
        shades = _shade(axis, field, factor * values, colours, centred=name == "stress_max")
        figure.colorbar(shades, ax=axis, shrink=0.9, label=words)
    return figure


def has_quantities(field: Field) -> bool:
    """Whether a field carries what `quantities` shows."""
    return {"stress_max", "stretch_max"} <= set(field.values)


def _is_section(field: Field) -> bool:
    return bool(field.nodes.shape[1] == 2)


def _position(field: Field) -> Array:
    """Deformed positions [mm] in the plane that is drawn."""
    return np.asarray(1e3 * (field.nodes + field.displacement)[:, :2])


def _sides(field: Field) -> tuple[float, ...]:
    """A section is drawn with its mirror image."""
    return (1.0, -1.0) if _is_section(field) else (1.0,)


def _frames(field: Field, count: int) -> tuple[Figure, list[Any]]:
    """A figure with axes around what moved: a wide section is cut where the displacement has died away."""
    position = _position(field)
    moved = np.linalg.norm(field.displacement, axis=1)
    if _is_section(field):
        reach = 2.0 * np.abs(position[moved > 0.2 * moved.max(initial=0.0), 0]).max(initial=0.5)
        low, high = max(float(position[:, 1].min()), -0.5 * reach), float(position[:, 1].max())
        box = (-reach, reach, low, high + 0.06 * (high - low))
        label = "mm"
        columns = 1
    else:
        reach = 1.03 * float(np.abs(position).max())
        box, label, columns = (-reach, reach, -reach, reach), "x, mm", min(count, 2)
    rows = -(-count // columns)
    width = 9.0 / columns
    height = float(np.clip((width - 1.2) * (box[3] - box[2]) / (box[1] - box[0]) + 0.5, 1.6, 6.5))
    figure = new_figure(9.0 if count > 1 or columns == 1 else 6.0, rows * height)
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel()[:count])
    for axis in axes:
        axis.set_xlim(box[0], box[1])
        axis.set_ylim(box[2], box[3])
        axis.set_aspect("equal")
        axis.grid(False)
        axis.set_xlabel(label)
        axis.set_ylabel("mm" if _is_section(field) else "y, mm")
    return figure, axes


def _draw_layers(axis: Any, field: Field) -> None:
    from matplotlib.collections import PolyCollection

    fine = np.einsum("fn,enc->efc", _SHAPES, _position(field)[field.cells])[:, _AROUND]
    for side in _sides(field):
        for number, name in enumerate(field.layer_names):
            shapes = list(fine[field.layer == number] * (side, 1.0))
            colour = LAYERS[number % len(LAYERS)]
            label = name if side > 0 else None
            axis.add_collection(PolyCollection(shapes, facecolor=colour, edgecolor=EDGE, lw=0.3, label=label))


def _shade(axis: Any, field: Field, values: Array, colours: str, centred: bool) -> Any:
    """Colours that follow the elements' own shape functions, under the elements' curved edges."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import Normalize, TwoSlopeNorm
    from matplotlib.tri import Triangulation

    fine = np.einsum("fn,enc->efc", _SHAPES, _position(field)[field.cells])
    shade = values[field.cells] @ _SHAPES.T
    low, high = np.percentile(shade, [1.0, 99.0])  # the rim's peak would leave no colours for the rest
    high = max(high, low + 1e-9)
    norm = TwoSlopeNorm(0.0, low, high) if centred and low < 0.0 < high else Normalize(low, high)
    corner = (_FINE + 1) * np.arange(_FINE)[:, None] + np.arange(_FINE)
    a = corner.ravel()
    pair = np.concatenate([
        np.stack([a, a + 1, a + _FINE + 2], axis=1), np.stack([a, a + _FINE + 2, a + _FINE + 1], axis=1),
    ])  # fmt: skip
    triangles = (pair[None] + len(_XI) * np.arange(len(fine))[:, None, None]).reshape(-1, 3)
    points = fine.reshape(-1, 2)
    for side in _sides(field):
        drawn = Triangulation(side * points[:, 0], points[:, 1], triangles)
        shades = axis.tripcolor(drawn, shade.ravel(), shading="gouraud", cmap=colours, norm=norm)
        outline = fine[:, np.append(_AROUND, _AROUND[0])] * (side, 1.0)
        axis.add_collection(LineCollection(list(outline), colors=EDGE, linewidths=0.25, alpha=0.7))
    return shades
