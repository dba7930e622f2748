"""Chains as the diagnosis runs them: only the operators that the wanted signals need."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from sim_devices.chain import Chain


def pruned(chain: Chain, wanted: Iterable[str], given: Iterable[str] = ()) -> Chain:
    """The chain without operators that contribute nothing to ``wanted`` once the signals ``given`` are supplied."""
    needed, supplied = set(wanted), set(given)
    kept = []
    for op in reversed(chain.operators):
        makes = (set(op.writes) & needed) - supplied
        if makes:
            kept.append(op)
            needed -= set(op.writes) - set(op.reads)
            needed |= set(op.reads) - supplied
    return replace(chain, operators=tuple(reversed(kept)))
