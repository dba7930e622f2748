"""The hidden effects as they are, in other forms than a textbook's, and ignorant of the diagnosis' formulas."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.rigs.worlds.tools import Array, Step, soft


def lugre(level: float, excess: float, stribeck: float, presliding: float, uneven: float) -> Callable[[float], Step]:
    """LuGre friction: bristles of ``presliding`` travel, higher at rest by ``excess``, unlike in the two directions."""

    def make(dt: float) -> Step:
        z = 0.0

        def step(y: float, velocity: float = 0.0, **_: float) -> float:
            nonlocal z
            v = velocity
            g = 1 + excess * np.exp(-(abs(v / stribeck) ** 1.4))
            rate = abs(v) / (presliding * g)
            end = g * np.sign(v)
            z = end + (z - end) * np.exp(-rate * dt)
            return y + level * z * (1 + uneven * np.sign(z))

        return step

    return make


def memoryless(f: Callable[..., float]) -> Callable[[float], Step]:
    return lambda dt: f


def rubbing(level: float, v0: float, uneven: float) -> Callable[..., float]:
    """Dry friction with an arctangent and unlike directions, against ``velocity``; added to the value."""

    def f(y: float, velocity: float = 0.0, **_: float) -> float:
        s = 2 / np.pi * np.arctan(velocity / v0)
        return y + level * (s + uneven * abs(s))

    return f


def play(gap: float) -> Callable[[float], Step]:
    """Backlash of full width ``gap``; at first in its middle."""

    def make(dt: float) -> Step:
        p = np.nan

        def step(y: float, **_: float) -> float:
            nonlocal p
            p = y if np.isnan(p) else min(max(p, y - gap / 2), y + gap / 2)
            return p

        return step

    return make


def plays(weights: Array, radii: Array) -> Callable[[float], Step]:
    """Prandtl-Ishlinskii: a sum of play operators on the signal."""

    def make(dt: float) -> Step:
        p = np.zeros(radii.size)

        def step(y: float, **_: float) -> float:
            np.clip(p, y - radii, y + radii, out=p)
            return float(y + weights @ (p - y))

        return step

    return make


def preisach(rng: np.random.Generator, share: float, span: float) -> Callable[[float], Step]:
    """Relays with a bell-shaped density; their sum, of unit amplitude, takes ``share`` of the signal's ``span``."""
    up, down = np.sort(rng.normal([[0.25], [-0.25]], 0.35, (2, 1500)), axis=0)[::-1] * span

    def make(dt: float) -> Step:
        state = np.where(0.5 * (up + down) < 0, 1.0, -1.0)

        def step(y: float, **_: float) -> float:
            state[y >= up] = 1.0
            state[y <= down] = -1.0
            return float((1 - share) * y + share * span * state.mean())

        return step

    return make


def dead(left: float, right: float, corner: float) -> Callable[..., float]:
    """A dead zone from -left to right with round corners."""

    def f(y: float, **_: float) -> float:
        return soft(y - right, corner) - soft(-y - left, corner)

    return f


def late(delay: Callable[[int], float]) -> Callable[[float], Step]:
    """Delay of ``delay(i)`` s at the time ``i`` (s)."""

    def make(dt: float) -> Step:
        seen: list[float] = []

        def step(y: float, **_: float) -> float:
            seen.append(y)
            at = len(seen) - 1 - delay((len(seen) - 1) * dt) / dt
            i = int(np.floor(at))
            if i < 0:
                return seen[0]
            if i + 1 >= len(seen):
                return y
            return seen[i] + (at - i) * (seen[i + 1] - seen[i])

        return step

    return make


def relaxing(shares: Array, taus: Array) -> Callable[[float], Step]:
    """Slow modes added to the signal: each of ``shares`` follows it with its own ``taus`` s."""

    def make(dt: float) -> Step:
        z = np.full(taus.size, np.nan)
        keep = np.exp(-dt / taus)

        def step(y: float, **_: float) -> float:
            nonlocal z
            z = np.zeros(taus.size) if np.isnan(z[0]) else y + (z - y) * keep
            return float(y + shares @ z)

        return step

    return make
