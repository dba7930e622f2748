"""The self-check: what is visible, found and confused in a session like the one at hand; and how a report cites it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from acquire.cli.gap_selfcheck import cited
from gap.design import simulated as own
from gap.design.catalogue import usual
from gap.design.selfcheck import VISIBLE, Checked, as_text, selfcheck
from gap.effects import library

LEGS = [own.step_hold(-30e3, 5.0, 3.0), own.triangle(-30e3, 5.0, 1, 3.0)]
SOME = ("leak", "sensor_gain", "scale_error", "sensor_low_pass", "latency")
EFFECTS = {k: e for k, e in library("cutometer").items() if e.name in SOME}


def checked(legs):
    session = own.suction_session("cutometer", np.random.default_rng(2), legs=legs)
    return {c.effect: c for c in selfcheck(session, EFFECTS)}


def test_a_leak_shows_early_and_a_lag_of_the_sensor_hides_in_skin_unless_there_is_a_membrane() -> None:
    on_skin = checked(LEGS)
    assert on_skin["leak"].strength < 0.01
    assert on_skin["leak"].recovered > 0.8
    known = usual("reference membrane", "cutometer")
    quick = own.triangle(-30e3, 2.0, 3, 3.0)
    membrane = own.Leg(quick.quantity_tables, quick.duration, "reference membrane", known=known)
    with_it = checked([*LEGS, membrane])
    assert with_it["sensor_low_pass"].strength is not None
    assert with_it["sensor_low_pass"].strength < 0.1
    assert on_skin["sensor_low_pass"].strength is None or (
        on_skin["sensor_low_pass"].strength > 2 * with_it["sensor_low_pass"].strength
    )
    assert all(c.strength is None or (c.delta >= VISIBLE and c.at == c.strength) for c in on_skin.values())
    assert "leak" in as_text(list(on_skin.values()))


def test_a_limit_is_strongest_where_it_is_lowest() -> None:
    rest = {"pressure": (np.array([0.0, 12.0]), np.zeros(2))}
    step = own.Leg(rest, 12.0, "gauge step", known=usual("gauge step", "cutometer"))
    session = own.suction_session("cutometer", np.random.default_rng(2), legs=[*LEGS, step])
    (saturation,) = selfcheck(session, {"limit": library("cutometer")["sensor_saturation[form=0]"]})
    assert 0.2e-3 < saturation.strength < 0.3e-3  # the step is 0.3 mm high


def test_the_table_has_units_as_people_write_them_and_tells_of_which_strength_it_speaks() -> None:
    rows = [
        Checked("dead_band", "actuator", "band", "Pa", 389.0, 7.1, 0.9, {}, 389.0),
        Checked("rim_leak", "interface", "share", "1", None, 5.8, 0.7, {"none": 0.3}, 0.75),
        Checked("sensor_gain", "sensor", "error", "1", 0.02, 7.5, 0.9, {}, 0.02),
    ]
    text = as_text(rows)
    assert "3.89 mbar" in text
    assert "2 %" in text
    assert " 1 " not in text
    assert "not surely    0.70" in text
    assert f"not surely: at its greatest, of which 'found' then tells, it is below {VISIBLE:g} σ" in text
    assert "not surely" not in as_text(rows[::2])
    said = rows[1].as_dict()
    assert (said["minimum_visible"], said["recovery"], said["recovered_at"]) == (None, 0.7, 0.75)


def test_effects_of_one_trace_are_taken_for_each_other() -> None:
    found = checked(LEGS)
    both = (
        found["scale_error"].taken_for.get("sensor_gain", 0.0),
        found["sensor_gain"].taken_for.get("scale_error", 0.0),
    )
    assert max(both) > 0.3 or found["scale_error"].strength is None


def test_what_cannot_be_simulated_is_told() -> None:
    session = own.suction_session("cutometer", np.random.default_rng(2), legs=LEGS)
    with pytest.raises(ValueError, match="is none of our instruments"):
        selfcheck([replace(r, info=replace(r.info, instrument="other")) for r in session], EFFECTS)
    with pytest.raises(ValueError, match="has no set-points"):
        selfcheck([session[0], replace(session[1], setpoints={})], EFFECTS)


def test_a_report_cites_the_self_check_of_its_session_and_no_other(tmp_path) -> None:
    path = tmp_path / "check.json"
    rows = [{"effect": "leak", "minimum_visible": 0.01, "parameter": "shortfall", "recovery": 0.9},
            {"effect": "creep", "minimum_visible": None, "parameter": "share", "recovery": 0.7},
            {"effect": "rim_leak", "minimum_visible": None, "parameter": "share", "recovery": 0.0}]  # fmt: skip
    path.write_text(json.dumps({"schema": "gap-selfcheck/1", "recordings": ["a"], "effects": rows}))
    said = cited(path, ["a", "b"], [{"effects": ["leak"]}])
    assert said["unseen"] == ["rim_leak"]
    assert "could not have shown 1 of 3 effects at any strength. 1 more would show at" in said["text"]
    assert "Leak, just visible, would be named in 90 %" in said["text"]
    faint = cited(path, ["a", "b"], [{"effects": ["creep"]}])
    assert "Creep, at its greatest strength, would be named in 70 %" in faint["text"]
    with pytest.raises(ValueError, match="is of another session"):
        cited(path, ["b"], [])
    path.write_text("{}")
    with pytest.raises(ValueError, match="is not of schema gap-selfcheck/1"):
        cited(path, ["a"], [])
