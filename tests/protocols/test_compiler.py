import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocols import Limits, Protocol, ProtocolError, Range, Setpoints, compile_protocol, dump, load
from protocols.setpoints import Until

SUCTION = Limits({"pressure": Range(-50e3, 0.0)}, "hardware")
TIP = Limits({f"probe_{axis}": Range(-3e-3, 3e-3, 20e-3) for axis in "xyz"}, "hardware")


def suction(*steps: str, instrument: str = "cutometer") -> Protocol:
    lines = "".join(f"  - {step}\n" for step in steps)
    return load(f"schema: protocol/1\nname: x\ninstrument: {instrument}\nsteps:\n{lines}")


def compiled(*steps: str) -> Setpoints:
    return compile_protocol(suction(*steps), SUCTION)


def test_instant_loading_is_a_step_then_a_plateau_then_release() -> None:
    setpoints = compiled("{type: hold, suction: 300 mbar, duration: 60 s}", "{type: wait, duration: 15 s}")
    assert [(s.phase, s.duration, s.end["pressure"]) for s in setpoints.segments] == [
        ("load", 0, -30e3),
        ("hold", 60, -30e3),
        ("unload", 0, 0),
        ("rest", 15, 0),
    ]
    assert [s.step for s in setpoints.segments] == ["0", "0", "1", "1"]
    assert setpoints.segments[1].labels == {"level": "300 mbar"}


@pytest.mark.parametrize(("spans", "peak"), [("leg", -26250), ("triangle", -13125)])
def test_t_lin_is_a_leg_or_the_whole_triangle(spans: str, peak: float) -> None:
    up, down = compiled(f"{{type: cycle, rate: 15 mbar/s, t_lin: 17.5 s, t_lin_spans: {spans}}}").segments
    assert up.end["pressure"] == pytest.approx(peak)
    assert up.duration == down.duration == (17.5 if spans == "leg" else 8.75)
    assert (up.phase, down.phase, down.end["pressure"]) == ("load", "unload", 0)
    assert up.labels["rate"] == "15 mbar/s"


def test_a_cycle_by_peak_and_frequency_or_rate() -> None:
    by_frequency = compiled("{type: cycle, suction: 200 mbar, frequency: 0.1 Hz, cycles: 3}")
    by_rate = compiled("{type: cycle, suction: 200 mbar, rate: 40 mbar/s, cycles: 3}")
    assert by_frequency.segments == by_rate.segments
    assert by_frequency.duration == pytest.approx(30)
    assert [s.labels["cycle"] for s in by_frequency.segments] == ["1", "1", "2", "2", "3", "3"]


def test_finite_rates_make_ramps_of_the_approach_and_the_release() -> None:
    setpoints = compiled(
        "{type: hold, suction: 100 mbar, rate: 50 mbar/s, duration: 1 s}",
        "{type: wait, rate: 100 mbar/s, duration: 1 s}",
    )
    assert [s.duration for s in setpoints.segments] == pytest.approx([2, 1, 1, 1])


def test_groups_count_repeats_and_cycles() -> None:
    text = """
schema: protocol/1
name: x
instrument: cutometer
steps:
  - type: group
    repeat: 2
    steps:
      - type: group
        repeat: 3
        counts_as: cycle
        steps:
          - {type: hold, suction: 10 mbar, duration: 1 s}
          - {type: wait, duration: 1 s}
"""
    plateaus = [s for s in compile_protocol(load(text), SUCTION).segments if s.phase == "hold"]
    assert [(s.labels["repeat"], s.labels["cycle"]) for s in plateaus] == [(r, c) for r in "12" for c in "123"]
    assert plateaus[0].step == "0.0.0"


def test_until_is_in_si() -> None:
    setpoints = compiled(
        "{type: ramp, suction: 300 mbar, rate: 15 mbar/s, until: {channel: apex_height, above: 2 mm}}",
        "{type: wait, duration: 60 s, until: {channel: pressure, above: -1 mbar}}",
    )
    assert setpoints.segments[0].until == Until("apex_height", ">", 2e-3)
    assert setpoints.segments[-1].until == Until("pressure", ">", -100.0)


def test_robot_goes_out_and_back_along_each_direction() -> None:
    protocol = suction(
        "{type: trajectory, amplitude: 1.2 mm, frequency: 0.1 Hz, cycles: 3,"
        " directions: [{theta: 90 deg}, {phi: 90 deg}, {theta: 45 deg, phi: 45 deg}]}",
        instrument="microrobot",
    )
    setpoints = compile_protocol(protocol, TIP)
    assert setpoints.duration == pytest.approx(90)
    assert setpoints.segments[0].end == {"probe_x": 0.0, "probe_y": 1.2e-3, "probe_z": 0.0}
    assert setpoints.segments[6].end == {"probe_x": 0.0, "probe_y": 0.0, "probe_z": 1.2e-3}
    assert setpoints.segments[12].end == pytest.approx(
        {"probe_x": 0.6e-3, "probe_y": 0.6e-3, "probe_z": 1.2e-3 * math.sqrt(0.5)}
    )
    assert all(set(s.end.values()) == {0.0} for s in setpoints.segments if s.phase == "unload")
    assert setpoints.segments[0].labels == {"direction": "theta=90 phi=0", "level": "1.2 mm", "cycle": "1"}


