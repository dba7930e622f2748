import math

import pytest

from protocols import units
from protocols.limits import DwellTimer, Limits, Range
from protocols.schema import CHANNELS, QUANTITIES
from protocols.setpoints import Segment, Setpoints, Until


def setpoints(*points: tuple[float, float], quantity: str = "pressure", until: Until | None = None) -> Setpoints:
    """Segments joining (duration, value) points, from 0."""
    segments, value = [], 0.0
    for number, (duration, end) in enumerate(points):
        segments.append(Segment(duration, {quantity: value}, {quantity: end}, step=str(number), until=until))
        value = end
    return Setpoints(tuple(segments))


SUCTION = Limits({"pressure": Range(-50e3, 0.0)}, "hardware")


def test_intersection_keeps_the_tighter_bound_of_each_and_what_only_one_names() -> None:
    station = Limits({"pressure": Range(-30e3, 1e3, 1e6), "apex_height": Range(high=4e-3)}, "station")
    both = SUCTION.intersect(station)
    assert both["pressure"] == Range(-30e3, 0.0, 1e6)
    assert both["apex_height"] == Range(high=4e-3)
    assert both.origin == "hardware ∩ station"
    assert both.values()["pressure"] == (-30e3, 0.0)
    assert both.rates() == {"pressure": 1e6}


def test_limits_that_exclude_each_other_are_an_error_naming_the_quantity() -> None:
    with pytest.raises(ValueError, match="pressure: hardware and subject limits exclude"):
        SUCTION.intersect(Limits({"pressure": Range(-80e3, -60e3)}, "subject"))


def test_limits_that_are_swapped_are_told_in_the_unit_of_people() -> None:
    with pytest.raises(ValueError, match=r"pressure: the range is empty: low 0 mbar is above high -400 mbar"):
        Limits.parse({"pressure": {"low": "0 mbar", "high": "-400 mbar"}})
    one, other = (Limits({"probe": Range(low, low + 1e-3)}, whose) for low, whose in ((0.0, "a"), (2e-3, "b")))
    with pytest.raises(ValueError, match=r"a and b limits exclude each other \(.*low 2 mm is above high 1 mm\)"):
        one.intersect(other)


@pytest.mark.parametrize("bad", [{"low": 1.0, "high": 0.0}, {"rate": 0.0}, {"low": math.nan}])
def test_a_range_that_makes_no_sense_is_refused(bad: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"empty|positive|not a number"):
        Range(**bad)


def test_inside_is_silent_and_outside_is_named() -> None:
    assert list(SUCTION.violations(setpoints((0, -50e3), (60, -50e3)))) == []
    (fault,) = SUCTION.violations(setpoints((10, -60e3)))
    assert (fault.step, fault.quantity) == ("0", "pressure")
    assert "-600 mbar is outside -500 mbar … 0 mbar (hardware limits)" in fault.message


def test_no_limits_no_arming() -> None:
    (fault,) = Limits().violations(setpoints((1, -1e3)))
    assert "no limits" in fault.message
    (half,) = Limits({"pressure": Range(low=-1e4)}).violations(setpoints((1, -1e3)))
    assert "no limits" in half.message


def test_rates_bound_ramps_and_forbid_steps() -> None:
    limits = Limits({"pressure": Range(-50e3, 0, 2e3)})
    assert list(limits.violations(setpoints((10, -20e3)))) == []
    assert "faster than the 20 mbar/s" in next(iter(limits.violations(setpoints((9, -20e3))))).message
    assert "a step at once" in next(iter(limits.violations(setpoints((0, -1e3))))).message


def test_positive_pressure_is_explained() -> None:
    assert "suction is negative" in next(iter(SUCTION.violations(setpoints((1, 30e3))))).message


def test_after_an_until_the_next_segment_may_begin_anywhere() -> None:
    until = Until("apex_height", ">", 1e-3)
    first = Segment(10, {"pressure": 0.0}, {"pressure": -20e3}, until=until)
    then = Segment(1, {"pressure": -20e3}, {"pressure": -21e3})
    limits = Limits({"pressure": Range(-50e3, 0, 2e3)})
    assert any("faster" in v.message for v in limits.violations(Setpoints((first, then))))


def test_probe_excursion_and_speed_are_of_the_vector() -> None:
    def at(x: float, y: float, z: float) -> dict[str, float]:
        return {"probe_x": x, "probe_y": y, "probe_z": z}

    axis = Range(-2e-3, 2e-3)
    limits = Limits({"probe_x": axis, "probe_y": axis, "probe_z": axis, "probe": Range(0, 1.5e-3, 1e-3)})
    inside = Setpoints((Segment(2, at(0, 0, 0), at(1e-3, 1e-3, 0)),))
    assert list(limits.violations(inside)) == []
    far = Setpoints((Segment(9, at(0, 0, 0), at(1.2e-3, 1.2e-3, 0)),))
    fast = Setpoints((Segment(1, at(0, 0, 0), at(0.8e-3, 0.8e-3, 0)),))
    assert [v.quantity for v in limits.violations(far)] == ["probe"]
    assert "mm/s" in next(iter(limits.violations(fast))).message


def test_parsed_from_text() -> None:
    limits = Limits.parse({"pressure": {"low": "-500 mbar", "high": "0 mbar", "rate": "1e5 mbar/s"}}, "station")
    assert limits["pressure"] == Range(-50e3, 0.0, 1e7)
    with pytest.raises(ValueError, match=r"pressure\.low: .*unit"):
        Limits.parse({"pressure": {"low": "-3 mm"}})
    with pytest.raises(ValueError, match="lowest"):
        Limits.parse({"pressure": {"lowest": "-3 mbar"}})
    with pytest.raises(ValueError, match="unknown channel"):
        Limits.parse({"presure": {"low": "-3 mbar"}})


def test_a_rest_ends_at_the_last_moment_of_rest_however_coarse_the_moments() -> None:
    """Half a second of rest before half a second of ramp is no rest of a second."""
    timer = DwellTimer()
    told = [
        timer.at(2.0 * k + t, away)
        for k in range(3)
        for t, away in ((0.0, False), (0.5, True), (1.0, True), (1.5, False))
    ]
    assert max(told) > 4.0
    timer = DwellTimer()
    for moment, away in ((0.0, False), (0.5, True), (1.5, False), (2.5, False)):
        timer.at(moment, away)
    assert timer.at(3.0, True) == 0.5  # that was one


@pytest.mark.parametrize("name", ["force", "force_q", "probe_xx", "transducer_force_d", "axis_position_4", "pressure_"])
def test_a_limit_that_nothing_would_hold_is_refused(name: str) -> None:
    """A limit of ``force`` was accepted, shown as active and never held: a force of 0.77 N against 0.2 N."""
    with pytest.raises(ValueError, match="unknown channel"):
        Limits.parse({name: {"low": "0 N", "high": "0.2 N"}})


def test_what_every_instrument_commands_and_measures_can_be_limited() -> None:
    named = {name for names in (*QUANTITIES.values(), *CHANNELS.values()) for name in names}
    assert named | {"probe", "pressure_reference"} == set(units.CHANNELS)
