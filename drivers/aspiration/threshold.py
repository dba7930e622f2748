"""A proposal for the grey-value threshold, which the paper set by eye for each site."""

from __future__ import annotations

import numpy as np

from drivers.aspiration import segment
from drivers.aspiration.segment import Grey

LEAST_AREA = 0.004  # of the image: tissue is larger, dirt is smaller
_CANDIDATES = 15
_WORKING_WIDTH = 640  # px; candidates are tried on an image thinned to about this


def propose(grey: Grey) -> float | None:
    """The threshold halfway up the edge of the component that looks most like tissue; None when nothing does.

    ``grey`` (height, width) is normalised, upright and dark. Thresholds over the whole range of grey values are tried;
    the one whose component has the sharpest edge (the steepest grey values across it, the median over columns) wins,
    because the shade of uneven light and the blur of dirt are less steep than tissue in focus. It is then moved to the
    middle between the levels on both sides of that edge, where blur does not shift the contour.
    """
    stride = max(1, round(grey.shape[1] / _WORKING_WIDTH))
    thin = np.ascontiguousarray(grey[::stride, ::stride])
    low, high = np.percentile(thin[::2, ::2], (0.5, 99.5))
    if high - low < 4:
        return None
    best, sharpest = None, 0.0
    for share in np.linspace(0.1, 0.9, _CANDIDATES):
        candidate = float(low + share * (high - low))
        top = _edge(thin, candidate)
        if top is not None and (steep := _steepness(thin, top)) > sharpest:
            best, sharpest = candidate, steep
    for _ in range(2):
        if best is None or (top := _edge(grey, best)) is None:
            break
        outside, inside = segment.contrast(grey, top)
        middle = (outside + inside) / 2
        step = outside - inside
        if not np.isfinite(step).any():
            break
        sharp = step > 0.5 * max(float(np.nanmedian(step)), 1.0)
        if sharp.any():
            best = float(np.median(middle[sharp]))
    return best


def _edge(grey: Grey, threshold: float) -> segment.IntArray | None:
    runs, count = segment.label(grey, threshold)
    if count <= 0:
        return None
    name, _ = segment.choose(grey, runs, count, int(LEAST_AREA * grey.size))
    return segment.envelope(runs, count, name, grey.shape[1]) if name >= 0 else None


def _steepness(grey: Grey, top: segment.IntArray) -> float:
    """Median over columns of the grey step across two pixels at the edge."""
    columns = np.flatnonzero((top >= 2) & (top < grey.shape[0] - 1))
    if len(columns) < 8:
        return 0.0
    rows = top[columns]
    return float(np.median(grey[rows - 2, columns] - grey[rows + 1, columns]))
