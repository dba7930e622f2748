"""A robot's recorded channels as tables for signals of its chain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gap.data.smoothing import significant
from gap.null.blocks import Block, Group, Table
from sim_devices.chain import FloatArray


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


def steepness(block: Block, tables: Sequence[Mapping[str, Table]], names: Sequence[str]) -> FloatArray:
    """How steep a block's channels are at its stamps, (channels · n,) per s, by ``tables`` of them for each group."""
    out = np.zeros((len(names), len(block.stamps)))
    for (_, at), given in zip(block.groups, tables, strict=True):
        for row, name in zip(out, names, strict=True):
            if name in given:
                time, first = np.unique(given[name][0], return_index=True)
                row[at] = np.interp(block.stamps[at], time, np.gradient(given[name][1][first], time))
    return out.ravel()
