"""A stand-in for a forward model near one point: curves as polynomials of the parameters, with a measured error.

Curves and their exact derivatives at training points are reduced to a few modes (proper orthogonal decomposition, of
the derivatives too); each mode's coefficient is a polynomial of total degree p in the parameters, fitted to values and
gradients together by least squares. One full solve of m parameters with sensitivities so counts as m + 1 equations.
The degree is the one that predicts left-out training points best. `Emulator.inside` says where it may be trusted at
all; how far it is right there is for held-out solves to tell (fit/posterior.py).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from .api import Array

Index = NDArray[np.int64]
MOST_TERMS = 700  # of a polynomial
GRADIENTS = 0.5  # weight of a gradient's equation beside a value's, in the region's own unit
NEGLIGIBLE = 1e-3  # largest entry of what the modes may leave out of a curve, in the curves' unit
_FOLDS = 5


@dataclass(frozen=True)
class Region:
    """The ellipsoid |x| <= radius, z = centre + shape x, cut by the box lower <= z <= upper; z and x (m,)."""

    centre: Array
    shape: Array
    radius: float
    lower: Array
    upper: Array

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.inv(self.shape).T / self.radius)

    def units(self, z: Array) -> Array:
        """Points (b, m) in the region's own coordinates u = x / radius: within the unit ball inside."""
        return np.asarray((z - self.centre) @ self._inverse)

    def points(self, u: Array) -> Array:
        """The inverse of `units`, moved into the box."""
        return np.clip(self.centre + self.radius * u @ self.shape.T, self.lower, self.upper)

    def holds(self, z: Array) -> NDArray[np.bool_]:
        """Which of the points (b, m) lie inside."""
        boxed = np.all((z >= self.lower) & (z <= self.upper), axis=1)
        return np.asarray(boxed & (np.linalg.norm(self.units(z), axis=1) <= 1.0))


@dataclass(frozen=True)
class Solve:
    """One full solve: coordinates z (m,), curve (n,), and its derivatives (n, m) by z."""

    z: Array
    curve: Array
    slopes: Array


@dataclass(frozen=True)
class Basis:
    """Products of Chebyshev polynomials up to a total degree: ``orders`` (terms, m)."""

    orders: Index

    @staticmethod
    def of(m: int, degree: int) -> Basis:
        rows = [np.zeros(m, dtype=np.int64)]
        for total in range(1, degree + 1):
            for chosen in combinations_with_replacement(range(m), total):
                rows.append(np.bincount(chosen, minlength=m))
        return Basis(np.array(rows))

    def values(self, u: Array) -> Array:
        """(b, terms) at points (b, m)."""
        table, columns = self._chebyshev(u)[0], np.arange(u.shape[1])
        return np.asarray(table[:, columns, self.orders].prod(axis=2))

    def gradients(self, u: Array) -> Array:
        """(b, m, terms): derivatives by each coordinate."""
        table, rates = self._chebyshev(u)
        columns = np.arange(u.shape[1])
        factors = table[:, columns, self.orders]  # (b, terms, m)
        found = np.empty((len(u), u.shape[1], len(self.orders)))
        for k in columns:
            own = factors.copy()
            own[:, :, k] = rates[:, k, self.orders[:, k]]
            found[:, k] = own.prod(axis=2)
        return found

    def _chebyshev(self, u: Array) -> tuple[Array, Array]:
        """T_j(u) and T_j'(u): (b, m, 1 + degree)."""
        top = int(self.orders.max(initial=0))
        table, rates = np.empty((*u.shape, top + 1)), np.zeros((*u.shape, top + 1))
        table[..., 0] = 1.0
        if top:
            table[..., 1], rates[..., 1] = u, 1.0
        for j in range(2, top + 1):
            table[..., j] = 2.0 * u * table[..., j - 1] - table[..., j - 2]
            rates[..., j] = 2.0 * table[..., j - 1] + 2.0 * u * rates[..., j - 1] - rates[..., j - 2]
        return table, rates


