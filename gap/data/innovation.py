"""Noise of a broadly excited channel: the part that neither its own past nor the other signals foretell.

The high band of such a channel (a multisine, a PRBS, calibration points) is signal. A linear prediction from the last
samples of the channel and of all signals beside it, with powers of their present values, leaves its noise and a little
more.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim_devices.chain import FloatArray

PAST = 8
"""Samples back that a prediction looks."""
POWERS = 5
"""Of a signal's present value."""
SAMPLES_EACH = 10
"""Samples for each coefficient at least."""
RIDGE = 1e-9
"""Of a column's square: collinear columns do no harm."""


def unforeseen(value: FloatArray, others: Sequence[FloatArray], asked: NDArray[np.bool_] | None = None) -> float:
    """Standard deviation that a prediction of the samples (n,), or of those ``asked``, leaves; infinite where there
    are too few of them.

    Half of the samples teach, the other half is asked, and the other way round: no fit to noise counts.
    """
    moving = [v for v in others if np.all(np.isfinite(v)) and np.ptp(v) > 0]
    if not np.all(np.isfinite(value)) or np.ptp(value) == 0:
        return np.inf
    rows = len(value) - PAST
    columns = [np.ones(max(rows, 0))]
    for v in (value, *moving):
        columns += [_scaled(v)[PAST - k : len(v) - k] for k in range(1, PAST + 1)]
    for v in moving:
        columns += [_scaled(v)[PAST:] ** k for k in range(1, POWERS + 1)]
    if rows < 2 * SAMPLES_EACH * len(columns):
        return np.inf
    design, target = np.column_stack(columns), value[PAST:]
    counts = np.ones(rows, dtype=bool) if asked is None else asked[PAST:]
    half = rows // 2
    left = []
    for teach, ask in ((slice(0, half), slice(half, None)), (slice(half, None), slice(0, half))):
        a, b = design[teach], target[teach] - np.mean(target[teach])
        gram = a.T @ a
        known = np.linalg.solve(gram + RIDGE * np.diag(np.diag(gram) + 1e-300), a.T @ b)
        miss = target[ask] - np.mean(target[teach]) - design[ask] @ known
        if np.any(counts[ask]):
            left.append(float(np.median(np.abs(miss[counts[ask]]))) / 0.6745)
    return max(left, default=np.inf)


def _scaled(v: FloatArray) -> FloatArray:
    return np.asarray((v - np.mean(v)) / np.std(v))
