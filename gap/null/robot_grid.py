"""Where the robot's loop is simulated: dense where its command bends, sparse elsewhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import takewhile

import numpy as np
from numpy.typing import NDArray

from gap.data.session import Pace, evenly
from gap.null.chains import run
from sim_devices.chain import FloatArray, Operator, Signals
from sim_devices.stages.operators import Retimed
from sim_devices.stages.sampling import Table, mean_before, merged

KINK = 1e-6
"""s, within which a speed changes."""
LOOP_STEP, LOOP_CURVE, LOOP_TURN = 0.05, 0.02, 0.04
"""s at most; of a curved command, and rad by which it may turn in a step: the loop is exact between kinks, so this only
has to resolve curved motion, and how the load changes."""
CURVE = 0.05
"""s between two rows of a command up to which they are of a curve: the loop follows its nodes as well as the rows."""
AFTER_KINK = np.concatenate([np.arange(0.001, 0.03, 0.001), np.arange(0.03, 0.1, 0.004), np.arange(0.1, 0.3, 0.01)])
"""s after a kink: nodes for the loop's answer, which straight lines over `LOOP_STEP` would miss by several µm. A step
of 0.5 mm sets off at 15 m/s²: over 4 ms a straight line is up to 30 µm beside that, over 1 ms 2 µm."""

STICKING, STICKS = 0.006, 4.0
"""s between nodes where an axis sticks and slips: it slips within some 20 ms; and times what forces show by which it
does: its smoothed record has noise of its own."""
CLOSE, FEW_OF = 0.03, 4
"""s apart up to which kinks are the looks at a moving command, small steps all; and how many-th node is taken there."""


def retimed(operators: Sequence[Operator]) -> tuple[Retimed, ...]:
    """Those of the leading operators that do show the command at other moments."""
    return tuple(op for op in leading(operators) if op.moves)


def leading(operators: Sequence[Operator]) -> tuple[Retimed, ...]:
    """The operators that show the command at other moments before anything else is done with it, moving or not."""
    return tuple(op for op in takewhile(lambda op: isinstance(op, Retimed), operators) if isinstance(op, Retimed))


def commanded(grid: FloatArray, tables: Mapping[str, Table], delays: Sequence[Retimed]) -> dict[str, FloatArray]:
    """Commands by ``tables``, and what ``delays`` ahead of all else make of them, moving or not, on a ``grid`` (n,) s.

    Between the nodes a command is straight and as high in the mean as it is, so that a curve may be sampled as widely
    as the loop follows slowly; and delays show its own rows, not those of the grid, whose curve is flatter.
    """
    steps = [time[1:][np.diff(time) <= KINK] - KINK for time, _ in tables.values()]
    shown = rows = np.concatenate([*(time for time, _ in tables.values()), *steps])
    for op in delays:
        shown = op.shows(shown)
    time = merged(np.concatenate([rows, shown, grid]), 0.0)
    signals: Signals = run(delays, time, {name: np.interp(time, *table) for name, table in tables.items()})
    read = delays[-1].target if delays else tuple(tables)
    at = np.searchsorted(time, grid)
    return {name: _as_high(time, signals[name], at) for name in read}


def _as_high(time: FloatArray, value: FloatArray, at: NDArray[np.int64]) -> FloatArray:
    """Nodes (n,) of straight lines whose mean over a step is, at even curvature, that of the table of ``value`` (m,) by
    ``time`` (m,) s, of which they are the rows ``at`` (n,); a table's corner that is a node stays where it is."""
    nodes, step = value[at], np.diff(time[at])
    area = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(time) * (value[1:] + value[:-1]))])
    above = np.diff(area[at]) / step - 0.5 * (nodes[1:] + nodes[:-1])
    return np.asarray(nodes + 0.5 * (np.append(above, 0.0) + np.append(0.0, above)))


