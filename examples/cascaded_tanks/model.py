"""Two tanks in cascade: a pump fills the upper one, which empties into the lower one, whose level is measured.

    python examples/cascaded_tanks/make_bundle.py -o out/tanks
    acquire gap diagnose out/tanks/estimation --model examples/cascaded_tanks/model.py:Tanks -o out/tanks/gap

Torricelli's law for both outlets; nothing overflows and the level sensor has no end.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from sim_devices.chain import Parameter

SUBSTEPS = 4


@njit
def _levels(pump, dt, outlet_1, inflow_2, outlet_2, gain, upper, lower):
    out = np.empty(pump.size)
    for i in range(pump.size):
        out[i] = lower
        for _ in range(SUBSTEPS):
            flow_1, flow_2 = outlet_1 * np.sqrt(max(upper, 0.0)), outlet_2 * np.sqrt(max(lower, 0.0))
            upper = max(upper + dt / SUBSTEPS * (gain * pump[i] - flow_1), 0.0)
            lower = max(lower + dt / SUBSTEPS * (inflow_2 * flow_1 - flow_2), 0.0)
    return out


class Tanks:
    """The cascaded tanks of the benchmark; levels in volts of the sensor."""

    name = "cascaded tanks"
    channels = ("level",)
    stages = {"pump": "actuator", "level": "sensor"}
    units = {"pump": "V", "level": "V"}
    parameters = (
        Parameter("outlet_1", "V^0.5/s", 5e-3, 0.5, None, 0.05, "log", "outlet of the upper tank"),
        Parameter("inflow_2", "1", 0.1, 10, None, 1.0, "log", "upper outlet to lower tank"),
        Parameter("outlet_2", "V^0.5/s", 5e-3, 0.5, None, 0.05, "log", "outlet of the lower tank"),
        Parameter("pump_gain", "1/s", 5e-3, 0.5, None, 0.05, "log", "level rate per pump volt"),
        Parameter("upper", "V", 0, 12, None, 5.0, "linear", "level of the upper tank at the start"),
        Parameter("lower", "V", 0, 12, None, 5.0, "linear", "level of the lower tank at the start"),
    )

    def simulate(self, time, data, parameters, tap):
        pump = np.ascontiguousarray(tap("pump", data["pump"]))
        level = _levels(pump, time[1] - time[0], *(parameters[p.name] for p in self.parameters))
        return {"level": tap("level", level)}
