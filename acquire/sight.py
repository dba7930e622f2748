"""A camera's settings before a run: the threshold its contours are read at, and where the edge can be."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from acquire.engine import RunPlan

if TYPE_CHECKING:
    from drivers.aspiration.camera import Measure
    from drivers.device import Rig

LOOK = 3.0  # s of wall time within which a camera has delivered a frame, or the run goes on without it


def see(plan: RunPlan, rig: Rig, gvt: float | None) -> RunPlan:
    """The plan with the grey-value threshold that its contours are read at, live and in the recording alike.

    It belongs to the plan: it is settled before the run and stays to its end. Where no proposal is sure within `LOOK`,
    one is made from the recorded frames. Heights count from the tissue as it is now.
    """
    for measure in _measures(rig):
        measure.use(gvt)
        measure.rest()
        patience = time.monotonic() + LOOK
        while not measure.looked and time.monotonic() < patience:
            time.sleep(0.005)
        settings = measure.settings
        if settings.gvt is not None:
            how = ("measured", "proposed before the run") if measure.proposes else ("documented", "set")
            facts = {"value": settings.gvt, "unit": "1", "provenance": how[0], "note": how[1]}
            facts |= {"apex": settings.apex, "tissue": settings.tissue}
            plan = replace(plan, info=replace(plan.info, calibration={**plan.info.calibration, "gvt": facts}))
    return plan


def with_region(plan: RunPlan, rig: Rig) -> RunPlan:
    """The plan with the region of its frames in which the tissue's edge can be; whole frames where that is not known.

    The apex rises as far as the limits allow, and no further than half the opening: tissue sucked through a round hole
    is then a half ball. A frame in which it goes further all the same is kept whole.
    """
    highest = plan.limits["apex_height"].high
    opening = plan.info.calibration.get("opening")
    if opening is not None:
        highest = min(highest, float(opening["value"]) / 2)
    for measure in _measures(rig):
        if math.isfinite(highest):
            plan = replace(plan, region=measure.region(highest))
    return plan


def _measures(rig: Rig) -> Iterator[Measure]:
    from drivers.aspiration.camera import Camera

    for source in rig.sources:
        if isinstance(source, Camera) and source.measure is not None:
            yield source.measure
