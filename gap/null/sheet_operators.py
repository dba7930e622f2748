"""Sheets that do not relax linearly from an elastic force: operators for its chain.

Principal axes are those of the sheet's stiffness: the first is turned by ``angle`` rad about z.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from gap.null.chains import Kept
from gap.null.sheet_discrepancy import gradients
from gap.null.skin_laws import activated
from sim_devices.chain import FloatArray, Signals
from sim_devices.stages.kernels import evaluate, exposure_gain, prony
from sim_devices.stages.operators import Wired

USED_UP = 0.97
"""Share of their length up to which chains are followed: a fit may go beyond."""
ODD = 1, 3, 5, 7
"""Modes of one-dimensional consolidation, whose times are as 1/k² and whose shares, too (Terzaghi 1943)."""


def turned(vectors: Sequence[FloatArray], angle: float) -> FloatArray:
    """Components (3, n) along axes of which the first two are turned by ``angle`` rad about z."""
    (x, y, z), c, s = vectors, math.cos(angle), math.sin(angle)
    return np.stack([c * x + s * y, c * y - s * x, z])


@dataclass(frozen=True)
class Beside(Wired):
    """Forces (sources x, y, z, N) less those of the skin beside it, by the displacement (sources x, y, z, m)."""

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        force, displacement = ([signals[s] for s in names] for names in (self.source[:3], self.source[3:]))
        beside = self.force(displacement)
        signals.update({t: f - b for t, f, b in zip(self.target, force, beside, strict=True)})

    @abstractmethod
    def force(self, displacement: Sequence[FloatArray]) -> FloatArray:
        """The force (3, n) N that moves it by ``displacement`` (3 of (n,)) m."""


@dataclass(frozen=True)
class Springs(Beside):
    """Linear springs along the principal axes, ``stiffness`` N/m, of which shares yield: ``yielding`` are (share,
    length m) of those that slip beyond a length (Iwan 1967). Without any, the springs are whole."""

    stiffness: tuple[float, ...]
    angle: float
    yielding: tuple[tuple[float, float], ...] = ()

    def force(self, displacement: Sequence[FloatArray]) -> FloatArray:
        along = turned(displacement, self.angle)
        if self.yielding:
            along = np.sum([share * _slipping(along, length) for share, length in self.yielding], axis=0)
        return turned(list(np.array(self.stiffness)[:, None] * along), -self.angle)


@njit(cache=True, error_model="numpy")
def _slipping(u: FloatArray, length: float) -> FloatArray:
    """Lengths (k, n) of springs moved by u (k, n) m that slip beyond ``length`` m, each on its own."""
    out = np.zeros_like(u)
    for k in range(u.shape[0]):
        for i in range(1, u.shape[1]):
            out[k, i] = min(max(out[k, i - 1] + u[k, i] - u[k, i - 1], -length), length)
    return out


@dataclass(frozen=True)
class Arms(Wired):
    """Forces (sources x, y, z, N) less those of Maxwell's arms beside the skin, by the displacement (sources x, y, z,
    m): springs along the principal axes, shares of ``stiffness`` N/m, each behind a dashpot; ``arms`` are (share, time
    s) of them (Holzapfel 1996). They soften as it does: by ``softening`` (a, N, rise s, fall s, end) of its force."""

    stiffness: tuple[float, ...]
    angle: float
    arms: tuple[tuple[float, float], ...]
    softening: tuple[float, ...]

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        pairs = [x for share, tau in self.arms for x in (-share, tau)]
        whole = sum(share for share, _ in self.arms)
        along = turned([signals[s] for s in self.source[3:]], self.angle)
        stretched = [k * evaluate(prony, time, u, whole, *pairs) for k, u in zip(self.stiffness, along, strict=True)]
        force = np.stack([signals[s] for s in self.source[:3]])
        strength = np.maximum(np.linalg.norm(force, axis=0), 1e-12)
        a, *exposure = self.softening
        softer = evaluate(exposure_gain, time, strength, -a, *exposure) / strength
        signals.update(zip(self.target, force - softer * turned(stretched, -self.angle), strict=True))


@dataclass(frozen=True)
class Skew(Beside):
    """A sheet that is not the same this way and that: forces of a cubic potential of displacement over ``length`` m,
    with coefficients ``cubic`` (10) in N."""

    cubic: tuple[float, ...]
    length: float

    def force(self, displacement: Sequence[FloatArray]) -> FloatArray:
        # A fit moves the coefficients again and again, and the path hardly ever; it is kept with its terms, so that no
        # other array takes its identity.
        key = (self.length, *map(id, displacement))
        terms, _ = _cubics.get(key, lambda: (gradients(np.stack(displacement) / self.length, 3), displacement))
        return np.asarray(np.tensordot(np.array(self.cubic), terms, 1))


@dataclass(frozen=True)
class Bedding(Wired):
    """Forces (sources x, y, z, N) of skin that is soft within ``reach`` m of rest, by the share ``toe``, and on a bed
    that resists by ``push`` and ``pull`` N/m² times the square of the way (sources x, y, z, m) along +z and -z."""

    push: float
    pull: float
    toe: float
    reach: float

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        x, y, z = (signals[s] for s in self.source[3:])
        taut = 1.0 - self.toe * np.exp(-(x * x + y * y + z * z) / self.reach**2)
        for source, target in zip(self.source[:3], self.target, strict=True):
            signals[target] = signals[source] * taut
        bed = self.push * np.maximum(z, 0.0) ** 2 - self.pull * np.minimum(z, 0.0) ** 2
        signals[self.target[2]] = signals[self.target[2]] - bed


@dataclass(frozen=True)
class Apart(Wired):
    """Displacements (sources x, y, z, m) made longer along each of a sheet's ``axes`` (columns of a matrix, 9 numbers,
    row by row) by the factor (1 + (u/length)²)^exponent: a linear sheet behind it stiffens along each by itself."""

    axes: tuple[float, ...]
    exponent: float
    length: float

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        turn = np.array(self.axes).reshape(3, 3)
        along = turn.T @ np.stack([signals[s] for s in self.source])
        longer = along * (1.0 + (along / self.length) ** 2) ** self.exponent
        signals.update(zip(self.target, turn @ longer, strict=True))


@dataclass(frozen=True)
class Chains(Wired):
    """Forces (sources x, y, z, N) of a sheet of chains that come to their end, by the displacement (sources x, y, z, m)
    and the sheet's ``matrix`` (9 numbers, row by row): times (1 - x/3)/(1 - x) with x = u.Ku, K over the ``end`` (N m),
    the inverse Langevin function as of Cohen (1991); chains as of Arruda and Boyce (1993)."""

    matrix: tuple[float, ...]
    end: float

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        u = np.stack([signals[s] for s in self.source[3:]])
        used = np.minimum(np.sum(u * (np.array(self.matrix).reshape(3, 3) @ u), axis=0) / self.end, USED_UP)
        factor = (1.0 - used / 3.0) / (1.0 - used)
        signals.update({t: signals[s] * factor for s, t in zip(self.source[:3], self.target, strict=True)})


@dataclass(frozen=True)
class Fibres(Beside):
    """Two families of fibres in the plane, at ``spread`` rad on either side of ``angle``: each pulls along itself by
    ``stiffness`` N/m times the displacement's part s along it and exp((s/length)²) (Holzapfel, Gasser and Ogden
    2000)."""

    stiffness: float
    angle: float
    spread: float
    length: float

    def force(self, displacement: Sequence[FloatArray]) -> FloatArray:
        out = np.zeros((3, len(displacement[0])))
        for angle in (self.angle - self.spread, self.angle + self.spread):
            c, s = math.cos(angle), math.sin(angle)
            along = c * displacement[0] + s * displacement[1]
            pull = self.stiffness * along * np.exp(np.minimum((along / self.length) ** 2, 20.0))
            out += np.stack([c * pull, s * pull, 0.0 * pull])
        return out


_cubics = Kept(6)
"""Gradients of the cubic monomials of a path, (10, 3, n)."""


@dataclass(frozen=True)
class Consolidation(Wired):
    """Forces (sources x, y, z, N) that relax by two shares with a time in s each: the ``quick`` one linearly, the
    ``slow`` one as fluid leaves, the slower the farther the displacement (sources x, y, z, m) has closed its ways.

    Times of the slow one are longer by exp(``closing`` u²), closing in 1/m² (as of Lai and Mow 1980).
    """

    quick: tuple[float, float]
    slow: tuple[float, float]
    closing: float

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        square = np.sum([np.square(signals[s]) for s in self.source[3:]], axis=0)
        closed = np.exp(np.clip(0.5 * self.closing * (square[1:] + square[:-1]), -20.0, 20.0))
        reduced = np.concatenate([[0.0], np.cumsum(np.diff(time) / closed)])
        (g, tau), (share, slowest) = self.quick, self.slow
        pairs = [x for k in ODD for x in (-share * 8.0 / (math.pi * k) ** 2, slowest / k**2)]
        for source, target in zip(self.source[:3], self.target, strict=True):
            quick = evaluate(prony, time, signals[source], 0.0, -g, tau)
            signals[target] = quick + evaluate(prony, reduced, signals[source], 1.0, *pairs)


@dataclass(frozen=True)
class Activated(Wired):
    """Forces (x, y, z, N) that relax by Eyring's dashpots in each principal direction (`skin_laws.activated`)."""

    angle: float
    parameters: tuple[float, ...]

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        along = turned([signals[s] for s in self.source], self.angle)
        made = [evaluate(activated, time, f, *self.parameters) for f in along]
        signals.update(zip(self.target, turned(made, -self.angle), strict=True))
