"""Whoever sets a limit, and on what: a protocol that passes it is refused before anything is armed, no other is."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquire.engine import RunPlan
from acquire.engine.active import ActiveRun
from acquire.plugins import instrument
from acquire.recording import RunInfo
from acquire.session import Session
from acquire.station import Station, load_station
from drivers.instrument import Entry
from protocols import Limits, Protocol, ProtocolError, load
from protocols.setpoints import Segment, Setpoints

KINDS = ("cutometer", "aspiration", "microrobot")
WHO = ("station", "protocol", "subject")


def limit_text(kind: str, reach: float, rate: float, dwell: float) -> str:
    """One limit as YAML; ``reach`` is in mbar of suction or 0.01 mm."""
    if kind == "microrobot":
        return f"{{probe: {{low: 0 mm, high: {reach / 100:.6f} mm, rate: {rate:.6f} mm/s, dwell: {dwell:.6f} s}}}}"
    return f"{{pressure: {{low: -{reach:.6f} mbar, high: 0 mbar, rate: {rate:.6f} mbar/s, dwell: {dwell:.6f} s}}}}"


def bench(kind: str, given: Mapping[str, str]) -> Station:
    limits = f", limits: {given['station']}" if "station" in given else ""
    subjects = f"subjects: {{P01: {given['subject']}}}\n" if "subject" in given else ""
    return load_station(f"schema: station/1\ninstruments:\n  {kind}: {{simulated: true{limits}}}\n{subjects}")


def protocol(kind: str, given: Mapping[str, str], reach: float, rate: float, hold: float) -> Protocol:
    goal = f"position: {{x: {reach / 100:.6f} mm}}" if kind == "microrobot" else f"suction: {reach:.6f} mbar"
    speed = f"speed: {rate:.6f} mm/s" if kind == "microrobot" else f"rate: {rate:.6f} mbar/s"
    rest = f"position: {{x: 0 mm}}, {speed}" if kind == "microrobot" else f"suction: 0 mbar, {speed}"
    limits = f"limits: {given['protocol']}\n" if "protocol" in given else ""
    return load(
        f"schema: protocol/1\nname: made\ninstrument: {kind}\n{limits}steps:\n"
        f"  - {{type: ramp, {goal}, {speed}}}\n  - {{type: hold, duration: {hold:.6f} s}}\n  - {{type: ramp, {rest}}}\n"
    )


numbers = {"reach": st.floats(1.0, 200.0), "rate": st.floats(1.0, 500.0), "dwell": st.floats(2.0, 400.0)}
limits = st.fixed_dictionaries(numbers)


@settings(max_examples=150, deadline=None)
@given(
    kind=st.sampled_from(KINDS),
    whose=st.dictionaries(st.sampled_from(WHO), limits, max_size=3),
    reach=st.floats(1.0, 250.0),
    rate=st.floats(1.0, 600.0),
    hold=st.floats(1.0, 400.0),
)
def test_every_limit_counts_whoever_sets_it(
    kind: str, whose: dict[str, dict[str, float]], reach: float, rate: float, hold: float
) -> None:
    given = {who: limit_text(kind, **limit) for who, limit in whose.items()}
    hardware = instrument(kind).limits["probe" if kind == "microrobot" else "pressure"]
    unit, speed = (1e-5, 1e-3) if kind == "microrobot" else (100.0, 100.0)
    most_reach = min([max(-hardware.low, hardware.high), *(x["reach"] * unit for x in whose.values())])
    most_rate = min([hardware.rate, *(x["rate"] * speed for x in whose.values())])
    most_dwell = min([hardware.dwell, *(x["dwell"] for x in whose.values())])
    away = 2 * reach * unit / (rate * speed) + hold
    measured = ((reach * unit, most_reach), (rate * speed, most_rate), (away, most_dwell))
    if any(math.isclose(value, most, rel_tol=1e-4) for value, most in measured):
        return  # on the edge either is right
    allowed = all(value < most for value, most in measured)
    with Session(bench(kind, given)) as session:
        made = protocol(kind, given, reach, rate, hold)
        if allowed:
            session.compile(kind, made, "P01")
            return
        with pytest.raises(ProtocolError) as caught:
            session.compile(kind, made, "P01")
        assert all(problem.line for problem in caught.value.problems)


@settings(max_examples=60, deadline=None)
@given(kind=st.sampled_from(KINDS), which=st.sampled_from(("reach", "rate", "dwell")), excess=st.floats(1.001, 50.0))
def test_arming_asks_again(tmp_path_factory: pytest.TempPathFactory, kind: str, which: str, excess: float) -> None:
    """A plan that nobody compiled, as a program might make one, is refused all the same."""
    known: Limits = instrument(kind).limits
    name = "probe" if kind == "microrobot" else "pressure"
    tight = known.intersect(Limits.parse({name: _tight(kind)}, "subject"))
    made = {"reach": 1.0, "rate": 1.0, "dwell": 1.0, which: excess}
    end = (1e-3 if kind == "microrobot" else -10e3) * made["reach"]
    lead = abs(end) / ((1e-3 if kind == "microrobot" else 10e3) * made["rate"])
    stay = max(0.0, 10.0 * made["dwell"] - lead) if which == "dwell" else 1.0
    quantities = instrument(kind).quantities
    rest = dict.fromkeys(quantities, 0.0)
    there = {**rest, quantities[0]: end}
    setpoints = Setpoints((Segment(lead, rest, there), Segment(stay, there, there)))
    path: Path = tmp_path_factory.mktemp("never") / "run.h5"
    plan = RunPlan(setpoints, tight, RunInfo(id="a", instrument=kind, start_time="2024-01-01T00:00:00+00:00"), path)
    rig = instrument(kind).open_rig(Entry(kind, "socket://127.0.0.1:1", simulated=True))
    with pytest.raises(ValueError, match=r"outside|faster|away from rest"):
        ActiveRun(plan, rig, lambda why: None)
    assert not list(path.parent.iterdir()), "nothing was begun"


def _tight(kind: str) -> dict[str, str]:
    if kind == "microrobot":
        return {"low": "0 mm", "high": "1 mm", "rate": "1 mm/s", "dwell": "10 s"}
    return {"low": "-100 mbar", "high": "0 mbar", "rate": "100 mbar/s", "dwell": "10 s"}


@pytest.mark.parametrize("kind", KINDS)
def test_limits_that_exclude_each_other_leave_nothing(kind: str) -> None:
    name = "probe_x" if kind == "microrobot" else "pressure"
    far = {"low": "2 mm", "high": "3 mm"} if kind == "microrobot" else {"low": "-300 mbar", "high": "-200 mbar"}
    near = {"low": "0 mm", "high": "1 mm"} if kind == "microrobot" else {"low": "-100 mbar", "high": "0 mbar"}
    with pytest.raises(ValueError, match="exclude each other"):
        Limits.parse({name: far}, "station").intersect(Limits.parse({name: near}, "subject"))
