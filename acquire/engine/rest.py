"""Making an instrument safe on a person's demand, and seeing that it is: by its state and by its own readings."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field

from acquire.engine.engine import RunEngine
from drivers.device import Status
from drivers.signals import Block

#: Largest reading of a commanded quantity that counts as at rest, by its unit: as in docs/safety.md.
AT_REST = {"Pa": 300.0, "m": 1e-4}
PATIENCE = 5.0  # s of wall time within which the readings must show it


@dataclass(frozen=True)
class Rest:
    """How an instrument was found, its status now, and its last readings of commanded quantities (SI, by channel)."""

    found: str
    status: Status
    readings: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def reached(self) -> bool:
        """Whether it is safe by its own word and at rest by its own readings."""
        at_rest = all(abs(value) <= AT_REST[self.units[name]] for name, value in self.readings.items())
        return self.status.state == "safe" and bool(self.readings) and at_rest

    @property
    def words(self) -> str:
        """For a person."""
        readings = ", ".join(f"{name} {value:.4g} {self.units[name]}" for name, value in self.readings.items())
        return f"{self.status.words}; {readings or 'no reading came'}"


def bring_to_rest(engine: RunEngine) -> Rest:
    """Make the connected instrument of ``engine`` safe and read its state back.

    Raises WrongState while a run is on, DeviceError when it does not confirm.
    """
    engine.make_safe()
    units = {c.name: c.unit for c in engine.rig.device.channels if c.name in engine.rig.device.quantities}
    readings: dict[str, float] = {}
    deadline = time.monotonic() + PATIENCE
    while True:
        for item in engine.display.take():
            if isinstance(item, Block):
                readings |= {n: float(v[-1]) for n, v in item.values.items() if n in units and math.isfinite(v[-1])}
        assert engine.status is not None
        rest = Rest(engine.found, engine.status, readings, units)
        if rest.reached or time.monotonic() > deadline:
            return rest
        time.sleep(0.02)
