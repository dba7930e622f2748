"""Whether measured values can be true, though each of them is within its limits.

Faults that no host can see without a second gauge are in docs/safety.md: a gauge that is wrong from the start, or
slowly."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from acquire.engine.checks import UNKNOWN, Bools, Check, Lasting, Targets, Twice, Watch
from acquire.engine.rules import Trip
from acquire.words import reading
from drivers.signals import REFERENCE, Block, FloatArray, Frame

#: Chance of a streak of equal readings below which a channel counts as frozen, the least time in s of such a streak
#: (polls and converters repeat some), and how many readings must have shown how the channel's noise looks.
CHANCE, FREEZE, LEARNT = 1e-12, 0.5, 30
#: So many equal pictures are too many, if they last as long.
SAME_PICTURES = 5
#: White noise turns at two readings of three. A channel that turns at fewer than this share of them is smoothed, or its
#: resolution hides the noise: then nothing can be said.
NOISY = 0.4
#: A channel's recent past in s, with which its newest values are compared.
RECENT = 0.2
#: Suction in Pa, of a set-point, to which skin must respond, by how much (m: less than a step of the coarsest height
#: sensor) and within which time (s); after the release of a clear height (m) it must lose this share of it. Assumed.
PULL, RISE, RESPONSE, CLEAR, RECOVERY = 10_000.0, 8e-6, 2.0, 80e-6, 0.15


@dataclass
class _Noise:
    """Statistics of one channel: of ``pairs`` of neighbours how many were ``equal``, at how many it ``turns``."""

    pairs: int = 0
    equal: int = 0
    turns: int = 0
    last: float = math.nan
    step: float = 0.0  # from the reading before the last one to the last one
    again: int = 0  # how often the last reading has been repeated
    since: float = math.nan  # device time at which it was first read

    @property
    def streak(self) -> float:
        """How many equal readings are too many; inf where nothing can be said."""
        if self.pairs < LEARNT or self.turns < NOISY * self.pairs:
            return math.inf
        return math.log(CHANCE) / math.log((self.equal + 1) / (self.pairs + 2))


class Frozen:
    """A channel whose noise vanishes is no longer measured: its last reading is repeated.

    The noise is learnt from the run itself, while nothing is commanded to move. Zero, where converters clip, does not
    count. A height that is made of pictures is left out: `Pictures` looks at these themselves.
    """

    def __init__(self, watch: Watch) -> None:
        self._left_out = watch.gappy
        self._noise: dict[str, _Noise] = {}
        self._target: dict[str, float] = {}  # the last one of each quantity

    def look(self, block: Block, targets: Targets) -> Trip | None:
        """The fault in the next samples, for which ``targets`` are commanded."""
        still = np.ones(len(block), bool)
        for quantity, target in targets.items():
            before = np.append(self._target.get(quantity, math.nan), target[:-1])
            still &= (target == before) | (np.isnan(target) & np.isnan(before))
            self._target[quantity] = float(target[-1])
        for name, values in block.values.items():
            if name in self._left_out:
                continue
            noise = self._noise.setdefault(name, _Noise())
            self._learn(noise, values, block.time, still)
            if noise.again > noise.streak and block.time[-1] - noise.since >= FREEZE:
                message = f"{name} is frozen: {reading(name, noise.last)} {noise.again + 1} times running"
                return Trip("frozen", message, float(block.time[-1]))
        return None

    def _learn(self, noise: _Noise, values: FloatArray, when: FloatArray, still: Bools) -> None:
        steps = np.diff(values, prepend=noise.last)
        equal = (steps == 0) & (values != 0)
        turns = steps * np.append(noise.step, steps[:-1]) < 0
        changes = np.flatnonzero(~equal)
        noise.last, noise.step = float(values[-1]), float(steps[-1])
        if not len(changes):
            noise.again += len(values)
            return
        # A streak under way is not counted before it ends: a frozen channel must not teach that this one may freeze.
        end = int(changes[-1])
        counted = still[: end + 1] & (values[: end + 1] != 0)
        noise.pairs += int(counted.sum()) + noise.again
        noise.equal += int((counted & equal[: end + 1]).sum()) + noise.again
        noise.turns += int((counted & turns[: end + 1]).sum())
        noise.again, noise.since = len(values) - 1 - end, float(when[end])


class Pictures:
    """A camera's pictures are never twice the same: their noise would have to be."""

    def __init__(self) -> None:
        self._first: Frame | None = None
        self._again = 0

    def look(self, frame: Frame) -> Trip | None:
        """The fault of the next picture, in words."""
        if self._first is None or not np.array_equal(frame.image, self._first.image):
            self._first, self._again = frame, 0
            return None
        self._again += 1
        if self._again < SAME_PICTURES or frame.time - self._first.time < FREEZE:
            return None
        return Trip("frozen", f"the camera shows one picture {self._again + 1} times running", frame.time)


