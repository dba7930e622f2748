"""A robot's recorded channels as tables for signals of its chain."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from gap.data.smoothing import deviation, significant
from gap.null.blocks import Block
from gap.null.groups import Group, Table
from sim_devices.chain import FloatArray
from sim_devices.stages.robot import numbered

SETTLING = 1e-3 * np.array([0.0, 1.0, 3.0, 6.0, 10.0, 15.0, 20.0, 30.0, 50.0, 80.0, 130.0])
"""s after a row of a command, at which an axis that follows it is looked at where nothing was recorded."""


def recorded(
    block: Block, group: Group, names: Sequence[str], targets: Sequence[str], smooth: bool
) -> dict[str, Table]:
    """Recorded channels of a group as tables for signals of the chain, without their noise if ``smooth``."""
    out = {}
    for name, target in zip(names, targets, strict=True):
        times, values = [], []
        for k in group.members:
            series = block.session.recordings[k].streams.get(name)
            if series is None:
                continue
            value = np.asarray(series.value, dtype=float)
            good = np.isfinite(value)
            time = block.session.time(k, series)[good]
            times.append(time)
            values.append(significant(time, value[good]) if smooth else value[good])
        if times:
            out[target] = (np.concatenate(times), np.concatenate(values))
    return out


def path_of_axes(block: Block, group: Group, fitted: Callable[[Group, FloatArray], FloatArray]) -> dict[str, Table]:
    """Axis positions of a group without their sensors' noise, from before its first sample to its last: the ``fitted``
    axes, and the significant part of the record's difference from them.

    Skin remembers how the probe came to where a recording begins, and where it was between two of them. Nothing was
    recorded there; the fitted axes follow the command.
    """
    raw = recorded(block, group, numbered("axis_position"), numbered("axis"), smooth=False)
    time = raw["axis_1"][0]
    every = np.union1d(time, _unrecorded(block, group))
    at = fitted(group, every)
    there = np.searchsorted(every, time)
    return {
        name: (every, base + np.interp(every, time, deviation(time, value - base[there])))
        for (name, (_, value)), base in zip(raw.items(), at, strict=True)
    }


def _unrecorded(block: Block, group: Group) -> FloatArray:
    """Times (n,) s before the recordings of a group, and between two of them, that show how it moves there."""
    rows = np.unique(np.concatenate([time for time, _ in block.tables(group).values()]))
    spans = sorted(block.session.span(k) for k in group.members)
    ended = [rows[0] - SETTLING[1], *(end for _, end in spans[:-1])]
    out = []
    for end, (begin, _) in zip(ended, spans, strict=True):
        moved = (rows[(rows >= end) & (rows < begin)][:, None] + SETTLING).ravel()
        out.append(np.r_[end, moved[moved < begin]])
    return np.unique(np.concatenate(out))


def steepness(block: Block, tables: Sequence[Mapping[str, Table]], names: Sequence[str]) -> FloatArray:
    """How steep a block's channels are at its stamps, (channels · n,) per s, by ``tables`` of them for each group."""
    out = np.zeros((len(names), len(block.stamps)))
    for (_, at), given in zip(block.groups, tables, strict=True):
        for row, name in zip(out, names, strict=True):
            if name in given:
                time, first = np.unique(given[name][0], return_index=True)
                row[at] = np.interp(block.stamps[at], time, np.gradient(given[name][1][first], time))
    return out.ravel()
