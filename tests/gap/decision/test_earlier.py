"""Earlier sessions of a person: what they say of the skin, what that is worth, and when they are not believed."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from acquire.recording.model import Recording
from gap import as_json, diagnose
from gap.decision.earlier import between_sessions, known_skin, skin_of, unlike
from gap.design import simulated as own
from gap.diagnosis import DiagnosisError
from gap.effects.load import library
from gap.inference.least_squares import fit
from gap.inference.linear import Projector
from gap.null.known_skin import KnownSkin
from gap.null.suction import suction_problems
from gap.null.suction_height import HeightBlock
from gap.report.html import page
from sim_devices.stages.tissues import suction_tissue

LEGS = [
    own.step_hold(-20e3, 5.0, 3.0),
    replace(own.step_hold(-20e3, 5.0, 3.0), repeat=2),
    own.step_hold(-10e3, 5.0, 3.0),
    own.triangle(-20e3, 8.0, 1, 5.0),
]


def session(seed: int, effects=(), stiffness: float = 1.0, legs=tuple(LEGS)) -> list[Recording]:
    """A day of one person: skin that is softer by a factor ``stiffness``."""
    skin = suction_tissue("forearm")
    skin = replace(skin, compliance=skin.compliance * stiffness)
    made = own.suction_session("aspiration", np.random.default_rng(seed), effects, tissue=skin, legs=list(legs))
    return [replace(r, info=replace(r.info, id=f"day-{seed}-{r.info.id}")) for r in made]


def height(recordings: list[Recording]) -> HeightBlock:
    problems, _ = suction_problems(recordings, {})
    return next(p for p in problems if isinstance(p, HeightBlock))


def told(recordings: list[Recording]):
    block = height(recordings)
    return skin_of(recordings[0].info.id, block, fit(block, iterations=60), 1.0)


@pytest.fixture(scope="module")
def known() -> KnownSkin:
    made, believed, doubted = known_skin(height(session(5, stiffness=1.1)), [told(session(6))])
    assert made is not None
    assert believed == ("day-6-simulated-0",)
    assert not doubted
    return made


def test_skin_of_another_day_is_foretold_within_what_days_differ_by(known: KnownSkin) -> None:
    alone = fit(known, iterations=60)
    assert alone.chi2 < 1.05 * len(alone.residual)
    z = alone.nuisance[known.places]
    assert float(np.sqrt(np.mean(z**2))) < 2.0
    at = known.names.index("compliance")
    sd = float(np.sqrt((known.root @ known.root.T)[at, at]))
    mean = known.parameters(known.start())[known.places[at]]
    assert sd / (1.0 + mean) >= between_sessions()["compliance"]
    # 10 % softer than on the earlier day, fitted in the earlier day's coordinates.
    here = known.quantities(alone.nuisance)["elastic_height"][0]
    before = known.quantities(known.start())["elastic_height"][0]
    assert here / before == pytest.approx(1.1, abs=0.06)


def test_derivatives_are_those_of_the_coordinates(known: KnownSkin) -> None:
    start = known.start()
    here = known.evaluate(start, {})
    for k in known.places:
        moved = start.copy()
        moved[k] += 1e-3
        change = (here.residual - known.evaluate(moved, {}, want_jacobian=False).residual) / 1e-3
        assert change == pytest.approx(here.jacobian[:, k], abs=0.02 * np.abs(change).max() + 1e-6)


def test_a_height_that_is_half_as_large_again_stands_out_where_the_skin_is_known(known: KnownSkin) -> None:
    f = fit(known, iterations=60)
    own = f.jacobian.copy()
    own[:, known.places] = f.jacobian[:, known.places] @ np.linalg.inv(known.root)
    change = 0.5 * own[:, list(known.block.PARTS).index("compliance")]
    unknown = Projector(own, known.widths[0]).chi2(change)
    assert unknown < 1.5  # a person's skin may be that soft
    assert Projector(f.jacobian, known.prior_scales[0]).chi2(change) > 5.0 * unknown


def test_two_days_tell_more_than_one() -> None:
    one, other = told(session(6)), told(session(7, stiffness=0.95))
    block = height(session(5))
    single, _, _ = known_skin(block, [one])
    both, believed, _ = known_skin(block, [one, other])
    assert single is not None
    assert both is not None
    assert len(believed) == 2
    assert known_skin(block, [replace(one, law=replace(one.law, amounts=("flow",))), other])[2] == {
        one.session: "its skin follows another law than that of the latest session"
    }


def test_law_that_depends_on_the_load_is_not_taken_to_another(known: KnownSkin) -> None:
    skin = told(session(6))
    bent = replace(skin, law=replace(skin.law, amounts=(*skin.law.amounts, "slowing")), strongest=2 * skin.strongest)
    made, believed, doubted = known_skin(known.block, [bent])
    assert made is None
    assert not believed
    assert "strongest suction" in doubted[skin.session]


def test_other_people_sites_and_instruments_are_named() -> None:
    here, earlier = session(5), session(6)

    def other(**changed: str) -> list[Recording]:
        return [replace(r, info=replace(r.info, **changed)) for r in earlier]

    assert unlike(earlier, here) == ""
    assert "another subject: P07, not P00" in unlike(other(subject="P07"), here)
    assert "another site" in unlike(other(site="cheek"), here)
    assert "another instrument" in unlike(other(instrument="cutometer"), here)
    assert "states none" in unlike(other(subject=""), here)
    assert "opening" in unlike(other(protocol="opening: 4 mm"), here)
    assert "another opening of the probe: 4 mm" in unlike(other(protocol="setup: {opening: 4 mm}"), here)
    assert unlike(other(protocol="{ not yaml"), here) == ""
    assert "itself" in unlike(here[:1], here)


class Model:
    name = "m"
    channels = ("apex_height",)
    stages: ClassVar = {}
    parameters = ()

    def simulate(self, time, data, parameters, tap):
        return {"apex_height": 0 * time}


def test_a_rig_has_no_earlier_sessions() -> None:
    with pytest.raises(DiagnosisError, match="earlier sessions are for suction"):
        diagnose(session(5), Model(), earlier=[session(6)])


@pytest.mark.slow
def test_a_report_tells_what_earlier_sessions_were_worth() -> None:
    late = (library("aspiration")["regulator_lag[form=0]"], {"tau": 0.8})  # 0.4 s may be another make's
    someone = [replace(r, info=replace(r.info, subject="P07")) for r in session(8)]
    d = diagnose(session(5), quick=True, earlier=[session(6), session(7, [late]), someone])
    report = as_json(d)["earlier"]
    assert report["believed"] == ["day-6-simulated-0"]
    doubted = {entry["session"]: entry["reason"] for entry in report["doubted"]}
    assert "a gap of its own" in doubted["day-7-simulated-0"]
    assert "another subject" in doubted["day-8-simulated-0"]
    assert "compliance" in report["parameters"]
    assert not report["changed"]
    assert all(entry["with"] > entry["without"] for entry in report["detectability"].values())
    assert "show at less strength" in report["text"]
    assert d.verdict.verdict in ("none", "undetectable")
    shown = page(d)
    assert report["text"] in shown
    assert "day-8-simulated-0 is not believed: it is of another subject: P07, not P00" in shown
    assert as_json(diagnose(session(5), quick=True))["earlier"] is None
