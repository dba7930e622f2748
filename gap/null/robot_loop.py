"""The controllers that the robot's axes may soundly have: gains, and the signal the derivative acts on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from acquire.recording.model import Recording
from sim_devices.chain import Chain, FloatArray, Signals
from sim_devices.stages.axes import LOOP_RATE, MASS, AxisLoop
from sim_devices.stages.operators import Wired
from sim_devices.stages.robot import numbered

COARSER = 2.0
"""Substeps of a loop with friction or limits against those of the simulated instrument: half as many to compute."""


@dataclass(frozen=True)
class TunedLoop(AxisLoop):
    """An axis loop with gains of its own: proportional N/m, integral N/(m s), derivative of the position N s/m."""

    gains: tuple[float, float, float] = (3 * MASS * LOOP_RATE**2, MASS * LOOP_RATE**3, 3 * MASS * LOOP_RATE)

    def fresh(self) -> Any:
        rows, parameters = super().fresh()
        parameters[1:4] = self.gains
        if self.stiction or not self.coulomb:  # dry friction alone takes long steps but where the axis turns
            parameters[14] *= COARSER
        return rows, parameters


PUSHED = numbered("pushed")
"""Load of the recorded force on each axis, N, but for the controller's own share."""


@dataclass(frozen=True)
class Feed(Wired):
    """Load of each axis (target) from its set-point and the push on it (sources: set-points, then pushes): ``gain``
    (N s/m) times the set-point's speed, plus the push, if there is one."""

    gain: float = 0.0

    def advance(self, state: Any, time: FloatArray, signals: Signals) -> None:
        n = len(self.target)
        for source, push, load in zip(self.source[:n], self.source[n:], self.target, strict=True):
            speed = np.diff(signals[source], prepend=signals[source][0]) / np.diff(time, prepend=time[0] - 1.0)
            signals[load] = self.gain * speed + signals.get(push, 0.0)


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

    def installed(self, chain: Chain, scale: FloatArray, drag: float = 0.0) -> Chain:
        """The chain with this controller, its three gains multiplied by ``scale`` (3,), and further ``drag`` N s/m."""
        p, i, d = (self.proportional * scale[0], self.integral * scale[1], self.derivative * scale[2])
        loop = chain["axes"]
        assert isinstance(loop, AxisLoop)
        kept = {f.name: getattr(loop, f.name) for f in fields(AxisLoop)}
        fed = d if self.on_error else 0.0
        tuned = TunedLoop(**kept | {"fed": fed, "mass": self.mass}, gains=(p, i, d + self.drag + drag))
        operators = tuple(tuned if op is loop else op for op in chain.operators)
        chain = Chain(chain.instrument, operators)
        feed = Feed("load_and_feed", "actuator", numbered("target") + PUSHED, numbered("load"), gain=fed)
        return chain.inserted(feed, before="axes")


CONTROLLERS = (
    Controller(3 * MASS * LOOP_RATE**2, MASS * LOOP_RATE**3, 3 * MASS * LOOP_RATE, 0.0, on_error=False, centred=False),
    Controller(1500.0, 12000.0, 15.0, 1.0, on_error=True, centred=True),
    Controller(1500.0, 12000.0, 15.0, 1.0, on_error=False, centred=True),
)
"""Ours (a triple pole), and the one of the blind check's nominal instrument. All figures assumed."""
STATED = {"loop_proportional": "N/m", "loop_integral": "N/(m s)", "loop_derivative": "N s/m", "axis_mass": "kg"}
"""Calibrations by which a recording states its controller, and their units."""


def stated(recordings: Sequence[Recording]) -> dict[str, Mapping[str, Any]]:
    """The controller among the calibrations of some recordings; empty where none states one.

    Raises ValueError where two state different ones.
    """
    said = {r.info.id: {n: known for n, known in r.info.calibration.items() if n in STATED} for r in recordings}
    said = {name: own for name, own in said.items() if own}
    first = next(iter(said), "")
    if other := next((name for name, own in said.items() if own != said[first]), ""):
        raise ValueError(f"recordings {first} and {other} of one session state different controllers")
    return dict(said.get(first, {}))


def controllers(calibration: Mapping[str, Mapping[str, Any]]) -> tuple[Controller, ...]:
    """The controllers that a recording with this ``calibration`` may have: the one it states, whose derivative may be
    of the error or of the position, or the known ones.

    Raises ValueError for part of a controller, another unit, or a number that is none.
    """
    given = [name for name in STATED if name in calibration]
    if not given:
        return CONTROLLERS
    if missing := [name for name in STATED if name not in given]:
        raise ValueError(f"calibration: a controller needs {', '.join(missing)} besides {', '.join(given)}")
    values = []
    for name, unit in STATED.items():
        value, its = calibration[name].get("value"), calibration[name].get("unit")
        if its != unit or isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < np.inf:
            raise ValueError(f"calibration: {name} is {value!r} {its!r}, not a positive number of {unit}")
        values.append(float(value))
    p, i, d, mass = values
    return tuple(Controller(p, i, d, 0.0, on_error, centred=False, mass=mass) for on_error in (False, True))
