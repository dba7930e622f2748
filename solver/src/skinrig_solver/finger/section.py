"""Geometry and mesh of half a fingertip's cross-section, built from its dimensions.

The pad is up. Rings around the bone's cavity: bone, subcutis, dermis, and outside epidermis on the pad's side, nail on
the other. Fingerprint ridges modulate the outline of the pad.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ..api import Array
from ..fem.mesh import Mesh, graded

LAYERS = ("bone", "subcutis", "dermis", "epidermis", "nail")


@dataclass(frozen=True)
class FingerGeometry:
    """Dimensions [m] of a fingertip and of the probe on it. All defaults are assumed: typical of an adult index finger.

    Parameters
    ----------
    half_width, half_height : of the finger's outline, an ellipse
    bone_half_width, bone_half_height, bone_offset : the bone's ellipse, its centre shifted towards the nail
    cavity : size of the bone's cavity relative to the bone
    epidermis, dermis : thicknesses
    nail_angle : half the arc that the nail covers [rad]
    ridge_height, ridge_pitch : of the fingerprint; a height of zero makes a smooth pad
    opening : half the width of the probe's opening; suction acts inside
    rim : width of the probe's rim, on which the skin is held
    support : 'nail' (its outside is held, the finger lies on it) or 'bone' (the cavity's wall is held)
    mesh : density of the mesh
    """

    half_width: float = 8.0e-3
    half_height: float = 6.5e-3
    bone_half_width: float = 3.5e-3
    bone_half_height: float = 2.2e-3
    bone_offset: float = 1.2e-3
    cavity: float = 0.3
    epidermis: float = 0.5e-3
    dermis: float = 1.0e-3
    nail_angle: float = 0.9
    ridge_height: float = 0.1e-3
    ridge_pitch: float = 0.5e-3
    opening: float = 2.0e-3
    rim: float = 2.0e-3
    support: str = "nail"
    mesh: float = 1.0

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name != "support" and not (value > 0.0 or (f.name == "ridge_height" and value == 0.0)):
                raise ValueError(f"geometry option {f.name} must be positive, is {value}")
        if self.support not in ("nail", "bone"):
            raise ValueError(f"geometry option support must be 'nail' or 'bone', is {self.support!r}")
        if self.opening + self.rim > 0.9 * self.half_width:
            raise ValueError(f"geometry options opening and rim reach {self.opening + self.rim} m, beyond the pad")
        below = self.half_height - self.bone_half_height - self.bone_offset - self.epidermis - self.dermis
        if below < 0.1e-3 or self.bone_half_width + self.epidermis + self.dermis > 0.9 * self.half_width:
            raise ValueError("geometry: bone, dermis and epidermis leave no room for subcutis")

    @staticmethod
    def of(options: Mapping[str, Any]) -> FingerGeometry:
        known = {f.name for f in fields(FingerGeometry)}
        for name in options:
            if name not in known:
                raise ValueError(f"finger_section has no geometry option {name!r}; it has {', '.join(sorted(known))}")
        return FingerGeometry(**options)

    def build(self) -> Mesh:
        """Half the section (x >= 0), symmetric about x = 0; edges ``outside`` from the pad's centre to the nail's."""
        angles, ring = self._angles(), self._rings()
        fine_angle, fine_ring = (np.insert(v, np.arange(1, len(v)), 0.5 * (v[1:] + v[:-1])) for v in (angles, ring))
        nodes = np.stack([self._position(fine_angle, level) for level in fine_ring]).reshape(-1, 2)
        columns, rows, width = len(angles) - 1, len(ring) - 1, len(fine_angle)
        row, column = (v.ravel() for v in np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"))
        offsets = np.array([[j * width + i for i in range(3)] for j in range(3)]).ravel()
        elements = (2 * row * width + 2 * column)[:, None] + offsets
        layer = np.floor(ring[:-1] + 1e-9).astype(np.int64)[row]
        middle = 0.5 * (angles[1:] + angles[:-1])[column]
        layer = np.where((layer == 3) & (middle > np.pi - self.nail_angle), 4, layer)
        order = np.argsort(layer, kind="stable")
        along = 2 * np.arange(columns)[:, None] + np.arange(3)
        edges = {"outside": along + 2 * rows * width, "cavity": along}
        ends = np.arange(0, len(nodes), width)
        edges["symmetry"] = np.stack([ends, ends + width - 1], axis=1)
        return Mesh(nodes, elements[order], layer[order], LAYERS, edges, axisymmetric=False)

    def _angles(self) -> Array:
        """Breakpoints of the angle from the pad's centre: several cells a ridge on the pad, growing beyond."""
        per_ridge = max(3, round(4 * self.mesh)) if self.ridge_height > 0.0 else max(2, round(2 * self.mesh))
        step = self.ridge_pitch / per_ridge
        opening = self._steps_to(0.0, self.opening, step)
        rim = self._steps_to(self.opening, self.opening + self.rim, step)
        nail = np.pi - self.nail_angle
        size = rim[-1] - rim[-2]
        free = graded(rim[-1], nail, size, 1.3)
        return np.concatenate([opening, rim[1:], free[1:], graded(nail, np.pi, 0.15 / self.mesh, 1.0)[1:]])

    def _steps_to(self, start: float, stop: float, step: float) -> Array:
        """Angles of evenly spaced abscissae on the outline."""
        count = max(1, round((stop - start) / step))
        angles: Array = np.arcsin(np.linspace(start, stop, count + 1) / self.half_width)
        return angles

    def _rings(self) -> Array:
        """Breakpoints of the ring coordinate: whole numbers are the interfaces, 0 the cavity, 4 the outline."""
        cells = [max(1, round(n * self.mesh)) for n in (2, 5, 3, 3)]
        parts = [k + np.arange(n) / n for k, n in enumerate(cells)]
        return np.concatenate([*parts, [4.0]])

    def _position(self, angle: Array, level: float) -> Array:
        sine, cosine = np.sin(angle), np.cos(angle)
        bone = np.stack([self.bone_half_width * sine, self.bone_half_height * cosine - self.bone_offset], axis=-1)
        centre = np.array([0.0, -self.bone_offset])
        skin = self.epidermis + self.dermis

        def outline(depth: float) -> Array:
            curve: Array = np.stack([(self.half_width - depth) * sine, (self.half_height - depth) * cosine], axis=-1)
            return curve

        outside = outline(0.0)
        if self.ridge_height > 0.0:
            x = self.half_width * sine
            pad = (cosine > 0.0) & (x <= self.opening + self.rim)
            ridge = 0.5 * self.ridge_height * (np.cos(2.0 * np.pi * x / self.ridge_pitch) - 1.0) * pad
            normal = np.stack([sine / self.half_width, cosine / self.half_height], axis=-1)
            outside = outside + ridge[:, None] * normal / np.linalg.norm(normal, axis=-1, keepdims=True)
        curves = [centre + self.cavity * (bone - centre), bone, outline(skin), outline(self.epidermis), outside]
        below = min(int(level), 3)
        part = level - below
        position: Array = (1.0 - part) * curves[below] + part * curves[below + 1]
        return position
