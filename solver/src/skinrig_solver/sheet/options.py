"""The part of a sheet experiment that is not identified: its geometry, how the pre-stress acts, and the mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal, get_args

from .mesh import Mesh, ring

PrestressMode = Literal["load", "initial"]
Frame = Literal["material", "spatial"]
Relaxation = Literal["convolution", "history"]
Element = Literal["membrane", "solid"]


@dataclass(frozen=True)
class Options:
    """Geometry options of a sheet experiment, SI. Paper M unless said otherwise.

    Attributes
    ----------
    thickness : of the stress-free sheet
    hole_radius : of the support; not given by the paper, assumed
    probe_radius : of the glued patch
    prestress_mode : 'load', dead loads stretch the sheet first (face); 'initial', an initial stress as it lies (arm)
    prestress_ramp : duration [s] of the dead loads' ramp, during which the sheet creeps (paper: 5); 0, the default,
        makes sx and sy the elastic stresses the test starts from (docs/validation/sheet.md compares the forces)
    frame : hole and patch are round on the stress-free sheet ('material', as node sets of a mesh) or 'spatial'
    relaxation : 'convolution' of the elastic force, or 'history' of every point's stress, sample by sample
    element : 'membrane', or 'solid' (bending included; no sensitivities)
    radial, around, layers : elements of the ring; layers through the thickness of a solid
    points : Chebyshev points along a ray where the elastic force is solved
    """

    thickness: float = 1.5e-3
    hole_radius: float = 20e-3
    probe_radius: float = 2e-3
    prestress_mode: PrestressMode = "load"
    prestress_ramp: float = 0.0
    frame: Frame = "material"
    relaxation: Relaxation = "convolution"
    element: Element = "membrane"
    radial: int = 6
    around: int = 16
    layers: int = 1
    points: int = 7

    def __post_init__(self) -> None:
        choices = {"prestress_mode": PrestressMode, "frame": Frame, "relaxation": Relaxation, "element": Element}
        for name, kind in choices.items():
            if getattr(self, name) not in get_args(kind):
                raise ValueError(
                    f"geometry option {name}: {getattr(self, name)!r} is none of {', '.join(get_args(kind))}"
                )
        for name in ("thickness", "hole_radius", "probe_radius"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"geometry option {name}: {getattr(self, name)} must be positive")
        if not self.probe_radius < self.hole_radius:
            raise ValueError(
                f"geometry option probe_radius: {self.probe_radius} m must be below hole_radius {self.hole_radius} m"
            )
        if not self.prestress_ramp >= 0.0:
            raise ValueError(f"geometry option prestress_ramp: {self.prestress_ramp} must not be negative")
        for name, least in {"radial": 1, "around": 4, "layers": 1, "points": 3}.items():
            value = getattr(self, name)
            if value != int(value) or value < least:
                raise ValueError(f"geometry option {name}: {value} must be a whole number of at least {least}")
        if self.around % 4:
            raise ValueError(f"geometry option around: {self.around} must be a multiple of 4, for the sheet's symmetry")

    @classmethod
    def read(cls, geometry: Mapping[str, Any]) -> Options:
        """Options from an experiment's geometry; raises ValueError naming an unknown or wrong one."""
        known = {f.name: f.type for f in fields(cls)}
        unknown = sorted(set(geometry) - set(known))
        if unknown:
            raise ValueError(f"geometry option {unknown[0]!r} is unknown to a sheet; there are {', '.join(known)}")
        casts: dict[Any, Any] = {"float": float, "int": int}
        values = {}
        for name, value in geometry.items():
            try:
                values[name] = casts.get(known[name], str)(value)
            except (TypeError, ValueError):
                raise ValueError(f"geometry option {name}: {value!r} is not a {known[name]}") from None
        return cls(**values)

    def mesh(self) -> Mesh:
        """The ring these options ask for."""
        layers = self.layers if self.element == "solid" else 0
        return ring(self.probe_radius, self.hole_radius, self.radial, self.around, layers, self.thickness)
