"""Friction of an axis within a step, solved with the speed that it leaves."""

from __future__ import annotations

import math

from numba import njit

THIN_AT = 1e-3
"""m/s at which the drag of a thinning grease is stated."""
_ROUNDS = 30  # of a search for friction at most
_CLOSE = 1e-5  # of its level, by which it may be off before the last step of Newton's, and 1e-10 behind it
_NEAR = 1e-4  # step of the logarithm of a speed, from which on the next would be as good as none


@njit(cache=True, error_model="numpy")
def bristle(held: float, free: float, yields: float, level: float, per_metre: float) -> float:
    """Presliding friction (N) behind a step: Dahl's f' = |x'| (±level - f) / presliding, solved with the speed that it
    leaves.

    ``held`` N is that before it, ``free`` m/s the mean speed without friction, which each newton of both friction
    forces lowers by ``yields``, and ``per_metre`` the step over the presliding length, s/m. More friction leaves less
    speed, and less speed builds up less friction, so that there is one solution between the levels.
    """
    low, high = -level, level
    after = min(max(held, low), high)
    for _ in range(_ROUNDS):
        speed = free - yields * (held + after)
        goal = level if speed > 0.0 else -level
        decay = math.exp(-abs(speed) * per_metre)
        excess = after - goal - (held - goal) * decay
        if excess > 0.0:
            high = after
        else:
            low = after
        slope = 1.0 + yields * per_metre * abs(goal - held) * decay
        after -= excess / slope
        if not low <= after <= high:
            after = 0.5 * (low + high)
        elif abs(excess) < _CLOSE * level:
            break
    return after


@njit(cache=True, error_model="numpy")
def thinned(free: float, yields: float, strength: float, power: float) -> float:
    """Drag (N) of a grease that shear thins, or of air that swirls, against a step's mean speed ``free`` m/s that it is
    lowered from by ``yields`` for each newton: ``strength`` N at 1 m/s, growing with a ``power`` of the speed that is
    left, below 1 of a grease and 2 of air."""
    speed = abs(free)
    if speed == 0.0:
        return 0.0
    # The speed that is left solves left + slowed(left) = speed: convex in its logarithm, and begun from above.
    slows = yields * strength
    q = math.log(speed)
    q = min(q, (q - math.log(slows)) / power)
    for _ in range(_ROUNDS):
        left, slowed = math.exp(q), slows * math.exp(power * q)
        step = (left + slowed - speed) / (left + power * slowed)
        q -= step
        if abs(step) < _NEAR:
            break
    return -math.copysign(slows * math.exp(power * q) / yields, free)


@njit(cache=True, error_model="numpy")
def eased(free: float, yields: float, level: float, easing: float) -> float:
    """Dry friction (N) that is eased about standstill, level·tanh(speed/easing), against a step's mean speed ``free``
    m/s that it is lowered from by ``yields`` for each newton."""
    way, speed = math.copysign(1.0, free), abs(free)
    low, high = 0.0, min(level, speed / yields)  # what would stop it
    dry = high
    for _ in range(_ROUNDS):
        share = math.tanh((speed - yields * dry) / easing)
        excess = dry - level * share
        if excess > 0.0:
            high = dry
        else:
            low = dry
        dry -= excess / (1.0 + level * (1.0 - share * share) * yields / easing)
        if not low <= dry <= high:
            dry = 0.5 * (low + high)
        elif abs(excess) < _CLOSE * level:
            break
    return float(-way * dry)
