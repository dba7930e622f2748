"""Types that pass between a body and those who drive it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..api import Array
from .mesh import Index


@dataclass(frozen=True)
class Rim:
    """A rigid annulus with a rounded bore above the edges ``edges`` (k, 3), free to move along z.

    ``opening`` and ``fillet`` radii [m]; ``friction`` coefficient enters per run.
    """

    edges: Index
    opening: float
    fillet: float


@dataclass
class State:
    """Everything that a step starts from. Arrays: u (N, 2) [m], theta and p (E, 3), history (points, states), lam, slip
    and shear (contact points,), and the probe's ``height`` above its rest on the undeformed surface [m]."""

    u: Array
    theta: Array
    p: Array
    history: Array
    lam: Array
    slip: Array
    shear: Array
    height: float = 0.0

    def copy(self, history: Array | None = None) -> State:
        """A state of its own, but for the history (or the given one): it is replaced as a whole, never written into."""
        u, theta, p, lam = self.u.copy(), self.theta.copy(), self.p.copy(), self.lam.copy()
        kept = self.history if history is None else history
        return State(u, theta, p, kept, lam, self.slip.copy(), self.shear.copy(), self.height)

    def beyond(self, before: State) -> State:
        """The state if the change since ``before`` came once more; the history is this one's."""
        u, theta, p, lam, shear = (
            2.0 * now - then
            for now, then in (
                (self.u, before.u),
                (self.theta, before.theta),
                (self.p, before.p),
                (self.lam, before.lam),
                (self.shear, before.shear),
            )
        )
        return State(
            u, theta, p, self.history, np.maximum(lam, 0.0), self.slip, shear, 2.0 * self.height - before.height
        )


@dataclass
class Tangents:
    """Derivatives of a state by m parameters: du (equations, m), history (points, states, m), slip (contacts, m)."""

    du: Array
    history: Array
    slip: Array


@dataclass(frozen=True)
class Load:
    """Loads of a step: gauge ``pressure`` on the loaded edges [Pa], and the probe: held at ``height`` [m], or
    pressed down with ``force`` [N] where height is None. ``friction`` is Coulomb's coefficient; ``force_slope`` the
    derivative of force by the spring's force."""

    pressure: float
    height: float | None = 0.0
    force: float = 0.0
    friction: float = 0.0
    force_slope: float = 1.0


@dataclass(frozen=True)
class Directions:
    """The m parameters of a differentiation.

    ``law`` one (m,) array a layer: the index of the law parameter that direction j is there, −1 for none; ``friction``
    and ``force`` (m,) derivatives of Coulomb's coefficient and of the spring's force; ``shape`` the columns j that move
    the mesh, with the (N, 2) derivative of its nodes.
    """

    law: tuple[Index, ...]
    friction: Array
    force: Array
    shape: tuple[tuple[int, Array], ...] = ()


class ShapePartial(NamedTuple):
    """Derivatives with the mesh at fixed unknowns: residual (equations,) and kinematics (points, 6), per direction."""

    column: int
    force: Array
    kin: Array


@dataclass(frozen=True)
class Contactness:
    """Numerical constants of contact: ``stiffness`` c [Pa/m] and smoothing ``width`` [Pa], see `surface`."""

    stiffness: float = 2e8
    width: float = 40.0
