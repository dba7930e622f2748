"""Which recordings to withhold, so that an effect is tested on what its parameters were not fitted to."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from acquire.recording.model import Recording
from gap.data.labels import direction, level
from gap.data.waveform import waveform
from protocols.specimens import SPECIMENS


def splits(recordings: Sequence[Recording]) -> dict[str, set[int]]:
    """Which recordings to withhold, for each kind of split that the session allows.

    A reference specimen is measured once, and is what an effect is learnt from: none is withheld.
    """
    measured = {k: r for k, r in enumerate(recordings) if r.info.specimen not in SPECIMENS}
    keys: dict[str, Callable[[Recording], str]] = {"level": level, "direction": direction, "waveform": waveform}
    out: dict[str, set[int]] = {}
    for name, key in keys.items():
        groups: dict[str, set[int]] = {}
        for k, r in measured.items():
            groups.setdefault(key(r), set()).add(k)
        if len(groups) > 1:
            # Withhold the smaller part, but never the top level: that would be extrapolation.
            ordered = sorted(groups.items(), key=lambda kv: (len(kv[1]), kv[0]))
            out[name] = ordered[0][1] if name != "level" else sorted(groups.items(), key=_leading_number)[0][1]
    conditions: dict[tuple[str, str, str], list[int]] = {}
    for k, r in measured.items():
        conditions.setdefault((level(r), direction(r), waveform(r)), []).append(k)
    repeats = {members[-1] for members in conditions.values() if len(members) > 1}
    if repeats and len(repeats) < len(recordings):
        out["repeat"] = repeats
    return out


SAME = 0.02
"""Difference of two commands, in parts of their range or duration, below which they are the same."""


def splits_of_a_rig(recordings: Sequence[Recording]) -> dict[str, set[int]]:
    """The same for a rig that is not ours, where only what was commanded tells a repeat from another waveform.

    Without set-points nobody knows which it is: the last recording is withheld as just that, a ``recording``.
    """
    if len(recordings) < 2:
        return {}
    if not all(any(len(s.time) > 1 for s in r.setpoints.values()) for r in recordings):
        return {"recording": {len(recordings) - 1}}
    kinds: list[list[int]] = []
    for k, r in enumerate(recordings):
        like = next((kind for kind in kinds if _same_command(recordings[kind[0]], r)), None)
        if like is None:
            kinds.append([k])
        else:
            like.append(k)
    rare = min(range(len(kinds)), key=lambda k: (len(kinds[k]), -k))
    out = {"waveform": set(kinds[rare])} if len(kinds) > 1 else {}
    repeats = {kind[-1] for kind in kinds if len(kind) > 1}
    return {**out, "repeat": repeats} if repeats else out


def _same_command(one: Recording, other: Recording) -> bool:
    if set(one.setpoints) != set(other.setpoints):
        return False
    share = np.linspace(0.0, 1.0, 1000)
    for name, a in one.setpoints.items():
        b = other.setpoints[name]
        durations = [float(s.time[-1] - s.time[0]) for s in (a, b)]
        values = [np.interp(s.time[0] + share * d, s.time, s.value) for s, d in zip((a, b), durations, strict=True)]
        span = max(np.ptp(values), 1e-300)
        if abs(durations[0] - durations[1]) > SAME * max(durations):
            return False
        if np.sqrt(np.mean(np.square(values[0] - values[1]))) > SAME * span:
            return False
    return True


def _leading_number(item: tuple[str, set[int]]) -> float:
    try:
        return float(item[0].split()[0].rstrip("°").split("°")[0])
    except ValueError:
        return 0.0
