"""The sheet's laws: what each lets relax, and from where."""

from __future__ import annotations

import numpy as np

from gap.sheet_law import FROZEN, LAWS, RELAXATION_TIMES, TISSUE, sheet
from sim_devices.stages.tissues import sheet_tissue


def test_each_law_has_its_own_relaxation_and_no_other() -> None:
    base = sheet_tissue("forearm")
    modes, power, usual = (sheet(np.array(law.guesses[0]), base, 1e-3) for law in LAWS)
    assert len(modes.times) == 2
    assert usual.times == RELAXATION_TIMES
    # A power law of time loses about as much in every decade, and no more than all.
    assert 0 < sum(power.relaxation) < 1
    assert max(power.times) / min(power.times) > 1e5


def test_what_a_law_lacks_is_frozen_at_nothing() -> None:
    for law in LAWS:
        frozen = np.array(law.sd) <= FROZEN
        assert not np.array(law.guesses)[:, frozen].any()
        assert not frozen[: TISSUE.index("softening") + 1].any()
    amounts = {name for name in TISSUE if name.startswith(("relaxation", "amount", "power"))}
    free = [{n for n, sd in zip(TISSUE, law.sd, strict=True) if sd > FROZEN} & amounts for law in LAWS]
    assert set.union(*free) == amounts
    assert sum(map(len, free)) == len(amounts)
