"""Whether links still deliver: new samples, not merely bytes, from a device whose clock runs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from acquire.engine.rules import Rules, Trip
from drivers.signals import Block, Frame

_NONE = (-1, -math.inf)


@dataclass
class _Link:
    """Counts and times of a link's deliveries. Times are of the wall (monotonic s) but for ``first`` and the stamps."""

    heard: float  # when its newest sample came
    arrived: float = -math.inf  # when anything came
    began: float = math.nan  # when its first sample came
    first: float = math.nan  # that sample's device time
    latest: float = math.nan  # the newest sample's device time
    stamps: dict[tuple[str, ...], tuple[int, float]] = field(default_factory=dict)  # newest per kind of item


class Freshness:
    """Watches links for one run. `take` is called by each link's own thread."""

    def __init__(self, links: Iterable[str], rules: Rules, now: float) -> None:
        """The first of ``links`` is the driven device's, whose clock the run goes by; ``now`` is wall time in s."""
        self._links = {name: _Link(now) for name in links}
        self._rules = rules

    def take(self, link: str, item: Block | Frame, now: float) -> Block | Frame | None:
        """The new part of ``item``, arriving at ``now`` (wall, s); None where it is repeated, or late."""
        known = self._links.setdefault(link, _Link(now))
        known.arrived = now
        kind = tuple(item.values) if isinstance(item, Block) else ("frame",)
        seq, time = known.stamps.get(kind, _NONE)
        if isinstance(item, Block):
            new = item.new_samples(seq, time)
            if not new.any():
                return None
            item = item if new.all() else item.where(new)
            known.stamps[kind] = int(item.seq[-1]), float(item.time[-1])
        elif item.seq <= seq or item.time <= time:
            return None
        else:
            known.stamps[kind] = item.seq, item.time
        known.heard = now
        known.latest = float(np.max(item.time))
        if math.isnan(known.first):
            known.began, known.first = now, known.latest
        return item

    def fault(self, now: float) -> Trip | None:
        """The fault at ``now`` (wall, s), in words."""
        for name, link in self._links.items():
            silence = now - link.heard
            if silence > self._rules.stale:
                last = "" if math.isnan(link.latest) else f"; the last is of device time {link.latest:.6g} s"
                what = "delivers nothing" if link.arrived <= link.heard else "repeats what is known, with no new sample"
                return Trip("stale", f"{name} {what} for {silence:.2f} s{last}", link.latest)
        for name, device in itertools.islice(self._links.items(), 1):
            wall, time = now - device.began, device.latest - device.first
            if time < (1 - self._rules.lag) * wall - self._rules.stale:  # False before the first sample
                message = f"{name}'s clock is slow: {time:.2f} s went by in {wall:.2f} s"
                return Trip("clock", message, device.latest)
        return None
