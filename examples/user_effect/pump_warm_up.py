"""An effect of one's own: a vacuum pump that is weak while it is cold, so that the first suctions fall short.

    python examples/user_effect/make_session.py -o out/warm_up
    acquire gap diagnose out/warm_up --effects examples/user_effect/pump_warm_up.py -o out/warm_up/gap

Every ``Effect`` at the top level of the file counts; the diagnosis weighs it against the library's own.
"""

from __future__ import annotations

import numpy as np

from sim_devices.effects.build import SUCTION, effect, map_after, shape, strength


def cold(time, pressure, shortfall, warming):
    """Pressure (n,) Pa at ``time`` (n,) s on the session's clock: short by a share that dies out."""
    return pressure * (1.0 - shortfall * np.exp(-time / warming))


PUMP_WARM_UP = effect(
    "pump_warm_up",
    "actuator",
    SUCTION,
    meaning="A cold pump falls short of its set-point, the less the longer it runs.",
    remedy="Let the pump run for some minutes before the first recording.",
    source="assumed: an example, no measurement behind it",
    parameters=(
        strength("shortfall", "1", 1e-3, 0.3, 0.05, "share of the suction that lacks at the start"),
        shape("warming", "s", 10.0, 300.0, 60.0, "time constant", log=True),
    ),
    # The operator "regulator" makes the true pressure; this one acts on its output.
    install=lambda chain, v: map_after(
        chain, "regulator", "pump_warm_up", "actuator", cold, (v["shortfall"], v["warming"])
    ),
)
