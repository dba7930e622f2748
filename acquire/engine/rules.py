"""How strict the interlock is, the bounds of that, and how it says that it tripped."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from protocols import units

AXES = ("probe_x", "probe_y", "probe_z")

#: Least and most of every rule: beyond them it protects nobody, or trips on nothing. Assumed.
BOUNDS: Mapping[str, tuple[float, float]] = {
    "margin": (0.0, 0.25),
    "rate_margin": (0.0, 2.0),
    "rate_window": (0.02, 1.0),
    "stale": (0.05, 5.0),
    "lag": (0.0, 0.95),
    "disk": (1_000_000, 1e15),
}
#: The largest error of tracking that a rule may allow, by kind of quantity (SI), and the longest duration in s.
MOST_TRACKING: Mapping[str, float] = {"pressure": 20_000.0, "length": 2e-3, "force": 2.0}
LONGEST_TRACKING = 10.0


@dataclass(frozen=True)
class Tracking:
    """Largest deviation of a measured quantity from its set-point: ``error`` (SI) for longer than ``duration`` s."""

    error: float
    duration: float


@dataclass(frozen=True)
class Rules:
    """How strict the interlock is. Raises ValueError for a rule beyond its `BOUNDS`.

    A measured value trips outside its limits widened by ``margin`` times their span (the set-points themselves may
    lie on the limit, and a regulator overshoots a little); its rate of change over ``rate_window`` s trips above the
    limit widened by ``rate_margin``; its time away from rest above the dwell widened by ``margin``. ``stale`` is the
    longest time without a new sample of a link in s of wall time, ``lag`` the share by which the device's clock may be
    slower than the host's, ``disk`` the least free space in bytes. ``tracking`` bounds what is measured against what is
    commanded, ``agreement`` two gauges of one quantity against each other. ``plausible`` is whether values are asked to
    be plausible as well (`acquire.engine.plausibility`). All defaults are assumed.
    """

    margin: float = 0.1
    rate_margin: float = 0.5
    rate_window: float = 0.1
    stale: float = 0.5
    lag: float = 0.2
    disk: int = 200_000_000
    tracking: Mapping[str, Tracking] = field(
        default_factory=lambda: {
            "pressure": Tracking(10_000.0, 3.0),
            **{axis: Tracking(1e-3, 1.0) for axis in AXES},
        }
    )

    agreement: Mapping[str, Tracking] = field(default_factory=lambda: {"pressure": Tracking(2_000.0, 0.3)})
    plausible: bool = True

    def __post_init__(self) -> None:
        for name, (least, most) in BOUNDS.items():
            value = getattr(self, name)
            if not least <= value <= most:  # NaN is not
                raise ValueError(f"{name}: {value:g} is out of {least:g} … {most:g}")
        for quantity, rule in (*self.tracking.items(), *self.agreement.items()):
            check_tracking(quantity, rule)


def check_tracking(quantity: str, rule: Tracking) -> None:
    """Raises ValueError for a rule that allows too much, or nothing."""
    kind = units.kind_of(quantity)
    if not 0 < rule.error <= MOST_TRACKING[kind]:
        most = units.write(MOST_TRACKING[kind], kind)
        raise ValueError(f"tracking.{quantity}.error: must be above 0 and at most {most}")
    if not 0 < rule.duration <= LONGEST_TRACKING:
        raise ValueError(f"tracking.{quantity}.duration: must be above 0 and at most {LONGEST_TRACKING:g} s")


@dataclass(frozen=True)
class Trip:
    """Why a run was stopped by the interlock. ``time`` is device time in s where it is known, else NaN.

    ``code`` is one of ``value``, ``rate``, ``nan``, ``dwell``, ``tracking`` (a measured channel), ``frozen``, ``jump``,
    ``response``, ``reference`` (one that cannot be true), ``stale``, ``clock``, ``link``, ``device`` (a link or a
    device), ``host``, ``disk``, ``recorder``, ``supervisor``, ``interlock`` (this computer), ``estop`` (a person).
    """

    code: str
    message: str
    time: float = math.nan
