"""Rigs of a user's own: taps, and the effects that are found at them."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from gap.decision.thresholds import INSTRUMENT, RIG
from gap.diagnosis import diagnose
from gap.inference.hypothesis import to_unit
from gap.inference.least_squares import fit
from gap.rig import generic_laws as laws
from gap.rig.problem import RigProblem
from gap.rig.taps import Way
from sim_devices.chain import Parameter
from tests.gap.rig.springs import TIME, Spring, lagging

pytestmark = pytest.mark.slow

SLOW_MODE = {"tau": 2.0, "exponent": 0.4, "settled": 0.0}


def test_a_rig_is_its_model_plus_taps(stretched) -> None:
    problem = RigProblem([stretched()], Spring())
    keys = {c.key for c in problem.candidates}
    assert {"coulomb_friction@spring_force", "saturation@force", "hum@force"} <= keys
    assert not any(k.startswith("coulomb_friction@force") for k in keys)  # no velocity at that tap
    right = problem.coordinates({"stiffness": 20.0})
    assert problem.parameters(right)["stiffness"] == pytest.approx(20.0)
    residual = problem.evaluate(right, {}).residual
    assert np.mean(residual**2) == pytest.approx(1.0, rel=0.15)


def test_nothing_leaves_its_range_and_what_ends_there_is_told(stretched) -> None:
    stiff = stretched(lambda force, x, v: 300.0 * force)  # 6000 N/m where the model says 1000 at most
    problem = RigProblem([stiff], Spring())
    fitted = fit(problem, iterations=40)
    assert problem.parameters(fitted.nuisance)["stiffness"] <= 1e3
    assert all(1.0 <= problem.parameters(np.full(1, z))["stiffness"] <= 1e3 for z in (-40.0, -1.0, 2.0, 40.0))
    (words,) = problem.at_the_end(fitted)
    assert "parameter stiffness" in words
    assert "1 … 1000" in words
    inside = replace(fitted, nuisance=problem.coordinates({"stiffness": 20.0}))
    assert problem.at_the_end(inside) == []
    gain = next(c for c in problem.candidates if c.key == "gain@force")
    (words,) = problem.at_the_end(replace(inside, hypothesis=(gain,), unit=np.ones(1)))
    assert "error of gain@force ends at 0.5" in words


def test_a_sensor_stops_at_no_value_that_it_goes_beyond(stretched) -> None:
    """A spring that hardens was told, with .93, to have a sensor that stops in the middle of what it had measured."""
    problem = RigProblem([stretched()], Spring())
    limits = {c.key: c.parameters[0] for c in problem.candidates if c.name.endswith("saturation")}
    highest, sigma = np.max(problem.measured), problem.sigma[0]
    assert highest - 6 * sigma < limits["saturation@force"].low <= highest
    assert highest <= limits["saturation@force"].high < highest + 6 * sigma
    assert limits["saturation@spring_force"].low < 0.5 * highest  # behind a spring that may stop anything can be
    assert limits["lower_saturation@force"].high <= np.min(problem.measured) + 6 * sigma


def test_parameters_and_coordinates_are_inverse(stretched) -> None:
    problem = RigProblem([stretched()], Spring())
    for value in (1.5, 30.0, 900.0):
        assert problem.parameters(problem.coordinates({"stiffness": value}))["stiffness"] == pytest.approx(value)


def test_a_tap_that_stands_still_can_leak_and_one_that_carries_nothing_cannot(recording) -> None:
    class Held:
        name, channels = "held", ("pressure",)
        stages: ClassVar = {"chamber": "actuator", "idle": "actuator"}
        parameters = (Parameter("filling", "Pa", 5e5, 1e6, None, 7e5),)

        def simulate(self, time, data, parameters, tap):
            tap("idle", np.zeros_like(time))
            return {"pressure": tap("chamber", np.full_like(time, parameters["filling"]))}

    pressure = 7.5e5 * np.exp(-TIME / 8) + 50 * np.random.default_rng(4).normal(size=len(TIME))
    run = recording({"pressure": pressure}, TIME, instrument="held")
    keys = {c.key for c in RigProblem([run], Held()).candidates}
    assert "leak@chamber" in keys
    assert not any(k.startswith("saturation") for k in keys)
    assert not any(k.endswith("@idle") for k in keys)
    verdict = diagnose([run], Held()).verdict
    assert verdict.verdict == "effect"
    assert verdict.causes[0].names[0] == "leak"


@pytest.mark.parametrize("pulls", [1, 2])
def test_loops_are_asked_for_only_where_the_signal_turns(recording, pulls: int) -> None:
    way = TIME / TIME[-1]
    stretch = way if pulls == 1 else 1.0 - np.abs(1.0 - 2.0 * way)

    class Tape:
        name, channels, stages = "tape", ("force",), {"elastic": "tissue"}
        parameters = (Parameter("stiffness", "N/m", 0.5, 50.0, None, 5.0, "log"),)

        def simulate(self, time, data, parameters, tap):
            force = parameters["stiffness"] * data["stretch"]
            for one, x in zip(force, data["stretch"], strict=True):  # sample by sample, as from within a loop
                tap("elastic", float(one), position=float(x), velocity=1.0)
            return {"force": force}

    run = recording({"force": 5.0 * stretch, "stretch": stretch}, TIME, instrument="tape")
    names = {c.name for c in RigProblem([run], Tape()).candidates}
    assert {"hysteresis", "dahl_friction", "backlash"} & names == (
        {"hysteresis", "dahl_friction", "backlash"} if pulls > 1 else set()
    )
    assert {"coulomb_friction", "quadratic_error"} <= names


def test_what_is_no_number_turns_nothing_and_hides_no_turn() -> None:
    way = Way()
    for values in (np.array([0.0, np.nan, 1.0]), np.array([np.nan]), np.array([0.5, 2.0])):
        way.go(values)
    assert way.turns
    assert not Way().turns


def test_a_slow_mode_is_found_though_it_takes_over_half_of_the_model(recording) -> None:
    time = np.arange(0.0, 1200.0, 4.0)
    volts = np.select([time < 400, time < 800], [9.0, 4.0], 8.0)

    class Plate:
        name, channels = "plate", ("temperature",)
        stages: ClassVar = {"voltage": "actuator", "temperature": "sensor"}
        parameters = (
            Parameter("gain", "K/V", 2.0, 100.0, None, 20.0, "log"),
            Parameter("tau", "s", 5.0, 500.0, None, 50.0, "log"),
            Parameter("start", "K", 100.0, 200.0, None, 130.0),
        )

        def simulate(self, time, data, parameters, tap):
            heated = parameters["gain"] * tap("voltage", data["voltage"])
            return {"temperature": tap("temperature", lagging(heated, 4.0, parameters["tau"], parameters["start"]))}

    made = lagging(8.0 * volts, 4.0, 25.0, 50.0) + lagging(12.0 * volts, 4.0, 180.0, 75.0)
    made += 0.2 * np.random.default_rng(5).normal(size=len(time))
    run = recording({"temperature": made}, time, {"voltage": (time, volts)}, instrument="plate")
    diagnosis = diagnose([run], Plate())
    assert diagnosis.verdict.verdict == "effect"
    assert diagnosis.verdict.causes[0].names[0] == "creep"
    assert diagnosis.gap_after < 0.2 * diagnosis.gap_before


def test_what_slackens_is_creep(recording) -> None:
    stretch = np.minimum(TIME, 1.0)
    force = 10.0 * stretch - 5.0 * laws.creep({}, TIME, stretch, {}, {"share": 0.4, **SLOW_MODE})
    force += 5e-3 * np.random.default_rng(6).normal(size=len(TIME))

    class Tape:
        name, channels, stages = "tape", ("force",), {"elastic": "tissue"}
        parameters = (Parameter("stiffness", "N/m", 0.5, 50.0, None, 5.0, "log"),)

        def simulate(self, time, data, parameters, tap):
            return {"force": tap("elastic", parameters["stiffness"] * data["stretch"])}

    run = recording({"force": force, "stretch": stretch}, TIME, instrument="tape")
    verdict = diagnose([run], Tape()).verdict
    assert verdict.verdict == "effect"
    assert "creep" in verdict.causes[0].names


def test_a_second_effect_is_not_made_of_what_the_model_itself_lacks(recording) -> None:
    """Half of what a lag leaves of a ladder looks like creep, the rest like nothing: real circuits are no simpler."""
    time = np.arange(0.0, 0.3, 1e-3)
    volts = np.where((time // 0.05) % 2 == 0, 0.5, -0.5)

    class Ladder:
        name, channels = "ladder", ("out",)
        stages: ClassVar = {"dac": "actuator", "out": "sensor"}
        parameters = (
            Parameter("tau", "s", 1e-3, 3e-2, None, 5e-3, "log"),
            Parameter("gain", "1", 0.9, 1.1, None, 1.0),
        )

        def simulate(self, time, data, parameters, tap):
            out = parameters["gain"] * lagging(tap("dac", data["dac"]), 1e-3, parameters["tau"], -0.5)
            return {"out": tap("out", out)}

    lagged = laws.low_pass({}, time, lagging(volts, 1e-3, 5e-3, -0.5), {}, {"tau": 5e-4})
    tail = laws.creep({}, time, lagged, {}, {"share": 0.03, "tau": 1.5e-2, "exponent": 1.2, "settled": 1.0}) - lagged
    rest = np.sin(900 * time) + np.sin(1300 * time + 1) + np.sin(1700 * time + 2)
    noise = 3e-4 * np.random.default_rng(7).normal(size=len(time))
    run = recording({"out": lagged + tail + 1.5e-3 * rest + noise}, time, {"dac": (time, volts)}, instrument="ladder")
    eager = replace(INSTRUMENT, unfinished_pair=RIG.unfinished_pair, second_share=0.3)
    assert diagnose([run], Ladder(), thresholds=eager).verdict.verdict == "several"
    verdict = diagnose([run], Ladder()).verdict
    assert verdict.verdict == "effect"
    assert {"delay", "low_pass"} & set(verdict.causes[0].names)


@pytest.mark.parametrize(("late", "said"), [(1.5e-3, "undetectable"), (8e-3, "effect")])
def test_a_delay_within_a_quarter_of_a_sample_is_the_models_own(recording, late, said) -> None:
    """A sound oscillator, integrated in steps of a quarter sample, was told a lag of 1.6 ms at samples of 10 ms."""
    time = np.arange(0.0, 12.0, 0.01)

    class Gauge:
        name, channels = "gauge", ("out",)
        stages: ClassVar = {"out": "sensor"}
        parameters = (Parameter("gain", "1", 0.5, 2.0, None, 1.1), Parameter("zero", "V", -1.0, 1.0, None, 0.0))

        def simulate(self, time, data, parameters, tap):
            return {"out": tap("out", parameters["gain"] * data["input"] + parameters["zero"])}

    def driven(t):
        return np.sin(7.0 * t) + np.sin(13.0 * t + 1.0) + np.sin(23.0 * t + 2.0)

    noise = 3e-3 * np.random.default_rng(4).normal(size=len(time))
    run = recording({"out": driven(time - late) + noise}, time, {"input": (time, driven(time))}, instrument="gauge")
    diagnosis = diagnose([run], Gauge(), propose_term=False)
    assert {"delay", "low_pass"} & set(diagnosis.verdict.causes[0].names)
    assert diagnosis.verdict.verdict == said


def test_a_motor_at_rest_is_not_cut_off(recording) -> None:
    time = np.arange(0.0, 20.0, 0.02)
    volts = np.where((time % 10 > 2) & (time % 10 < 7), 6.0, 0.0)

    class Motor:
        name, channels = "motor", ("speed",)
        stages: ClassVar = {"voltage": "actuator", "speed": "sensor"}
        parameters = (
            Parameter("gain", "rad/(s V)", 0.2, 20.0, None, 2.0, "log"),
            Parameter("tau", "s", 0.02, 2.0, None, 0.2, "log"),
        )

        def simulate(self, time, data, parameters, tap):
            driven = parameters["gain"] * tap("voltage", data["voltage"])
            return {"speed": tap("speed", lagging(driven, 0.02, parameters["tau"], 0.0))}

    sound = lagging(2.0 * volts, 0.02, 0.3, 0.0)
    noise = 0.03 * np.random.default_rng(0).normal(size=len(time))
    speed = np.where(sound > 0.05, sound + noise, 0.0)  # an encoder at rest counts nothing
    run = recording({"speed": speed}, time, {"voltage": (time, volts)}, instrument="motor")
    diagnosis = diagnose([run], Motor())
    assert diagnosis.signatures == ()
    assert diagnosis.verdict.verdict in ("none", "undetectable")
    assert next(iter(diagnosis.problems.values())).sigma[0] == pytest.approx(0.03, rel=0.15)
    clipped = recording({"speed": np.minimum(speed, 11.0)}, time, {"voltage": (time, volts)}, instrument="motor")
    verdict = diagnose([clipped], Motor()).verdict
    assert verdict.causes[0].names[0] == "saturation"


def test_priors_are_scaled_to_the_rig(stretched) -> None:
    problem = RigProblem([stretched()], Spring())
    level = next(c for c in problem.candidates if c.key == "coulomb_friction@spring_force").parameters[0]
    span = np.ptp(30.0 * stretched().streams["extension"].value)
    assert (level.low, level.high, level.unit) == (pytest.approx(1e-5 * span), pytest.approx(span), "N")
    rate = next(c for c in problem.candidates if c.key == "slew_limit@force").parameters[0]
    assert rate.unit == "N/s"


def test_a_delay_or_lag_far_below_a_sample_is_in_the_prior(stretched) -> None:
    dt = TIME[1] - TIME[0]
    first = {c.key: c.parameters[0] for c in RigProblem([stretched()], Spring()).candidates}
    assert first["delay@force"].low <= 0.02 * dt
    assert first["low_pass@force"].low <= 0.05 * dt


class Follower:
    """Reads its set-point, whose name is that of the channel."""

    name, channels, stages, parameters = "follower", ("pressure",), {}, ()

    def simulate(self, time, data, parameters, tap):
        return {"pressure": data["setpoint_pressure"]}


def test_a_resonance_is_found_far_from_the_default(recording) -> None:
    class Ringing:
        name, channels, stages = "ringing", ("x",), {}
        parameters = (Parameter("rate", "rad/s", 10.0, 90.0, None, 30.0, "log"),)

        def simulate(self, time, data, parameters, tap):
            return {"x": np.sin(parameters["rate"] * time)}

    noise = 0.05 * np.random.default_rng(2).normal(size=len(TIME))
    problem = RigProblem([recording({"x": np.sin(74.0 * TIME) + noise}, TIME, instrument="ringing")], Ringing())
    assert problem.parameters(problem.start())["rate"] == pytest.approx(74.0, rel=1e-3)


def test_a_set_point_is_not_the_channel_of_its_name(recording) -> None:
    run = recording({"pressure": np.zeros_like(TIME)}, TIME, {"pressure": ([0.0, 4.0], [1.0, 1.0])}, instrument="x")
    problem = RigProblem([run], Follower())
    assert np.all(problem.measured == 0.0)
    assert np.all(problem._runs[0][1]["setpoint_pressure"] == 1.0)
    assert np.all(problem.evaluate(np.zeros(0), {}, want_jacobian=False).residual < 0)


class Cart:
    """A mass under a force that swings, its resistance or the net force tapped sample by sample."""

    name, channels = "cart", ("speed",)
    parameters = (Parameter("drag", "N s/m", 0.5, 2.0, None, 1.0, "log"),)

    def __init__(self, tapped: str) -> None:
        self.stages = {tapped: "actuator"}

    def simulate(self, time, data, parameters, tap):
        v, dt, out = 0.0, time[1] - time[0], np.empty_like(time)
        for i, push in enumerate(data["push"].tolist()):
            out[i] = v
            resistance = parameters["drag"] * v
            if "resistance" in self.stages:
                net = push - tap("resistance", resistance, velocity=v)
            else:
                net = tap("net", push - resistance, velocity=v)
            v += dt * net
        return {"speed": out}


@pytest.mark.parametrize("tapped", ["resistance", "net"])
def test_friction_resists_whether_resistance_or_net_force_is_tapped(recording, tapped: str) -> None:
    push = 5 * np.sin(3 * TIME)
    friction = {"level": 1.5, "sharpness": 0.05, "asymmetry": 0.1}

    def tap(name, values, velocity=0.0):
        there = np.tanh(velocity / friction["sharpness"])
        return values + friction["level"] * there * (1 + friction["asymmetry"] * there)

    speed = Cart("resistance").simulate(TIME, {"push": push}, {"drag": 1.0}, tap)["speed"]
    noise = 2e-3 * np.random.default_rng(0).normal(size=len(TIME))
    problem = RigProblem([recording({"speed": speed + noise, "push": push}, TIME, instrument="cart")], Cart(tapped))
    candidate = next(c for c in problem.candidates if c.key == f"coulomb_friction@{tapped}")
    assert np.mean(problem.evaluate(np.zeros(1), {}).residual ** 2) > 100
    assert np.mean(problem.evaluate(np.zeros(1), {candidate: friction}).residual ** 2) == pytest.approx(1.0, rel=0.2)


def test_time_stands_still_at_a_tap_that_is_called_several_times_a_sample(recording) -> None:
    class Twice(Cart):
        def simulate(self, time, data, parameters, tap):
            return {"speed": np.array([(tap("net", s), tap("net", s))[1] for s in data["push"].tolist()])}

    run = recording(
        {"speed": np.random.default_rng(1).normal(size=len(TIME)), "push": np.sin(TIME)}, TIME, instrument="cart"
    )
    problem = RigProblem([run], Twice("net"))
    drift = next(c for c in problem.candidates if c.key == "drift@net")
    moved = problem.evaluate(np.zeros(1), {}).residual - problem.evaluate(np.zeros(1), {drift: {"rate": 1e-6}}).residual
    assert moved * problem.sigma == pytest.approx(1e-6 * TIME, abs=1e-12)


class Piezo:
    name, channels = "piezo", ("travel",)
    stages: ClassVar = {"charge": "actuator"}
    parameters = (Parameter("gain", "m/V", 1e-7, 1e-5, None, 1e-6, "log"),)

    def simulate(self, time, data, parameters, tap):
        return {"travel": tap("charge", parameters["gain"] * data["voltage"])}


def test_every_recording_begins_in_a_state_of_its_own(recording) -> None:
    """A piezo whose recordings begin at other phases of a sine: no share of the first sample says how it got there."""
    time = np.linspace(0.0, 4.0, 400)
    runs = []
    for k, phase in enumerate((0.0, np.pi / 2, np.pi, 4.0)):
        voltage = 50.0 * np.sin(np.pi * np.r_[time - 8.0, time] + phase)  # two cycles before it is recorded
        drive = 1e-6 * voltage
        loop, stops = np.empty_like(drive), np.zeros(20)
        widths = np.linspace(1e-6, 4e-5, 20)
        for i in range(len(drive)):
            stops = np.clip(stops + (drive[i] - drive[max(i - 1, 0)]), -widths, widths)
            loop[i] = np.mean(stops)
        made = (drive - 0.5 * loop)[400:] + 3e-8 * np.random.default_rng(k).normal(size=400)
        runs.append(recording({"travel": made, "voltage": voltage[400:]}, time, instrument="piezo", name=f"p{k}"))
    problem = RigProblem(runs, Piezo())
    loops = next(c for c in problem.candidates if c.name == "hysteresis")
    assert [p.name for p in loops.parameters if p.name.startswith("initial")] == [f"initial_{k}" for k in (1, 2, 3, 4)]
    null = fit(problem)
    begin = np.array([to_unit(p, p.default) for p in loops.parameters])
    first = fit(problem, (loops,), begin, null.nuisance, 40)
    again = fit(problem, (loops,), first.unit - 0.1 * np.array([p.name == "initial_1" for p in loops.parameters]))
    best = min(first, again, key=lambda f: f.chi2)  # two optima
    assert np.sqrt(np.mean(null.residual**2)) > 30
    assert np.sqrt(np.mean(best.residual**2)) < 4
    found = [v for n, v in loops.values(best.unit).items() if n.startswith("initial")]
    assert max(found) - min(found) > 1e-5  # of up to 5e-5 either way
    alike = {**loops.values(best.unit), **dict.fromkeys([f"initial_{k}" for k in (1, 2, 3, 4)], 0.0)}
    same = problem.evaluate(best.nuisance, {loops: alike}, want_jacobian=False).residual
    assert np.sqrt(np.mean(same**2)) > 2 * np.sqrt(np.mean(best.residual**2))
