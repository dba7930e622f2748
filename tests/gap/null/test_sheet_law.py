"""The laws of the sheet: their free parameters, and where fits of them begin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from gap.null.chains import needed, run
from gap.null.sheet_law import (
    AMOUNTS,
    ARMS,
    CURVES,
    EVEN,
    FROZEN,
    LAWS,
    MEMORIES,
    PLAIN,
    RELAXATION_TIMES,
    SPECTRUM,
    TISSUE,
    joined,
    rewired,
    sheet,
)
from sim_devices.stages import nominal
from sim_devices.stages.robot import xyz
from sim_devices.stages.tissues import SheetTissue, sheet_tissue


def test_each_law_has_its_own_relaxation_and_no_other() -> None:
    base = sheet_tissue("forearm")
    modes, power, usual = (sheet(np.array(law.guesses[0]), base, 1e-3) for law in LAWS)
    assert len(modes.times) == 2
    assert usual.times == RELAXATION_TIMES
    # A power law of time loses about as much in every decade, and no more than all.
    assert 0 < sum(power.relaxation) < 1
    assert max(power.times) / min(power.times) > 1e5


def test_what_a_law_lacks_is_frozen_at_nothing() -> None:
    for law in (*LAWS, *MEMORIES, PLAIN, *CURVES):
        frozen = np.array(law.sd) <= FROZEN
        assert not np.array(law.guesses)[:, frozen].any()
        assert not frozen[: TISSUE.index("softening") + 1].any()
    amounts = {name for name in TISSUE if name.startswith(("relaxation", "amount", "power"))}
    free = [{n for n, sd in zip(TISSUE, law.sd, strict=True) if sd > FROZEN} & amounts for law in LAWS]
    assert set.union(*free) == amounts
    assert sum(map(len, free)) == len(amounts)


def test_each_further_law_has_two_times_and_one_thing_more_or_arms() -> None:
    for law in (*MEMORIES, *CURVES):
        free = {n for n, sd in zip(TISSUE, law.sd, strict=True) if sd > FROZEN} & AMOUNTS.keys()
        if free == ARMS.keys() or len(free) < 2:  # one elastic curve at most, with any memory
            continue
        more = {n.rstrip("0123456789") for n in free} - {"amount"}
        assert {"amount1", "amount2"} < free
        assert len(more) == 1 or more == {"push", "pull", "toe"}, "a bed, and skin that is soft at first"


def test_a_long_elastic_curve_is_fungs_exponential_of_the_energy() -> None:
    base, typical, stiffening = sheet_tissue("forearm"), 1e-3, 0.6
    nominal_part = base.exponent * np.log1p((typical / base.length) ** 2)
    x = dict.fromkeys(TISSUE, 0.0) | {"length": 3.0, "stiffening": stiffening - nominal_part}
    law = sheet(np.array(list(x.values())), base, typical)
    distance = np.linspace(0.0, 1.3e-3, 40)
    factor = (1 + (distance / law.length) ** 2) ** law.exponent
    assert np.allclose(factor, np.exp(stiffening * (distance / typical) ** 2), rtol=5e-3)


def test_a_sheet_that_is_tilted_is_a_level_one_seen_from_aside() -> None:
    level = sheet_tissue("forearm")
    tilted = replace(level, tilt=(0.2, -0.1))
    about_x, about_y = (Rotation.from_rotvec(v).as_matrix() for v in ([0.2, 0, 0], [0, -0.1, 0]))
    turn = about_y @ about_x
    time = np.linspace(0.0, 8.0, 401)
    path = 1e-3 * np.stack([np.sin(1.3 * time), np.cos(0.7 * time) - 1, -0.4 * np.sin(2.0 * time)])

    def forces(tissue: SheetTissue, moved: np.ndarray) -> np.ndarray:
        given = dict(zip(xyz("skin"), moved, strict=True))
        made = run(needed(nominal("microrobot", tissue=tissue), xyz("reaction"), given), time, given)
        return np.stack([made[s] for s in xyz("reaction")])

    assert np.allclose(forces(tilted, path), turn @ forces(level, turn.T @ path), atol=1e-12)


def _forces(law_at: np.ndarray) -> np.ndarray:
    time = np.linspace(0.0, 8.0, 801)
    path = 1e-3 * np.sin(1.3 * time)
    given = {"skin_x": path, "skin_y": 0.5 * path, "skin_z": -0.3 * path}
    base = sheet(law_at, sheet_tissue("forearm"), 1e-3)
    chain = rewired(nominal("microrobot", tissue=base), law_at, 1e-3, 1.0)
    return np.stack([run(needed(chain, xyz("reaction"), given), time, given)[s] for s in xyz("reaction")])


def test_further_laws_change_the_force_and_are_plain_memories_without_what_they_add() -> None:
    memories = "amount1", "amount2", *SPECTRUM
    for law in (*MEMORIES, *CURVES):
        guess = dict(zip(TISSUE, law.guesses[0], strict=True))
        two_times = dict(zip(TISSUE, LAWS[0].guesses[0], strict=True))
        plain = _forces(np.array(list((two_times | {n: guess[n] for n in memories}).values())))
        added = [n for n in AMOUNTS if guess[n] and not n.startswith("amount")] or ["skew1", "skew4"]
        at = np.array(list((guess | {n: guess[n] or 0.2 for n in added}).values()))
        assert np.max(np.abs(_forces(at) - plain)) > 5e-3
        at[[TISSUE.index(n) for n in added]] = 0.0
        assert np.allclose(_forces(at), plain, atol=1e-9)


def test_one_laws_memory_joins_anothers_curve() -> None:
    """Arms add the same to a sheet of chains as to a plain one."""
    none = np.zeros(len(TISSUE))
    none[TISSUE.index("softening")] = -sheet_tissue("forearm").softening
    arms, chains = MEMORIES[1], CURVES[3]
    law = joined(arms, chains, none + arms.guesses[0], none + chains.guesses[0])
    both = np.array(law.guesses[0])
    assert both[TISSUE.index("chains")] == chains.guesses[0][TISSUE.index("chains")] > 0
    assert law.sd[TISSUE.index("arm1")] > FROZEN >= law.sd[TISSUE.index(SPECTRUM[0])]
    curve = both * np.isin(TISSUE, ("chains", "softening"))
    added = _forces(both) - _forces(curve)
    assert np.max(np.abs(added)) > 5e-3
    assert np.allclose(added, _forces(both * (np.array(TISSUE) != "chains")) - _forces(none), atol=1e-12)


def test_springs_of_arms_may_be_as_stiff_in_each_direction() -> None:
    at = np.array(MEMORIES[1].guesses[0])
    at[TISSUE.index("softening")] = -sheet_tissue("forearm").softening
    bare = _forces(np.where(np.isin(TISSUE, tuple(ARMS)), 0.0, at))
    path = np.array([1.0, 0.5, -0.3])
    spread = {}
    for even in (0.0, 1.0):
        added = _forces(np.where(np.array(TISSUE) == EVEN, even, at)) - bare
        spread[even] = np.ptp(np.max(np.abs(added), axis=1) / np.abs(path))
    assert spread[1.0] < 1e-9 < 1e-3 < spread[0.0]