def averaged(grid: FloatArray, signals: Sequence[FloatArray], ends: FloatArray) -> FloatArray:
    """Means of signals (m,) on a grid over bins whose samples, evenly spaced, lie a standard deviation to either side
    at ``ends`` (2, n) s: (signals, n)."""
    window = np.maximum(np.sqrt(3.0) * (ends[1] - ends[0]), KINK)
    last = ends.mean(axis=0) + 0.5 * window
    return mean_before(grid, np.stack(signals), last, window)


def sticking(tables: Mapping[str, Table], ends: FloatArray, seen: float) -> NDArray[np.bool_]:
    """Which bins of nodes ``ends`` (2, n) s, (n,), have a mean that these two miss: an axis, by ``tables`` of them,
    sticks and slips within such a bin by more than the share of its way that is ``seen`` in the forces."""
    missed = [averaged(t, [v], ends)[0] - np.interp(ends, t, v).mean(axis=0) for t, v in tables.values()]
    farthest = max(float(np.ptp(v)) for _, v in tables.values())
    return np.asarray(np.max(np.abs(missed), axis=0) > STICKS * seen * farthest)


def nodes_within(ends: FloatArray) -> FloatArray:
    """Nodes (m,) s, `STICKING` apart, for the means (`averaged`) of bins of nodes ``ends`` (2, n) s."""
    middle, half = ends.mean(axis=0), 0.5 * np.sqrt(3.0) * (ends[1] - ends[0])
    return evenly(middle - half, 2.0 * half, np.full(len(half), STICKING))


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
    exponential of each length is computed once, and the command's ``corners``; both when ``delays`` show them. Rows of
    a dense curve are no corners."""
    corners = corners[np.diff(corners, prepend=-np.inf) > CURVE]
    for op in delays:
        kinks, corners = op.shows(kinks), op.shows(corners)
        kinks = np.unique(np.concatenate([kinks, op.jumps(begin, end)]))
    known = np.union1d(kinks, pace.edges)  # a curve begins and ends smoothly, and the loop answers to it all the same
    starts = np.concatenate([[begin], known[(known > begin) & (known < end)], [end]])
    nodes = _after(starts[:-1], np.diff(starts), pace.at(0.5 * (starts[1:] + starts[:-1])))
    # Before a kink, too: a step is as late as it is, and does not begin at the node before it.
    grid = np.concatenate([nodes, kinks - KINK, kinks, kinks + KINK, corners, [end]])
    return merged(grid[(grid >= begin) & (grid <= end)], 0.5 * KINK)


def _after(kinks: FloatArray, spans: FloatArray, steps: FloatArray) -> FloatArray:
    """Nodes (n,) s after each of ``kinks`` (k,) s, within its span (k,) s, at last a step (k,) s apart, or from the
    beginning on where that is closer."""
    soon = np.concatenate([[0.0, KINK], AFTER_KINK[:-1]])
    few = np.concatenate([[True, True], np.arange(1, len(AFTER_KINK)) % FEW_OF == 0])
    after = np.where(steps < AFTER_KINK[0], steps, AFTER_KINK[-1])
    later = evenly(kinks + after, spans - after, steps)
    taken = (soon < spans[:, None]) & (few | (spans[:, None] > CLOSE))
    return np.concatenate([(kinks[:, None] + soon)[taken], later])


def thinned(
    grid: FloatArray, axes: Mapping[str, FloatArray], ends: FloatArray, kinks: FloatArray
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Nodes (m,) s of a ``grid`` that do for the difference of two simulations, and the ``axes`` there: what comes
    before the bins, their ``ends`` (2, k), and ``kinks`` (j,) of the commands."""
    begin = ends.min()
    inside = kinks[(kinks > begin) & (kinks < grid[-1])]
    nodes = np.unique(np.concatenate([grid[grid <= begin], ends.ravel(), inside, grid[-1:]]))
    return nodes, {name: np.interp(nodes, grid, value) for name, value in axes.items()}