class Jumps:
    """The measured value does not leave its set-point at once, unless the set-point itself has just moved fast.

    A quantity with a `Tracking` rule may jump by half its error; the rule's duration is the time to settle. Where a
    segment ends the set-point is unknown for some samples: these are passed over, and are no move.
    """

    def __init__(self, watch: Watch) -> None:
        self._watch = watch
        self._twice = Twice()
        self._past: dict[str, deque[tuple[float, float, float]]] = {}  # device time, deviation, set-point
        self._moved: dict[str, float] = {}  # device time at which the set-point was last unknown or fast

    def look(self, block: Block, targets: Targets) -> Trip | None:
        """The fault in the next samples, for which ``targets`` are commanded."""
        for quantity, target in targets.items():
            if quantity not in block.values or quantity not in self._watch.rules.tracking:
                continue
            known = ~np.isnan(target)
            deviation = block.values[quantity] - target
            if known.any() and (trip := self._look(quantity, block.time[known], deviation[known], target[known])):
                return trip
        return None

    def _look(self, quantity: str, when: FloatArray, deviation: FloatArray, target: FloatArray) -> Trip | None:
        rule = self._watch.rules.tracking[quantity]
        past = self._past.setdefault(quantity, deque())
        if (np.diff(when, prepend=past[-1][0] if past else -math.inf) > UNKNOWN).any():
            past.clear()
        usual = float(np.median([d for _, d, _ in past])) if past else math.nan
        moved = ~(np.abs(target - (past[0][2] if past else math.nan)) <= rule.error / 2)  # True without a past
        if moved.any():
            self._moved[quantity] = float(when[moved][-1])
        settled = when - self._moved.get(quantity, -math.inf) > rule.duration
        jumps = self._twice(quantity, settled & (np.abs(deviation - usual) > rule.error / 2))
        past.extend(zip(when.tolist(), deviation.tolist(), target.tolist(), strict=True))
        while past[0][0] < when[-1] - RECENT:
            past.popleft()
        if not jumps.any():
            return None
        first = jumps.argmax()
        text = f"{quantity} jumps by {reading(quantity, deviation[first] - usual)} although its set-point does not"
        return Trip("jump", text, float(when[first]))


