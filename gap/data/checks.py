"""Whether recordings can be diagnosed together, and their weak points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acquire.recording.model import Recording
from gap.data.session import REST, Session


class DiagnosisError(ValueError):
    """The recordings cannot be diagnosed at all: the message names the recording and the channel."""


def in_order(recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings by their session clock. Raises DiagnosisError for none, or for several instruments."""
    if not recordings:
        raise DiagnosisError("no recording to diagnose")
    instruments = {r.info.instrument for r in recordings}
    if len(instruments) > 1:
        raise DiagnosisError(
            f"recordings of several instruments ({', '.join(sorted(instruments))}): diagnose each apart"
        )
    for r in recordings:
        if not r.streams:
            raise DiagnosisError(f"recording {r.info.id} has no measured channel")
    return sorted(recordings, key=lambda r: (r.info.start_time, _first_time(r)))


def _first_time(recording: Recording) -> float:
    return min((float(s.time[0]) for s in recording.streams.values() if len(s.time)), default=0.0)


def remarks(recordings: Sequence[Recording], one_clock: bool) -> list[str]:
    """Weaknesses of the data, in plain words; ``one_clock`` is whether rests between recordings matter."""
    out = []
    for r in recordings:
        for name, s in r.streams.items():
            bad = int(np.sum(~np.isfinite(s.value)))
            if bad:
                out.append(
                    f"{r.info.id}: channel {name} has {bad} of {len(s.value)} samples that are not numbers; left out"
                )
            if len(s.time) > 1 and np.any(np.diff(s.time) <= 0):
                out.append(f"{r.info.id}: time stamps of {name} do not always increase")
    if one_clock and Session(recordings).own_clocks:
        out.append(f"every recording has a clock of its own: rests of {REST:.0f} s between them are assumed")
    if len(recordings) == 1:
        out.append(
            "one recording only: no repeat to take the noise from, and shrinkage on unused data cannot be tested"
        )
    return out
