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
    """A command for a while: break points (m,) s and values (m, quantities); equal times are a step."""

    time: FloatArray
    values: FloatArray

    def shifted(self, offset: float) -> Waveform:
        """The same, ``offset`` s later."""
        return Waveform(self.time + offset, self.values)


def grid(first: int, count: int, rate: float, substeps: int, waveform: Waveform) -> FloatArray:
    """Nodes in s for ``count`` samples from number ``first`` at ``rate`` per s, after the last node computed before."""
    start = max(0, (first - 1) * substeps + 1) if first else 0
    even = np.arange(start, (first + count - 1) * substeps + 1) / (rate * substeps)
    breaks, begin = waveform.time, waveform.time[0]
    steps = breaks[1:][np.diff(breaks) < 0.25 * JUMP]
    # At the seam the node before the step is there already.
    before = steps[steps > begin + JUMP] - JUMP
    seam = steps[steps <= begin + JUMP] + JUMP
    inner = np.concatenate([breaks[breaks > begin + JUMP], before, seam])
    inner = inner[inner < even[-1]]
    if not len(inner):
        return even
    nodes = np.sort(np.concatenate([even, inner]))
    return nodes[np.diff(nodes, prepend=-np.inf) > 0.25 * JUMP]


def commanded(waveform: Waveform, nodes: FloatArray, quantities: tuple[str, ...]) -> Iterator[tuple[str, FloatArray]]:
    """Each quantity's values on the nodes, right-continuous."""
    for k, quantity in enumerate(quantities):
        # A node that rounding put just before a step counts as on it; the node before, a whole `JUMP` away, does not.
        yield quantity, np.interp(nodes + 0.5 * JUMP, waveform.time, waveform.values[:, k])