@dataclass(frozen=True)
class Emulator:
    """``mean`` (n,), ``modes`` (n, k) orthonormal, ``weights`` (terms, k); ``solves``: how many it was trained on."""

    region: Region
    basis: Basis
    mean: Array
    modes: Array
    weights: Array
    degree: int
    solves: int

    def inside(self, z: Array) -> NDArray[np.bool_]:
        """Which of the points (b, m) lie in the region it was trained for."""
        return self.region.holds(z)

    def coefficients(self, z: Array) -> Array:
        """Of the modes (b, k) at points (b, m)."""
        return self.basis.values(self.region.units(z)) @ self.weights

    def slopes(self, z: Array) -> Array:
        """Derivatives of the coefficients (k, m) by the coordinates at one point (m,)."""
        by_unit = self.basis.gradients(self.region.units(z[None]))[0] @ self.weights  # (m, k)
        return np.linalg.solve(self.region.shape.T, by_unit).T / self.region.radius

    def curves(self, z: Array) -> Array:
        """(b, n) at points (b, m)."""
        return self.mean + self.coefficients(z) @ self.modes.T


def train(solves: Sequence[Solve], region: Region, weigh: Callable[[Array], Array] | None = None) -> Emulator:
    """An emulator of the full solves that lie in or near ``region``.

    ``weigh`` gives the weight of each solve's equations (b,) from the curves (b, n): far-off curves need not be met as
    well as near ones. Raises ValueError for fewer than two solves.
    """
    near = [s for s in solves if np.linalg.norm(region.units(s.z[None])) <= 1.5]
    if len(near) < 2:
        raise ValueError(f"an emulator needs at least two full solves in its region, and has {len(near)}")
    z = np.array([s.z for s in near])
    u, m = region.units(z), z.shape[1]
    curves = np.array([s.curve for s in near])
    mean = curves.mean(axis=0)
    stretch = region.radius * region.shape
    slopes = np.array([(s.slopes @ stretch).T for s in near])  # (points, m, n) by u
    modes = _modes(curves - mean, slopes)
    values, gradients = (curves - mean) @ modes, slopes @ modes
    weight = np.ones(len(near)) if weigh is None else weigh(curves)
    degree = _best_degree(u, values, gradients, weight)
    basis = Basis.of(m, degree)
    return Emulator(region, basis, mean, modes, _fitted(basis, u, values, gradients, weight), degree, len(near))


def _modes(curves: Array, slopes: Array) -> Array:
    """Orthonormal directions (n, k) outside of which curves and slopes leave next to nothing."""
    rows = np.concatenate([curves, slopes.reshape(-1, curves.shape[1])])
    power, vectors = np.linalg.eigh(rows @ rows.T)
    power, vectors = power[::-1].clip(0.0), vectors[:, ::-1]
    for k in range(1, len(power) + 1):
        if power[k - 1] <= 1e-14 * power[0]:
            break
        modes = rows.T @ vectors[:, :k] / np.sqrt(power[:k])
        if np.abs(curves - curves @ modes @ modes.T).max() <= NEGLIGIBLE:
            break
    modes, _ = np.linalg.qr(modes)
    return np.asarray(modes)


def _fitted(basis: Basis, u: Array, values: Array, gradients: Array, weight: Array) -> Array:
    by_gradient = (GRADIENTS * weight)[:, None, None] * basis.gradients(u)
    rows = np.concatenate([weight[:, None] * basis.values(u), by_gradient.reshape(-1, by_gradient.shape[2])])
    slopes = (GRADIENTS * weight)[:, None, None] * gradients
    goals = np.concatenate([weight[:, None] * values, slopes.reshape(-1, values.shape[1])])
    return np.asarray(np.linalg.lstsq(rows, goals, rcond=1e-11)[0])


def _best_degree(u: Array, values: Array, gradients: Array, weight: Array) -> int:
    """The degree that predicts points best that it was not fitted to."""
    count, m = u.shape
    folds = np.arange(count) % min(_FOLDS, count)
    best, least = 1, np.inf
    for degree in range(1, 7):
        basis = Basis.of(m, degree)
        terms = len(basis.orders)
        if degree > 1 and (terms > MOST_TERMS or 1.2 * terms > (count - count // _FOLDS) * (m + 1)):
            break
        error = 0.0
        for fold in range(folds.max() + 1):
            out = folds == fold
            weights = _fitted(basis, u[~out], values[~out], gradients[~out], weight[~out])
            off = (basis.values(u[out]) @ weights - values[out]) * weight[out, None]
            error += float((off**2).sum())
        if error < least:
            best, least = degree, error
    return best
