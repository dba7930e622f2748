"""Sound skin softens by loading at its own pace, and to an end of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap.design import simulated as own
from gap.inference.least_squares import fit
from gap.null.groups import GroupedSession
from gap.null.robot_axes import QUANTITIES, AxesBlock
from gap.null.robot_force import ForceBlock
from sim_devices.stages.tissues import sheet_tissue


@pytest.mark.parametrize(("rise", "fall", "end"), [(6.0, 600.0, 0.0), (7.0, 500.0, 1.0), (12.0, 300.0, 0.5)])
def test_it_is_found(rise: float, fall: float, end: float) -> None:
    """A sound session of an outside author, whose skin softened to no more than 1, was 6 of chi2 a row off and told a
    muscle tone change."""
    skin = replace(
        sheet_tissue("forearm"), relaxation=(0.2, 0.15), times=(0.8, 6.0),
        softening=0.08, softening_rise=rise, softening_fall=fall, softening_end=end,
    )  # fmt: skip
    legs = [own.direction_cycles(0.0, 0.0, a, 8.0, 2) for a in (0.6e-3, 1.6e-3, 1.2e-3)]
    recordings = own.robot_session(np.random.default_rng(5), [], tissue=skin, legs=legs)
    session = GroupedSession(recordings, QUANTITIES)
    block = ForceBlock(session, {}, AxesBlock(session, {}))
    found = fit(block, nuisance=block.start())
    tissue = block.tissue(found.nuisance)
    assert found.chi2 < 1.1 * len(found.residual)
    assert len(block.prior_scales) == 1  # a simple law, without a discrepancy
    assert tissue.softening == pytest.approx(0.08, abs=0.03)
    assert tissue.softening_end == pytest.approx(end, abs=0.3)
