"""Where the robot's loop is simulated: dense where its command bends, sparse elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from gap.data.session import Pace
from sim_devices.chain import FloatArray, Operator
from sim_devices.stages.operators import Retimed
from sim_devices.stages.sampling import RETIMED, mean_before

KINK = 1e-6
"""s, within which a speed changes."""
LOOP_STEP, LOOP_TURN = 0.02, 0.1
"""s at most, and rad by which a curved command may turn in it: the loop is exact between kinks, so this only has to
resolve curved motion."""
AFTER_KINK = np.concatenate([np.arange(0.004, 0.1, 0.004), np.arange(0.1, 0.3, 0.01)])
"""s after a kink: nodes for the loop's answer, which straight lines over `LOOP_STEP` would miss by several µm."""


def retimed(operators: Sequence[Operator]) -> tuple[Retimed, ...]:
    """Those of the operators that show the command at other moments."""
    return tuple(op for op in operators if isinstance(op, Retimed) and op.name in RETIMED and op.moves)


def averaged(grid: FloatArray, signals: Sequence[FloatArray], ends: FloatArray) -> FloatArray:
    """Means of signals (m,) on a grid over bins whose samples, evenly spaced, lie a standard deviation to either side
    at ``ends`` (2, n) s: (signals, n)."""
    window = np.maximum(np.sqrt(3.0) * (ends[1] - ends[0]), KINK)
    last = ends.mean(axis=0) + 0.5 * window
    return mean_before(grid, np.stack(signals), last, window)


EVEN = Pace(np.zeros(0), np.array([LOOP_STEP]))


def loop_grid(
    kinks: FloatArray,
    corners: FloatArray,
    begin: float,
    end: float,
    delays: Sequence[Retimed] = (),
    pace: Pace = EVEN,
) -> FloatArray:
    """Nodes for a loop from ``begin`` to ``end`` s: the same steps, at last by ``pace``, after every kink, as the
    exponential of each length is computed once, and the command's ``corners``; both when ``delays`` show them, and the
    corners where they are, as what is delayed is read between nodes. Rows of a dense curve are no corners."""
    far = np.diff(corners, prepend=-np.inf) > LOOP_STEP
    corners = corners[far | np.isin(corners, kinks)]
    own = np.concatenate([corners - KINK, corners, corners + KINK]) if delays else np.zeros(0)
    for op in delays:
        kinks, corners = op.shows(kinks), op.shows(corners)
        jumps = op.jumps(begin, end)
        kinks, corners = np.unique(np.concatenate([kinks, jumps])), np.concatenate([corners, jumps])
    starts = [begin, *kinks[(kinks > begin) & (kinks < end)].tolist(), end]
    parts = [_after(a, b, pace.at(0.5 * (a + b))) for a, b in pairwise(starts)]
    # Before a corner, too: a step is as late as it is, and does not begin at the node before it.
    grid = np.unique(np.concatenate([*parts, corners - KINK, corners, corners + KINK, own, [end]]))
    grid = grid[(grid >= begin) & (grid <= end)]
    return np.asarray(grid[np.diff(grid, prepend=-np.inf) > 0.5 * KINK])


def _after(kink: float, end: float, step: float) -> FloatArray:
    """Nodes (n,) s after a ``kink``, at last ``step`` s apart."""
    offsets = np.concatenate([[0.0, KINK], AFTER_KINK[:-1], np.arange(AFTER_KINK[-1], end - kink, step)])
    return np.asarray(kink + offsets[offsets < end - kink])
