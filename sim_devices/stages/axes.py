"""The robot's three driven axes: voice coil, moving mass and the PID loop that closes over them.

m x'' = F - (c + drag) x' - friction + load, F = Kp (b r - x) + Ki ∫e - Kd x' + Kf r' + Ka r'' with e = r - x, r the
target. `axis_steps` integrates it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim_devices.chain import FloatArray, Signals
from sim_devices.stages.axis_steps import LONGEST, RUBBING, STATE, SUBSTEP, UNSEEN, advance_axis
from sim_devices.stages.operators import Wired

MASS = 0.060
"""Moving mass of an axis, kg (assumed)."""
LOOP_RATE = 100.0
"""Triple pole of the nominal closed loop, 1/s (assumed): Kp = 3 m p², Ki = m p³, Kd = 3 m p."""
FORCE_LIMIT = 10.0
"""Greatest force of a coil, N (assumed)."""


@dataclass(frozen=True)
class AxisLoop(Wired):
    """Closed loop of each axis. Sources are the targets (m), then the loads on the axes (N; absent means none).

    ``rate`` (1/s) sets the gains. The rest are imperfections, zero when there are none: ``drag`` N s/m; ``coulomb`` N,
    ``stiction`` N above it near standstill with Stribeck speed ``stribeck_speed`` m/s, ``presliding`` m (0: none), or
    dry friction in proportion to tanh(x'/``easing``), m/s (0: none);
    ``force_limit`` N, met abruptly, or approached as by tanh if ``soft`` is 1; ``carried`` N of a coil's force hold a
    weight, so that the limit is nearer one way; ``windup`` 0 (integrator frozen while the force is limited, or that of
    a soft limit changed by the force withheld over Kp, back-calculation) to 1 (runs on); relative change of the force
    constant ``slope`` 1/m and ``curvature`` 1/m². Grease that shear thins brakes with ``thinning`` N at 1 mm/s and with
    ``thinning_power`` of the speed, air that swirls with a power of 2.
    Friction and drag act on the axis ``alone`` (1 to 3), or on all (0).
    ``fed`` N s/m (Kf) is the controller's force in proportion to the target's speed, ``weight`` (b) the share of the
    target that its proportional part sees (Åström and Hägglund, set-point weighting), ``thrust`` kg (Ka) its force
    for the target's acceleration: a kick where the target turns. ``kick`` s is how long a coil pushes at its limit
    where the target jumps, as its card sees a rate for some cycles: at a jump of d the axis gains at most Kf d / m.
    ``lag`` s is how late the coil's force is: a card's cycle, its filters, the coil's current. It is short against the
    loop's time constant, and taken to first order: F(t - lag) = F - lag F' takes lag Ki off Kp, lag Kp off Kd,
    lag b Kp off Kf, lag Kf off Ka, and lag Kd off the mass.
    ``spring`` N/m holds each axis towards zero: the stiffness that loops through a tissue assume of it
    (``robot.closed_loop``), so that only the difference is iterated. A step has ``most_substeps``, however long it is:
    where nodes are dense after kinks and wide elsewhere, few are enough.
    """

    rate: float = LOOP_RATE
    mass: float = MASS
    drag: float = 0.0
    coulomb: float = 0.0
    stiction: float = 0.0
    stribeck_speed: float = 1e-3
    presliding: float = 0.0
    force_limit: float = FORCE_LIMIT
    soft: float = 0.0
    windup: float = 0.0
    slope: float = 0.0
    curvature: float = 0.0
    spring: float = 0.0
    carried: float = 0.0
    alone: int = 0
    fed: float = 0.0
    weight: float = 1.0
    thrust: float = 0.0
    kick: float = 0.0
    lag: float = 0.0
    thinning: float = 0.0
    thinning_power: float = 0.5
    easing: float = 0.0
    most_substeps: float = math.inf

    def controller(self) -> tuple[float, float, float]:
        """Proportional, integral and derivative gain, N/m, N/(m s), N s/m."""
        return 3 * self.mass * self.rate**2, self.mass * self.rate**3, 3 * self.mass * self.rate

    @property
    def stable(self) -> bool:
        """Whether the linear loop comes to rest (Routh, 1877): no machine is built about one that does not."""
        mass, kp, ki, kd = self._with_lag()
        damping, stiffness = kd + self.drag, kp + self.spring
        return mass > 0.0 and damping > 0.0 and ki > 0.0 and stiffness * damping > ki * mass

    def _with_lag(self) -> tuple[float, float, float, float]:
        """Mass (kg) and gains (N/m, N/(m s), N s/m) of a loop whose force is in time, to first order as this one."""
        kp, ki, kd = self.controller()
        return self.mass - self.lag * kd, kp - self.lag * ki, ki, kd - self.lag * kp

    def fresh(self) -> Any:
        (mass, *gains), kp, late = self._with_lag(), self.controller()[0], self.lag
        linear = not (self.coulomb or self.stiction or self.slope or self.curvature or self.soft or self.thinning)
        values = (
            mass, *gains, self.drag, self.coulomb, self.stiction, self.stribeck_speed, self.presliding,
            self.force_limit, self.windup, self.slope, self.curvature, self.spring,
            math.inf if linear else SUBSTEP, self.soft, self.carried, self.fed,
            self.thinning, self.thinning_power, self.easing, self.most_substeps, self.fed - late * self.weight * kp,
            (1.0 - self.weight) * kp, (self.thrust - late * self.fed) / mass,
            self.kick,
        )  # fmt: skip
        return np.zeros((len(self.target), STATE)), np.array(values)

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        rows, parameters = state
        smooth = parameters.copy()
        smooth[RUBBING] = 0.0
        if not (self.slope or self.curvature or self.soft):
            smooth[LONGEST] = math.inf
        n = len(self.target)
        wires = zip(rows, self.source[:n], self.source[n:], self.target, strict=True)
        for axis, (row, source, load, target) in enumerate(wires, start=1):
            out = np.empty(len(time))
            push = signals[load] if load in signals else np.zeros(len(time))
            if self.weight != 1.0:  # the part of the target that the controller does not see is as a load
                push = push - parameters[UNSEEN] * signals[source]
            own = parameters if self.alone in (0, axis) else smooth
            advance_axis(row, time, signals[source], push, own, out)
            signals[target] = out
