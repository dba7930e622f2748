"""From the executed waveform to the nodes on which the chain is advanced.

Nodes are evenly spaced, with two more at each step of the command: one just before it and one on it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drivers.signals import FloatArray

#: Duration of a step in s.
JUMP = 1e-9


@dataclass(frozen=True)
class Waveform:
    """What is commanded for a while: break points (m,) s and values (m, quantities); equal times are a step."""

    time: FloatArray
    values: FloatArray

    def shifted(self, offset: float) -> Waveform:
        """The same, ``offset`` s later."""
        return Waveform(self.time + offset, self.values)


def _sharp(waveform: Waveform) -> tuple[FloatArray, FloatArray]:
    """Break points with strictly increasing times: each step takes `JUMP` s, of several at once only the ends count."""
    time = waveform.time.copy()
    step = np.diff(time) < JUMP
    before = np.concatenate([step, [False]]) & ~np.concatenate([[False], step])
    after = np.concatenate([[False], step]) & ~np.concatenate([step, [False]])
    time[before] -= JUMP
    if before[0]:  # a step where the stretch begins: the node before it is computed already
        time[0] += JUMP
        time[np.flatnonzero(after)[0]] = time[0] + JUMP
    kept = before | after | ~(np.concatenate([step, [False]]) | np.concatenate([[False], step]))
    return time[kept], waveform.values[kept]


def grid(first: int, count: int, rate: float, substeps: int, waveform: Waveform) -> FloatArray:
    """Nodes in s for ``count`` samples from number ``first`` at ``rate`` per s, after the last node computed before."""
    start = max(0, (first - 1) * substeps + 1) if first else 0
    even = np.arange(start, (first + count - 1) * substeps + 1) / (rate * substeps)
    time, _ = _sharp(waveform)
    inner = time[(time > waveform.time[0]) & (time < even[-1])]
    if not len(inner):
        return even
    nodes = np.sort(np.concatenate([even, inner]))
    return nodes[np.diff(nodes, prepend=-np.inf) > 0.25 * JUMP]


def commanded(waveform: Waveform, nodes: FloatArray, quantities: tuple[str, ...]) -> Iterator[tuple[str, FloatArray]]:
    """Each quantity's values on the nodes."""
    time, values = _sharp(waveform)
    for k, quantity in enumerate(quantities):
        yield quantity, np.interp(nodes, time, values[:, k])
