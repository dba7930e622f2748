"""Effects of several signed strengths, as a matrix of crosstalk or a tilt about any axis: along each strength alone
they explain next to nothing, together all of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gap.inference.evidence import UNIFORM_PRECISION
from gap.inference.hypothesis import Candidate, to_unit
from gap.inference.linear import Projector
from sim_devices.chain import FloatArray

STEP = 0.04
"""Quantile of its prior by which one strength is moved at a time."""
INSIDE = 0.02
"""Quantile by which a point stays off the ends of its prior."""
Lens = tuple[float, Projector, FloatArray]
"""Log evidence of a base under some widths of its nuisance, the refit of that, and the residual (n,) it leaves."""


def signed(candidate: Candidate) -> list[int]:
    """Which parameters are strengths that may have either sign."""
    return [k for k, p in enumerate(candidate.parameters) if p.null is not None and p.low < p.null < p.high]


def star(candidate: Candidate, shapes: FloatArray) -> list[FloatArray]:
    """Points about each row of ``shapes`` (m, k) at which one signed strength is moved and the others do nothing."""
    which, points = signed(candidate), []
    still = [to_unit(candidate.parameters[k], float(candidate.parameters[k].null or 0.0)) for k in which]
    for shape in shapes:
        for k in which:
            point = shape.copy()
            point[which] = still
            point[k] += STEP
            points.append(point)
    return points


def together(
    candidate: Candidate,
    units: Sequence[FloatArray],
    traces: Mapping[str, FloatArray],
    lenses: Mapping[str, list[Lens]],
) -> list[FloatArray]:
    """For each shape, the point (k,) at which the strengths of a `star` explain most together, by the traces (n,
    points) of its ``units`` in each block; none where that is the star's own."""
    which, out = signed(candidate), []
    if len(which) < 2:
        return []
    shapes = np.array(units)
    shapes[:, which] = 0.0
    for shape in np.unique(shapes, axis=0):
        at = np.flatnonzero(np.all(shapes == shape, axis=1))
        if len(at) != len(which):
            continue
        gram, pull = UNIFORM_PRECISION * STEP**2 * np.eye(len(at)), np.zeros(len(at))
        for block, changes in traces.items():
            own, along = _through(lenses[block], changes[:, at])
            gram, pull = gram + own, pull + along
        moved = np.linalg.solve(gram, pull)
        mean = np.mean(np.array(units)[at], axis=0)
        mean[which] += STEP * (moved - 1.0 / len(at))
        out.append(np.clip(mean, INSIDE, 1.0 - INSIDE))
    return out


def _through(lenses: Sequence[Lens], changes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Normal matrix (k, k) and pull (k,) of changes (n, k), by the lens under which they explain most."""
    best, found = -np.inf, None
    for evidence, projector, aim in lenses:
        gram, pull = changes.T @ projector.apply(changes), changes.T @ aim
        earned = evidence + 0.5 * float(pull @ np.linalg.lstsq(gram + 1e-9 * np.eye(len(gram)), pull, rcond=None)[0])
        if found is None or earned > best:
            best, found = earned, (gram, pull)
    assert found is not None
    return found
