"""Tolerances are data: what fits let a sound instrument be off by is in one file, with where it is known from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap.data.tolerances import tolerances
from gap.design import simulated as own
from gap.inference.least_squares import fit
from gap.null.groups import GroupedSession
from gap.null.suction_pressure import PressureBlock
from gap.null.suction_regulator import GAIN


@pytest.mark.parametrize("instrument", ["cutometer", "aspiration", "microrobot"])
def test_every_tolerance_says_where_it_is_from(instrument: str) -> None:
    for group in tolerances(instrument).values():
        for tolerance in group.values():
            assert tolerance.value > 0
            assert tolerance.widest >= tolerance.value
            assert tolerance.source.startswith("assumed")
    assert tolerances("servo") == {}


def test_a_gauge_off_by_what_a_laboratory_allows_is_no_strain() -> None:
    """Half a per cent and a millibar were five tolerances of a data sheet: a claimed gauge_offset with .92."""
    recordings = own.suction_session("cutometer", np.random.default_rng(3), [])
    shifted = []
    for r in recordings:
        p = r.streams["pressure"]
        moved = replace(p, value=1.005 * p.value - 100.0)
        shifted.append(replace(r, streams={**r.streams, "pressure": moved}))
    fitted = fit(PressureBlock(GroupedSession(shifted, ("pressure",)), {}))
    assert fitted.penalty < 12
    assert fitted.chi2 < 1.2 * len(fitted.residual)


def test_no_gain_of_the_gauge_makes_its_noise_less() -> None:
    """A gain of the recorded pressure shrank its noise, too: 5 % of it, beside a gauge wrong the other way, took 200 of
    the chi2 of a sound session and was claimed."""
    recordings = own.suction_session("cutometer", np.random.default_rng(3), [])
    block = PressureBlock(GroupedSession(recordings, ("pressure",)), {})
    jacobian = block.evaluate(block.prior_mean, {}).jacobian
    gain = jacobian[:, GAIN] * block.sigma
    held = (block.measured < -0.5 * np.ptp(block.measured)) & (block.counts == 1)
    assert np.std((gain - block.measured)[held]) > 0.5 * block.noise[0]  # the noise of single samples is not in it
    assert np.mean(gain[held]) == pytest.approx(np.mean(block.measured[held]), rel=0.01)
