"""A stand-in for a forward model near one point: curves as polynomials of the parameters, with a measured error.

Curves and their exact derivatives at training points are reduced to a few modes (proper orthogonal decomposition, of
the derivatives too); each mode's coefficient is a polynomial of total degree p in the parameters, fitted to values and
gradients together by least squares. One full solve of m parameters with sensitivities so counts as m + 1 equations.
The degree is the one that predicts left-out training points best. The polynomial may be one of features instead, of
which the curves are smoother functions than of the parameters themselves (fit/features.py). `Emulator.inside` says
where it may be trusted at all; how far it is right there is for held-out solves to tell (fit/surrogate.py).
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
RIDGE = (
    0.1  # weight of "no such term" for a term of degree 2 in features, in the curves' unit; four times for each more
)
SCALE = 3.0  # standard deviations of the training points' features that count as one
BEYOND = 1.2  # times the farthest likely training point's features: so far an emulator of features may be trusted
DISTINCT = 1e-4  # of the largest variance: less says that features move together


@dataclass(frozen=True)
class Features:
    """Functions of points z (b, m): features (b, p), and their derivatives (b, p, m)."""

    values: Callable[[Array], Array]
    rates: Callable[[Array], Array]


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
        table = self._chebyshev(u, rates=False)[0]
        factors = table.reshape(len(u), -1)[:, self._factors]
        return np.asarray(factors.prod(axis=2))

    @cached_property
    def _factors(self) -> Index:
        """Where the factors of each term (terms, at most the degree) stand in a flat table of polynomials, 0 for 1."""
        width = 1 + int(self.orders.max(initial=0))
        found = np.zeros((len(self.orders), max(1, int((self.orders > 0).sum(axis=1).max(initial=0)))), dtype=np.int64)
        for term, orders in enumerate(self.orders):
            columns = np.flatnonzero(orders)
            found[term, : columns.size] = columns * width + orders[columns]
        return found

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

    def _chebyshev(self, u: Array, rates: bool = True) -> tuple[Array, Array]:
        """T_j(u) and, if wanted, T_j'(u): (b, m, 1 + degree)."""
        top = int(self.orders.max(initial=0))
        table = np.empty((*u.shape, top + 1))
        slopes = np.zeros((*u.shape, top + 1) if rates else (0,))
        table[..., 0] = 1.0
        if top:
            table[..., 1] = u
        for j in range(2, top + 1):
            table[..., j] = 2.0 * u * table[..., j - 1] - table[..., j - 2]
        for j in range(1, top + 1) if rates else ():
            slopes[..., j] = (
                2.0 * table[..., j - 1] + 2.0 * u * slopes[..., j - 1] - slopes[..., j - 2] if j > 1 else 1.0
            )
        return table, slopes


@dataclass(frozen=True)
class Chart:
    """The polynomials' own coordinates x (q,) of a point z (m,): (features(z) - centre) turn; ``turn`` (p, q).

    An emulator of features may be trusted where |x| <= ``radius``.
    """

    centre: Array
    turn: Array
    features: Features | None = None
    radius: float = np.inf

    @staticmethod
    def of(z: Array, weight: Array, region: Region, features: Features | None) -> Chart:
        """The region's own units; or features by their principal directions over the points z (b, m)."""
        if features is None:
            return Chart(region.centre, region._inverse)
        values = features.values(z)
        centre = np.average(values, axis=0, weights=weight)
        size = np.sqrt(np.average((values - centre) ** 2, axis=0, weights=weight))
        size[size == 0.0] = 1.0
        scaled = (values - centre) / size
        power, directions = np.linalg.eigh(np.atleast_2d(np.cov(scaled.T, aweights=weight)))
        distinct = power > DISTINCT * power[-1]
        turn = directions[:, distinct] / np.sqrt(power[distinct]) / SCALE / size[:, None]
        likely = weight >= 0.5 * weight.max()
        farthest = float(np.linalg.norm((values[likely] - centre) @ turn, axis=1).max())
        return Chart(centre, turn, features, BEYOND * farthest)

    def points(self, z: Array) -> Array:
        """(b, q) of points z (b, m)."""
        values = z if self.features is None else self.features.values(z)
        return np.asarray((values - self.centre) @ self.turn)

    def rates(self, z: Array) -> Array:
        """(b, q, m): their derivatives by z."""
        if self.features is None:
            return np.broadcast_to(self.turn.T, (len(z), *self.turn.T.shape))
        return np.asarray(np.einsum("bpm,pq->bqm", self.features.rates(z), self.turn))


