"""Chains as the diagnosis runs them: only the operators that the wanted signals need, thousands of times."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache

from sim_devices.chain import Chain, FloatArray, Operator, Signals

Wiring = tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]


def needed(chain: Chain, wanted: Iterable[str], given: Iterable[str] = ()) -> tuple[Operator, ...]:
    """The operators that contribute to ``wanted`` once the signals ``given`` are supplied, in order."""
    wiring = tuple((op.reads, op.writes) for op in chain.operators)
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
