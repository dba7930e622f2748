"""Chains as the diagnosis runs them: only the operators that the wanted signals need, thousands of times."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable, Mapping
from functools import lru_cache, partial
from typing import Any

import numpy as np

from sim_devices.chain import Chain, FloatArray, Operator, Signals

Wiring = tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]
KEPT = 96
"""Results that are kept: those a Jacobian's columns share, and not more than the cache holds."""


def needed(chain: Chain, wanted: Iterable[str], given: Iterable[str] = ()) -> tuple[Operator, ...]:
    """The operators that contribute to ``wanted`` once the signals ``given`` are supplied, in order."""
    wiring = tuple([op.wiring for op in chain.operators])
    kept = _kept(wiring, tuple(wanted), tuple(given))
    return tuple(chain.operators[k] for k in kept)


@lru_cache(maxsize=4096)
def _kept(wiring: Wiring, wanted: tuple[str, ...], given: tuple[str, ...]) -> tuple[int, ...]:
    missing, supplied, kept = set(wanted) - set(given), set(given), []
    for k in range(len(wiring) - 1, -1, -1):
        reads, writes = wiring[k]
        if not missing.isdisjoint(writes):
            kept.append(k)
            missing.difference_update(set(writes) - set(reads))
            missing.update(set(reads) - supplied)
    return tuple(reversed(kept))


def run(operators: Iterable[Operator], time: FloatArray, signals: Mapping[str, FloatArray]) -> Signals:
    """All signals on ``time`` (n,) s from rest."""
    out: Signals = dict(signals)
    for op in operators:
        op.advance(op.fresh(), time, out)
    return out


UNDOINGS = 2
"""Steps in which an error is undone: of a relative error of 0.3 its third power is left."""


def undone(made: Callable[[FloatArray], FloatArray], read: FloatArray) -> FloatArray:
    """The true signals, (n,) or (k, n), where the sensors, which ``made`` readings of them, ``read`` these.

    Small errors go step by step; of an exchange of channels, or a sign, twice is nothing. Of an error larger than the
    signal the steps lead away, to a simulation that counts as diverged.
    """
    wrong = made(read)
    if np.max(np.abs(wrong - read), initial=0.0) > 0.1 * np.ptp(read) and np.allclose(made(wrong), read):
        return wrong
    true = read + read - wrong
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(UNDOINGS - 1):
            true = true + read - made(true)
    return true


class Kept:
    """The latest results by their inputs."""

    def __init__(self, size: int = KEPT) -> None:
        self._size = size
        self._results: OrderedDict[Hashable, Any] = OrderedDict()

    def get(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """The result of ``make`` for ``key``; made anew where it is not known, or the key cannot be one."""
        try:
            found = self._results.get(key)
        except TypeError:
            return make()
        if found is None:
            found = self._results[key] = make()
            if len(self._results) > self._size:
                self._results.popitem(last=False)
        else:
            self._results.move_to_end(key)
        return found


class Memo:
    """Runs operators on one time grid, each only where itself or its input is not as it was lately.

    Of neighbouring simulations most stages are the same: a sensor's effect leaves the tissue alone. Signals are told
    apart by identity, so whoever gives the same signal twice gives the same array; nobody may change it.
    """

    def __init__(self, time: FloatArray) -> None:
        self.time = time
        self._kept = Kept()

    def on_grid(self, time: FloatArray, value: FloatArray) -> FloatArray:
        """A table (m,) s and values on the grid."""
        # Inputs are kept with the result, so that no other array takes their identity.
        key = (id(time), id(value))
        return np.asarray(self._kept.get(key, lambda: (np.interp(self.time, time, value), time, value))[0])

    def run(self, operators: Iterable[Operator], signals: Mapping[str, FloatArray]) -> Signals:
        """All signals from rest."""
        out: Signals = dict(signals)
        for op in operators:
            read = {s: out[s] for s in op.wiring[0] if s in out}
            made, _ = self._kept.get((op, *map(id, read.values())), partial(self._made, op, read))
            out.update(made)
        return out

    def _made(self, op: Operator, read: Signals) -> tuple[Signals, Signals]:
        signals = dict(read)
        op.advance(op.fresh(), self.time, signals)
        return {s: signals[s] for s in op.writes}, read