def test_robot_both_sides_speed_and_rest() -> None:
    protocol = suction(
        "{type: trajectory, amplitude: 1 mm, speed: 2 mm/s, sides: both, rest: 3 s, directions: [{theta: 0 deg}]}",
        instrument="microrobot",
    )
    segments = compile_protocol(protocol, TIP).segments
    assert [s.end["probe_x"] for s in segments] == [1e-3, 0, -1e-3, 0, 0]
    assert [s.duration for s in segments] == pytest.approx([0.5, 0.5, 0.5, 0.5, 3])
    assert [s.phase for s in segments] == ["load", "unload", "load", "unload", "rest"]


def test_speed_limits_hold_for_the_tip_not_only_its_axes() -> None:
    protocol = suction(
        "{type: trajectory, amplitude: 1 mm, speed: 25 mm/s, directions: [{theta: 45 deg}]}", instrument="microrobot"
    )
    compile_protocol(protocol, TIP)
    with pytest.raises(ProtocolError, match="probe 25 mm/s is faster than the 20 mm/s"):
        compile_protocol(protocol, TIP.intersect(Limits({"probe": Range(0, 3e-3, 20e-3)}, "station")))


def test_a_protocol_keeps_its_text_and_is_equal_without_it() -> None:
    protocol = suction("{type: wait, duration: 1 s}  # a comment")
    assert "# a comment" in protocol.origin.text
    again = load(dump(protocol))
    assert again == protocol
    assert "comment" not in again.origin.text


def test_the_example_in_the_package_docstring_runs() -> None:
    limits = Limits.parse({"pressure": {"low": "-500 mbar", "high": "0 mbar"}})
    assert compile_protocol(suction("{type: wait, duration: 1 s}"), limits).duration == 1


# Protocols made at random, of any instrument.
number = st.integers(1, 400)
seconds = st.integers(1, 200).map(lambda n: f"{n / 10} s")
mbar = number.map(lambda n: f"{n} mbar")
rate = number.map(lambda n: f"{n / 7:.3f} mbar/s")
angle = st.integers(-180, 180).map(lambda n: f"{n} deg")
until = st.fixed_dictionaries({"channel": st.just("apex_height"), "above": number.map(lambda n: f"{n / 100} mm")})
suction_steps: st.SearchStrategy[dict[str, Any]] = st.one_of(
    st.fixed_dictionaries(
        {"type": st.just("hold"), "suction": mbar, "duration": seconds}, optional={"rate": rate, "until": until}
    ),
    st.fixed_dictionaries({"type": st.just("ramp"), "suction": mbar, "rate": rate}, optional={"until": until}),
    st.fixed_dictionaries({"type": st.just("ramp"), "pressure": mbar.map("-{}".format), "duration": seconds}),
    st.fixed_dictionaries({"type": st.just("wait"), "duration": seconds}, optional={"rate": rate}),
)
robot_steps: st.SearchStrategy[dict[str, Any]] = st.one_of(
    st.fixed_dictionaries(
        {
            "type": st.just("trajectory"),
            "amplitude": number.map(lambda n: f"{n / 200} mm"),
            "speed": number.map(lambda n: f"{n / 100} mm/s"),
            "directions": st.lists(
                st.fixed_dictionaries({}, optional={"theta": angle, "phi": angle}), min_size=1, max_size=3
            ),
        },
        optional={"sides": st.just("both"), "rest": seconds, "cycles": st.integers(1, 3)},
    ),
    st.fixed_dictionaries({"type": st.just("wait"), "duration": seconds}),
)


@st.composite
def protocols(draw: st.DrawFn) -> Protocol:
    robot = draw(st.booleans())
    steps = st.lists(robot_steps if robot else suction_steps, min_size=1, max_size=4)
    group = st.fixed_dictionaries({"type": st.just("group"), "repeat": st.integers(1, 3), "steps": steps})
    return Protocol.model_validate(
        {
            "schema": "protocol/1",
            "name": "random",
            "instrument": "microrobot" if robot else draw(st.sampled_from(["cutometer", "aspiration"])),
            "steps": [*draw(steps), draw(group)],
        }
    )


@settings(max_examples=60, deadline=None)
@given(protocols())
def test_any_protocol_survives_text_and_compiles_to_joined_segments_inside_its_limits(protocol: Protocol) -> None:
    assert load(dump(protocol)) == protocol
    setpoints = compile_protocol(protocol, TIP if protocol.instrument == "microrobot" else SUCTION)
    for before, after in zip(setpoints.segments, setpoints.segments[1:], strict=False):
        assert before.end == after.start
    assert all(s.duration >= 0 for s in setpoints.segments)
    assert set(setpoints.segments[0].start.values()) == {0.0}
    time, values = setpoints.table()
    assert np.all(np.diff(time) >= 0)
    for value in values.values():
        assert np.all(np.isfinite(value))
    dense = setpoints.at(np.linspace(0, setpoints.duration, 101))
    for name, value in dense.items():
        low, high = (-50e3, 0.0) if name == "pressure" else (-3e-3, 3e-3)
        assert np.all((value >= low) & (value <= high))
