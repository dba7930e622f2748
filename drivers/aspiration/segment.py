"""Compiled kernels of the threshold pipeline: from a grey image to the one component that is tissue, and its edge.

All kernels see the image upright and dark: tissue is darker than the threshold and its apex points to row 0
(`normalise` brings every image into that form). Rows and columns count pixel middles.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Grey = NDArray[np.float32]
IntArray = NDArray[np.int32]

MAX_RUNS = 80_000  # a mask of 640 x 480 px with more runs than this is noise
_REACH = 4  # px on each side of an edge at which its contrast is read


@njit(cache=True, fastmath=True)
def normalise(image: NDArray[np.uint8], gain: Grey, invert: bool, flip: bool) -> Grey:
    """Grey values (height, width) times ``gain`` (of the image's shape, or (1, 1) for none), upright and dark."""
    rows, columns = image.shape
    out = np.empty((rows, columns), np.float32)
    flat = gain.shape[0] == rows and gain.shape[1] == columns
    for r in range(rows):
        source = rows - 1 - r if flip else r
        if flat:
            for c in range(columns):
                out[r, c] = image[source, c] * gain[source, c]
        else:
            for c in range(columns):
                out[r, c] = image[source, c]
        if invert:
            for c in range(columns):
                out[r, c] = np.float32(255.0) - out[r, c]
    return out


@njit(cache=True)
def label(grey: Grey, threshold: float) -> tuple[IntArray, int]:
    """Connected components (8 neighbours) of ``grey < threshold``, as runs: row, first and past-last column, label.

    The label is the number of the component's first run. The second result is the number of runs, or -1 for more than
    `MAX_RUNS`; only that many rows of the first, (MAX_RUNS, 4), are filled.
    """
    rows, columns = grey.shape
    runs = np.empty((MAX_RUNS, 4), np.int32)
    parent = np.empty(MAX_RUNS, np.int32)
    count = 0
    above_first, above_last = 0, 0  # the runs of the row before
    limit = np.float32(threshold)
    for r in range(rows):
        row_first = count
        above = above_first
        c = 0
        while c < columns:
            while c < columns and grey[r, c] >= limit:
                c += 1
            if c == columns:
                break
            start = c
            while c < columns and grey[r, c] < limit:
                c += 1
            if count == MAX_RUNS:
                return runs, -1
            runs[count, 0], runs[count, 1], runs[count, 2] = r, start, c
            parent[count] = count
            while above < above_last and runs[above, 2] < start:
                above += 1
            k = above
            while k < above_last and runs[k, 1] <= c:
                a, b = k, count
                while parent[a] != a:
                    parent[a] = parent[parent[a]]
                    a = parent[a]
                while parent[b] != b:
                    parent[b] = parent[parent[b]]
                    b = parent[b]
                parent[max(a, b)] = min(a, b)
                k += 1
            count += 1
        above_first, above_last = row_first, count
    for k in range(count):  # parents come before their children
        parent[k] = parent[parent[k]]
        runs[k, 3] = parent[k]
    return runs, count


@njit(cache=True)
def choose(grey: Grey, runs: IntArray, count: int, least: int) -> tuple[int, int]:
    """Label of the component that is tissue (-1: none) and the number of others of at least ``least`` px.

    Tissue is large, stands on the lower border, and has a sharp edge: the shade of a vignette has none, dirt is small.
    """
    area = np.zeros(count, np.int64)
    anchored = np.zeros(count, np.bool_)
    bottom = grey.shape[0] - 1
    for k in range(count):
        name = runs[k, 3]
        area[name] += runs[k, 2] - runs[k, 1]
        if runs[k, 0] == bottom:
            anchored[name] = True
    best, best_score, others = -1, 0.0, 0
    for name in range(count):
        if area[name] < least:
            continue
        others += 1
        top = envelope(runs, count, name, grey.shape[1])
        total, seen = 0.0, 0
        for c in range(top.shape[0]):
            if top[c] >= _REACH:
                inside = min(top[c] + _REACH, bottom)
                total += grey[top[c] - _REACH, c] - grey[inside, c]
                seen += 1
        score = max(total, 0.0) / max(seen, 1) * math.sqrt(area[name]) * (1.0 if anchored[name] else 0.2)
        if score > best_score:
            best, best_score = name, score
    return best, others - (1 if best >= 0 else 0)


@njit(cache=True)
def envelope(runs: IntArray, count: int, name: int, columns: int) -> IntArray:
    """First row of a component in each column, shape (columns,); -1 where it has none."""
    top = np.full(columns, -1, np.int32)
    empty = columns
    for k in range(count):
        if runs[k, 3] == name:
            for c in range(runs[k, 1], runs[k, 2]):
                if top[c] < 0:
                    top[c] = runs[k, 0]
                    empty -= 1
            if empty == 0:
                break
    return top


@njit(cache=True)
def sides(grey: Grey, runs: IntArray, count: int, name: int, threshold: float) -> FloatArray:
    """Sub-pixel column of the component's outermost edges in each row, shape (2, rows), left and right; NaN for none.

    An edge at the border of the image is at -0.5 or columns - 0.5.
    """
    rows, columns = grey.shape
    out = np.full((2, rows), np.nan)
    for k in range(count):
        if runs[k, 3] != name:
            continue
        r, first, last = runs[k, 0], runs[k, 1], runs[k, 2] - 1
        left = -0.5
        if first > 0:
            left = first - (threshold - grey[r, first]) / (grey[r, first - 1] - grey[r, first])
        right = columns - 0.5
        if last < columns - 1:
            right = last + (threshold - grey[r, last]) / (grey[r, last + 1] - grey[r, last])
        if not out[0, r] <= left:
            out[0, r] = left
        if not out[1, r] >= right:
            out[1, r] = right
    return out


@njit(cache=True)
def holes(runs: IntArray, count: int, name: int, least: int) -> int:
    """How many gaps at least ``least`` px wide the component encloses or lets in: reflections, each counted once."""
    found = 0
    last_row, last_start, last_end = -2, 0, 0
    before_row, before_end = -1, 0
    for k in range(count):
        if runs[k, 3] != name:
            continue
        if runs[k, 0] == before_row and runs[k, 1] - before_end >= least:
            joined = before_row - last_row <= 1 and before_end <= last_end and runs[k, 1] >= last_start
            if not joined:
                found += 1
            last_row, last_start, last_end = before_row, before_end, runs[k, 1]
        before_row, before_end = runs[k, 0], runs[k, 2]
    return found


@njit(cache=True)
def crossings(grey: Grey, top: IntArray, threshold: float, search: int) -> FloatArray:
    """Sub-pixel row at which each column falls below ``threshold``, within ``search`` px of ``top``; shape (columns,).

    Linear between pixels. NaN where the column has no edge there, or where tissue reaches the upper border.
    """
    rows = grey.shape[0]
    out = np.full(top.shape[0], np.nan)
    for c in range(top.shape[0]):
        r = top[c]
        if r < 0:
            continue
        low, high = max(1, r - search), min(rows - 1, r + search)
        if grey[r, c] < threshold:
            while r > low and grey[r - 1, c] < threshold:
                r -= 1
        else:
            while r < high and grey[r, c] >= threshold:
                r += 1
        if r >= 1 and grey[r, c] < threshold <= grey[r - 1, c]:
            out[c] = r - (threshold - grey[r, c]) / (grey[r - 1, c] - grey[r, c])
    return out


@njit(cache=True)
def contrast(grey: Grey, top: IntArray) -> tuple[FloatArray, FloatArray]:
    """Grey outside and inside the edge of each column, `_REACH` px from it; NaN where there is none in the image."""
    outside = np.full(top.shape[0], np.nan)
    inside = np.full(top.shape[0], np.nan)
    for c in range(top.shape[0]):
        if top[c] >= _REACH and top[c] + _REACH < grey.shape[0]:
            outside[c] = grey[top[c] - _REACH, c]
            inside[c] = grey[top[c] + _REACH, c]
    return outside, inside


@njit(cache=True)
def cut_soft(profile: FloatArray, step: FloatArray, share: float) -> bool:
    """Set the ``profile`` (columns,) to NaN where its grey ``step`` is below ``share`` of the upper quartile or NaN.

    False, with nothing changed, when no column has a step.
    """
    if not np.isfinite(step).any():
        return False
    least = share * np.nanpercentile(step, 75)
    for c in range(profile.shape[0]):
        if not step[c] >= least:
            profile[c] = np.nan
    return True
