"""The controllers that the robot's axes may soundly have: gains, and the signal the derivative acts on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from acquire.recording.model import AXIS_LOOP, Recording
from sim_devices.chain import Chain, FloatArray
from sim_devices.stages.axes import LOOP_RATE, MASS, AxisLoop
from sim_devices.stages.axis_steps import LONGEST

COARSER = 2.0
"""Substeps of a loop with friction or limits against those of the simulated instrument: half as many to compute."""

NEVER = 1e6
"""Integral time (s) of a loop that has no integral, which nothing shows within hours."""
HEAVIEST = 1.5
"""Weight of a set-point, at most."""


@dataclass(frozen=True)
class TunedLoop(AxisLoop):
    """An axis loop with gains of its own: proportional N/m, integral N/(m s), derivative of the position N s/m."""

    gains: tuple[float, float, float] = (3 * MASS * LOOP_RATE**2, MASS * LOOP_RATE**3, 3 * MASS * LOOP_RATE)

    def controller(self) -> tuple[float, float, float]:
        return self.gains

    def fresh(self) -> Any:
        rows, parameters = super().fresh()
        if self.stiction or not self.coulomb:  # dry friction alone takes long steps but where the axis turns
            parameters[LONGEST] *= COARSER
        return rows, parameters


@dataclass(frozen=True)
class Controller:
    """A PID loop: gains in N/m, N/(m s), N s/m, ``drag`` N s/m of the axis.

    ``on_error`` tells whether the derivative is the error's, or that of the position alone; ``centred`` whether a force
    on the tip loads the axes by the lever arms of the centre, or by those where it is.
    """

    proportional: float
    integral: float
    derivative: float
    drag: float
    on_error: bool
    centred: bool
    mass: float = MASS  # kg, that an axis moves

    def installed(
        self,
        chain: Chain,
        scale: FloatArray,
        drag: float = 0.0,
        lag: float = 0.0,
        weights: tuple[float, ...] = (0.0, 0.0, 0.0),
        kick: float = 0.0,
    ) -> Chain:
        """The chain with this controller, its three gains multiplied by ``scale`` (3,), further ``drag`` N s/m, and a
        coil's force that comes ``lag`` s later than it is asked for.

        ``weights`` tell by how much more the set-point and its rate weigh than in this controller, and the share of the
        mass that is fed forward; ``kick`` s how long a coil is at its limit where the set-point jumps.
        """
        p, i, d = (self.proportional * scale[0], self.integral * scale[1], self.derivative * scale[2])
        loop = chain["axes"]
        assert isinstance(loop, AxisLoop)
        kept = {f.name: getattr(loop, f.name) for f in fields(AxisLoop)}
        weight, rate, share = np.clip(np.add((1.0, self.on_error, 0.0), weights), 0.0, HEAVIEST).tolist()
        own = {
            "mass": self.mass,
            "lag": lag,
            "fed": rate * d,
            "weight": weight,
            "thrust": share * self.mass,
            "kick": kick,
        }
        tuned = TunedLoop(**kept | own, gains=(p, i, d + self.drag + drag))
        return Chain(chain.instrument, tuple(tuned if op is loop else op for op in chain.operators))


CONTROLLERS = (
    Controller(3 * MASS * LOOP_RATE**2, MASS * LOOP_RATE**3, 3 * MASS * LOOP_RATE, 0.0, on_error=False, centred=False),
    Controller(1500.0, 12000.0, 15.0, 1.0, on_error=True, centred=True),
    Controller(1500.0, 12000.0, 15.0, 1.0, on_error=False, centred=True),
)
"""Ours (a triple pole), and the one of the blind check's nominal instrument. All figures assumed."""


def stated(recordings: Sequence[Recording]) -> dict[str, Mapping[str, Any]]:
    """The controller among the calibrations of some recordings; empty where none states one.

    Raises ValueError where two state different ones.
    """
    said = {r.info.id: {n: known for n, known in r.info.calibration.items() if n in AXIS_LOOP} for r in recordings}
    said = {name: own for name, own in said.items() if own}
    first = next(iter(said), "")
    if other := next((name for name, own in said.items() if own != said[first]), ""):
        raise ValueError(f"recordings {first} and {other} of one session state different controllers")
    return dict(said.get(first, {}))


def controllers(calibration: Mapping[str, Mapping[str, Any]]) -> tuple[Controller, ...]:
    """The controllers that a recording with this ``calibration`` may have: the one it states, whose derivative may be
    of the error or of the position, or the known ones.

    A PD loop states an integral of 0. Raises ValueError for part of a controller, another unit, or a number that is
    none.
    """
    given = [name for name in AXIS_LOOP if name in calibration]
    if not given:
        return CONTROLLERS
    if missing := [name for name in AXIS_LOOP if name not in given]:
        raise ValueError(f"calibration: a controller needs {', '.join(missing)} besides {', '.join(given)}")
    values = []
    for name, unit in AXIS_LOOP.items():
        value, its = calibration[name].get("value"), calibration[name].get("unit")
        if its != unit or isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < np.inf:
            raise ValueError(f"calibration: {name} is {value!r} {its!r}, not a positive number of {unit}")
        if value == 0 and name != "loop_integral":
            raise ValueError(f"calibration: {name} is 0, not a positive number of {unit}")
        values.append(float(value))
    p, i, d, mass = values
    i = max(i, p / NEVER)
    return tuple(Controller(p, i, d, 0.0, on_error, centred=False, mass=mass) for on_error in (False, True))
