"""Uneven light: the gain that makes the bright field even, from a recorded flat field or from the image itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]

_BLOCK = 16  # px
_DEGREE = 4
_DARKEST = 0.2  # of the field's bright level; beyond it the light is too weak to be corrected


def from_flat_field(flat: NDArray[np.generic]) -> NDArray[np.float32]:
    """Gain (height, width) that makes ``flat``, an image of the empty field, even at its 95th percentile.

    Raises ValueError for an image that is black or not two-dimensional.
    """
    field = np.asarray(flat, float)
    if field.ndim != 2 or field.size == 0:
        raise ValueError(f"a flat field is an image (height, width), not of shape {field.shape}")
    level = float(np.percentile(field, 95))
    if level < 10:
        raise ValueError(f"the flat field is black (95 % of it below {level:.0f} grey values)")
    return _gain(field, level)


def estimate(image: Image) -> NDArray[np.float32]:
    """Gain estimated from one image in which the field is bright and tissue dark.

    The logarithm of the medians of bright blocks is fitted by a polynomial of the fourth degree, robustly; blocks that
    lie on it, however dark, are then taken in. Where tissue or dirt hides the field the polynomial goes on. (1, 1) ones
    where too little field is seen for that.
    """
    blocks, rows, columns = _medians(image)
    bright = blocks > _otsu(blocks)
    if bright.sum() < 4 * 15:
        return np.ones((1, 1), np.float32)
    y, x = np.meshgrid(rows, columns, indexing="ij")
    # Blocks beside tissue hold some of it: leave them out.
    inner = bright.copy()
    inner[1:] &= bright[:-1]
    inner[:-1] &= bright[1:]
    inner[:, 1:] &= bright[:, :-1]
    inner[:, :-1] &= bright[:, 1:]
    used = inner if inner.sum() >= 3 * 15 else bright
    terms = _terms(x.ravel(), y.ravel())
    level = np.log(np.maximum(blocks.ravel(), 1.0))
    coefficients = _robust(terms[used.ravel()], level[used.ravel()])
    for _ in range(4):
        used = (np.abs(level - terms @ coefficients) < 0.1).reshape(used.shape)
        coefficients = _robust(terms[used.ravel()], level[used.ravel()])
    seen = np.exp(terms[used.ravel()] @ coefficients)
    height, width = image.shape
    full_y = np.linspace(-1, 1, height)
    full_x = np.linspace(-1, 1, width)
    powers_x = full_x[None, :] ** np.arange(_DEGREE + 1)[:, None]
    powers_y = full_y[None, :] ** np.arange(_DEGREE + 1)[:, None]
    grid = np.zeros((_DEGREE + 1, _DEGREE + 1))
    for c, (i, j) in zip(coefficients, _pairs(), strict=True):
        grid[i, j] = c
    field = np.exp(np.clip(powers_y.T @ grid.T @ powers_x, None, 6.0))
    return _gain(np.clip(field, seen.min(), seen.max()), float(np.percentile(seen, 95)))


def _robust(terms: FloatArray, level: FloatArray) -> FloatArray:
    """Coefficients of the polynomial, by least squares with Tukey's biweight."""
    weight = np.ones(len(level))
    coefficients = np.zeros(terms.shape[1])
    for _ in range(6):
        # A little ridge keeps the polynomial quiet where no block holds it.
        weighted = terms * weight[:, None]
        left = weighted.T @ terms + 1e-3 * np.eye(terms.shape[1])
        coefficients = np.asarray(np.linalg.solve(left, weighted.T @ level), float)
        residual = level - terms @ coefficients
        scatter = max(1.4826 * float(np.median(np.abs(residual))), 2e-3)
        weight = np.clip(1 - (residual / (4.685 * scatter)) ** 2, 0, None) ** 2
    return coefficients


def _gain(field: FloatArray, level: float) -> NDArray[np.float32]:
    return (level / np.clip(field, _DARKEST * level, None)).astype(np.float32)


def _medians(image: Image) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Medians of the image's blocks and the blocks' middles in -1 … 1, by row and by column."""
    height, width = image.shape
    high, wide = max(1, height // _BLOCK), max(1, width // _BLOCK)
    step_y, step_x = height // high, width // wide
    cut = image[: high * step_y, : wide * step_x].reshape(high, step_y, wide, step_x)
    thinned = cut[:, :: max(1, step_y // 8), :, :: max(1, step_x // 8)]
    blocks = np.median(thinned, axis=(1, 3))
    rows = (np.arange(high) + 0.5) * step_y / (height - 1) * 2 - 1
    columns = (np.arange(wide) + 0.5) * step_x / (width - 1) * 2 - 1
    return blocks, rows, columns


def _otsu(values: FloatArray) -> float:
    """Otsu's threshold: the split with the largest variance between the two classes."""
    ordered = np.sort(values, axis=None)
    n = np.arange(1, len(ordered))
    sums = np.cumsum(ordered)
    below, above = sums[:-1] / n, (sums[-1] - sums[:-1]) / (len(ordered) - n)
    between = n * (len(ordered) - n) * (above - below) ** 2
    split = int(np.argmax(between))
    return float((ordered[split] + ordered[split + 1]) / 2)


def _pairs() -> list[tuple[int, int]]:
    """Powers (of x, of y) of the polynomial's terms."""
    return [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]


def _terms(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.column_stack([x**i * y**j for i, j in _pairs()])