class Response:
    """Skin that is pulled comes up, and skin that is released comes down again.

    A height that stays is a dead sensor, or suction that is not there; one that stays after the release is suction that
    the gauge does not show. A height that is made of pictures is a preview, and stops nothing.
    """

    def __init__(self, watch: Watch) -> None:
        self._asked = watch.yields and "apex_height" not in watch.gappy
        self._rest: deque[tuple[float, float]] = deque()  # the last second's heights at rest
        self._recent: deque[tuple[float, float]] = deque()  # the last heights
        self._start = math.nan  # height at rest before the pull
        self._since = math.nan  # device time at which pull or rest began
        self._pulled = self._judged = False
        self._peak = -math.inf
        self._known = math.nan  # device time at which a set-point was last known

    def look(self, block: Block, targets: Targets) -> Trip | None:
        """The fault in the next samples, for which ``targets`` are commanded."""
        if not self._asked or "apex_height" not in block.values:
            return None
        target = targets.get("pressure", np.full(len(block), math.nan))
        for sample in zip(block.time.tolist(), block.values["apex_height"].tolist(), target.tolist(), strict=True):
            if trip := self._sample(*sample):
                return trip
        return None

    def _sample(self, time: float, height: float, target: float) -> Trip | None:
        # Where a segment ends the set-point is unknown for some samples; only for longer may anything have happened.
        if math.isnan(target):
            if not time - self._known <= UNKNOWN:
                self._forget()
            return None
        self._known = time
        if not math.isfinite(height):
            return None
        _remember(self._recent, time, height, RESPONSE / 4)
        if target == 0:
            return self._resting(time, height)
        if abs(target) >= PULL:
            return self._pulling(time)
        return None

    def _resting(self, time: float, height: float) -> Trip | None:
        if self._pulled:
            self._pulled, self._judged, self._since = False, False, time
            self._rest.clear()
        _remember(self._rest, time, height, RESPONSE / 2)
        if self._judged or not time - self._since >= RESPONSE:  # NaN is not
            return None
        self._judged = True
        rise, left = self._peak - self._start, _middle(self._recent) - self._start
        if not rise >= CLEAR or left <= (1 - RECOVERY) * rise:
            return None
        text = f"apex_height keeps {left:.3g} of {rise:.3g} m although vented for {RESPONSE:g} s"
        return Trip("response", f"{text}: is there still suction?", time)

    def _pulling(self, time: float) -> Trip | None:
        if not self._pulled:
            self._pulled, self._judged, self._since = True, False, time
            start = _middle(self._rest) if len(self._rest) > 2 else math.nan
            # Skin that has not come down yet need not come up: the sensor may be at its end.
            self._start = start if abs(start) < CLEAR else math.nan
            self._peak = -math.inf
        if time - self._since < RESPONSE:
            return None
        reached = _middle(self._recent)
        self._peak = max(self._peak, reached)
        if self._judged or not reached - self._start < RISE:  # NaN is not
            self._judged = True
            return None
        text = f"apex_height rises by {reached - self._start:.3g} m only, {RESPONSE:g} s after suction began"
        return Trip("response", f"{text}: height or pressure is wrong, or nothing is sucked in", time)

    def _forget(self) -> None:
        self._rest.clear()
        self._start = self._since = math.nan
        self._pulled, self._peak = False, -math.inf


class Agreement:
    """Two gauges of one quantity agree: ``NAME`` and ``NAME_reference``."""

    def __init__(self, watch: Watch) -> None:
        self._rules = watch.rules.agreement if watch.compared else {}
        self._lasting = Lasting()

    def look(self, block: Block, targets: Targets) -> Trip | None:
        """The fault in the next samples, for which ``targets`` are commanded."""
        for name, rule in self._rules.items():
            if {name, name + REFERENCE} <= set(block.values):
                apart = block.values[name] - block.values[name + REFERENCE]
                if self._lasting(name, np.abs(apart) > rule.error, block.time, rule.duration):
                    text = (
                        f"{name} and {name}{REFERENCE} are {reading(name, apart[-1])} apart since {rule.duration:g} s"
                    )
                    return Trip("reference", text, float(block.time[-1]))
        return None


PLAUSIBILITY: tuple[type[Check], ...] = (Frozen, Jumps, Response, Agreement)


def _remember(past: deque[tuple[float, float]], time: float, value: float, span: float) -> None:
    past.append((time, value))
    while past[0][0] < time - span:
        past.popleft()


def _middle(past: deque[tuple[float, float]]) -> float:
    return float(np.median([value for _, value in past]))
