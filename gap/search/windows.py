"""When an event would have to begin and end: the windows within which its change is most like what is left."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.signal import find_peaks

from gap.inference.evidence import Fit
from gap.inference.hypothesis import Rows
from gap.inference.linear import Projector
from sim_devices.chain import FloatArray

LEAST = 1e-6
"""Share of a recording's whole change below which a window says nothing."""


def answered(base: Fit, rows: Rows, change: FloatArray) -> tuple[float, float]:
    """Moment, s, and duration, s, of the window within a recording in which the ``change`` (n,) that an event makes if
    it lasts all along takes most off a fit's χ², the nuisance refitted.

    For a window w of it, P the projector of `Projector` and r the residual: (rᵀ P w)² / (wᵀ P w), all windows of a
    recording at once by cumulative sums. Tone that is another for some seconds multiplies a force about nought: the
    residual has no level there, and skin that is fitted to all recordings hides some of it.
    """
    found = []
    for edges, gain in _gains(base, rows, change):
        first, behind = np.unravel_index(int(np.argmax(gain)), gain.shape)
        found.append((float(gain[first, behind]), float(edges[first]), float(edges[behind] - edges[first])))
    return max(found)[1:]


def to_the_end(base: Fit, rows: Rows, change: FloatArray) -> list[float]:
    """Moments, s, from which on until the end of a recording the ``change`` (n,) takes more off a fit's χ², the
    nuisance refitted, than from those about them: first those that stand out most (by their prominence).

    Of a strong event, whose part the nuisance has taken on, the right one may come second in its recording."""
    found: list[tuple[float, float]] = []
    for edges, gain in _gains(base, rows, change):
        peaks, shape = find_peaks(np.pad(gain[:, -1], 1), prominence=0.0)
        found += zip(shape["prominences"].tolist(), edges[peaks - 1].tolist(), strict=True)
    return [moment for _, moment in sorted(found, reverse=True)]


def _gains(base: Fit, rows: Rows, change: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Of each recording the edges (m,) s of its rows, and the gain (m, m) of each window from one to another."""
    projector = Projector(base.jacobian, base.prior_sd, base.gram)
    worth = projector.apply(base.at_mean) * change
    for k in np.unique(rows.recording):
        at = np.flatnonzero(rows.recording == k)
        stamps, where = np.unique(rows.time[at], return_inverse=True)
        seen = np.zeros((len(stamps), base.jacobian.shape[1]))
        np.add.at(seen, where, base.jacobian[at] * change[at, None])
        along, square = (np.bincount(where, v[at], len(stamps)) for v in (worth, np.square(change)))
        along, square, seen = (np.concatenate([0 * v[:1], np.cumsum(v, axis=0)]) for v in (along, square, seen))
        inner = projector.inner(seen.T)
        of_both = np.add.outer(np.diag(inner), np.diag(inner)) - 2.0 * inner
        size = np.maximum(np.subtract.outer(square, square).T - of_both, LEAST * square[-1])
        gain = np.triu(np.square(np.subtract.outer(along, along)) / np.maximum(size, 1e-300), 1)
        edges = np.concatenate([stamps[:1], 0.5 * (stamps[1:] + stamps[:-1]), stamps[-1:]])
        yield edges, gain