@dataclass(frozen=True)
class Emulator:
    """``mean`` (n,), ``modes`` (n, k) orthonormal, ``weights`` (terms, k); ``solves``: how many it was trained on."""

    region: Region
    chart: Chart
    basis: Basis
    mean: Array
    modes: Array
    weights: Array
    degree: int
    solves: int

    def inside(self, z: Array) -> NDArray[np.bool_]:
        """Which of the points (b, m) lie in the region it was trained for."""
        if self.chart.features is None:
            return self.region.holds(z)
        boxed = np.all((z >= self.region.lower) & (z <= self.region.upper), axis=1)
        return np.asarray(boxed & (np.linalg.norm(self.chart.points(z), axis=1) <= self.chart.radius))

    def coefficients(self, z: Array) -> Array:
        """Of the modes (b, k) at points (b, m)."""
        return self.basis.values(self.chart.points(z)) @ self.weights

    def slopes(self, z: Array) -> Array:
        """Derivatives of the coefficients (k, m) by the coordinates at one point (m,)."""
        by_unit = self.basis.gradients(self.chart.points(z[None]))[0] @ self.weights  # (q, k)
        return np.asarray(by_unit.T @ self.chart.rates(z[None])[0])

    def curves(self, z: Array) -> Array:
        """(b, n) at points (b, m)."""
        return self.mean + self.coefficients(z) @ self.modes.T


def train(
    solves: Sequence[Solve],
    region: Region,
    weigh: Callable[[Array], Array] | None = None,
    features: Features | None = None,
) -> Emulator:
    """An emulator of the full solves that lie in or near ``region``; of all of them where ``features`` bound it.

    ``weigh`` gives the weight of each solve's equations (b,) from the curves (b, n): far-off curves need not be met as
    well as near ones. Raises ValueError for fewer than two solves.
    """
    near = [s for s in solves if features is not None or np.linalg.norm(region.units(s.z[None])) <= 1.5]
    if len(near) < 2:
        raise ValueError(f"an emulator needs at least two full solves in its region, and has {len(near)}")
    z = np.array([s.z for s in near])
    curves = np.array([s.curve for s in near])
    mean = curves.mean(axis=0)
    stretch = region.radius * region.shape
    slopes = np.array([(s.slopes @ stretch).T for s in near])  # (points, m, n) by the region's units
    modes = _modes(curves - mean, slopes)
    weight = np.ones(len(near)) if weigh is None else weigh(curves)
    chart = Chart.of(z, weight, region, features)
    equations = _Equations(
        chart.points(z), chart.rates(z) @ stretch, (curves - mean) @ modes, slopes @ modes, weight,
        0.0 if features is None else RIDGE,
    )  # fmt: skip
    degree = _best_degree(equations)
    basis = Basis.of(chart.turn.shape[1], degree)
    return Emulator(region, chart, basis, mean, modes, equations.solved(basis), degree, len(near))


@dataclass(frozen=True)
class _Equations:
    """Data of the polynomials' fit: points x (b, q), their ``rates`` (b, q, m) by the region's units, the modes'
    ``values`` (b, k) and ``gradients`` (b, m, k), a ``weight`` (b,), and a ridge."""

    x: Array
    rates: Array
    values: Array
    gradients: Array
    weight: Array
    ridge: float

    def only(self, chosen: NDArray[np.bool_]) -> _Equations:
        return _Equations(
            self.x[chosen], self.rates[chosen], self.values[chosen], self.gradients[chosen], self.weight[chosen],
            self.ridge,
        )  # fmt: skip

    def solved(self, basis: Basis) -> Array:
        """(terms, k): the weights that meet the equations best."""
        weight = self.weight[:, None]
        steep = (GRADIENTS * self.weight)[:, None, None]
        by_unit = steep * np.einsum("bqm,bqt->bmt", self.rates, basis.gradients(self.x))
        rows = [weight * basis.values(self.x), by_unit.reshape(-1, by_unit.shape[2])]
        goals = [weight * self.values, (steep * self.gradients).reshape(-1, self.values.shape[1])]
        if self.ridge:
            total = basis.orders.sum(axis=1)
            rows.append(np.diag(np.where(total > 1, self.ridge * 4.0 ** (total - 2.0), 0.0)))
            goals.append(np.zeros((len(total), self.values.shape[1])))
        return np.asarray(np.linalg.lstsq(np.concatenate(rows), np.concatenate(goals), rcond=1e-11)[0])


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


def _best_degree(equations: _Equations) -> int:
    """The degree that predicts points best that it was not fitted to."""
    count, q = equations.x.shape
    m = equations.rates.shape[2]
    folds = np.arange(count) % min(_FOLDS, count)
    best, least = 1, np.inf
    for degree in range(1, 7):
        basis = Basis.of(q, degree)
        terms = len(basis.orders)
        if degree > 1 and (terms > MOST_TERMS or 1.2 * terms > (count - count // _FOLDS) * (m + 1)):
            break
        error = 0.0
        for fold in range(folds.max() + 1):
            out = equations.only(folds == fold)
            weights = equations.only(folds != fold).solved(basis)
            off = (basis.values(out.x) @ weights - out.values) * out.weight[:, None]
            error += float((off**2).sum())
        if error < least:
            best, least = degree, error
    return best
