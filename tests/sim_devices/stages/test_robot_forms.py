"""Forms of the robot's effects that its stages know: soft limits, stiffening by distance, late fibres, leaking
positions."""

from __future__ import annotations

import numpy as np
import pytest

from sim_devices.chain import FloatArray
from sim_devices.effects import parse_effect
from sim_devices.effects.force_sensor import weighed
from sim_devices.effects.sheet_forces import fibre_force, tension_for_a_while, tension_force, to_and_fro
from sim_devices.stages import nominal
from sim_devices.stages.axes import AxisLoop
from sim_devices.stages.robot import TRANSDUCERS, numbered, xyz
from sim_devices.stages.sheet import Sheet
from sim_devices.stages.tissues import SheetTissue


def _held(limit: float, soft: float, load: float) -> float:
    """Position of an axis, m, that shall stay at zero under ``load`` N."""
    loop = AxisLoop("axes", "actuator", ("target", "load"), ("axis",), force_limit=limit, soft=soft, windup=soft)
    time = np.arange(0, 4, 0.002)
    signals = {"target": np.zeros(len(time)), "load": load * np.minimum(time / 2, 1.0)}
    loop.advance(loop.fresh(), time, signals)
    return float(signals["axis"][-1])


def test_a_soft_limit_still_holds_what_a_hard_one_of_the_same_force_holds_easily() -> None:
    assert abs(_held(1.0, 1.0, 0.5)) < 1e-6
    assert abs(_held(1.0, 0.0, 0.5)) < 1e-6
    assert abs(_held(1.0, 1.0, 1.5)) > 1e-3  # neither holds more than the limit


def test_isotropic_stiffening_is_the_same_in_every_direction() -> None:
    law = SheetTissue((800.0, 600.0, 400.0), angle=0.0, relaxation=(), times=(), softening=0.0, isotropy=1.0)
    time = np.linspace(0, 1, 20)
    ratios = []
    for axis in range(3):
        path = {s: np.zeros(20) for s in xyz("skin")}
        path[xyz("skin")[axis]] = 1e-3 * time
        sheet = Sheet("tissue", "tissue", xyz("skin"), xyz("reaction"), law)
        sheet.advance(sheet.fresh(), time, path)
        ratios.append(path[xyz("reaction")[axis]][-1] / (-law.stiffness[axis] * 1e-3))
    assert ratios == pytest.approx([(1 + (1e-3 / law.length) ** 2) ** law.exponent] * 3)


def test_late_fibres_do_nothing_within_their_slack_and_pull_back_both_ways() -> None:
    x = np.array([-0.9e-3, 0.05e-3, 0.9e-3])
    zero = np.zeros(3)
    fx, fy, fz = fibre_force(zero, zero, zero, zero, x, zero, zero, 500.0, 0.0, 0.4e-3)
    assert fx[0] == pytest.approx(0.25, rel=0.05)
    assert fx[2] == pytest.approx(-0.25, rel=0.05)
    assert abs(fx[1]) < 1e-4  # the knee is a little round
    assert not fy.any()
    assert not fz.any()


def test_tension_for_a_while_is_tension_between_its_moments() -> None:
    time = np.array([0.5, 1.5, 2.5])
    zero, x = np.zeros(3), np.full(3, 1e-3)
    while_it_lasts = tension_for_a_while(time, zero, zero, zero, x, zero, zero, 500.0, 0.3, 1.0, 1.0)
    always = tension_force(time, zero, zero, zero, x, zero, zero, 500.0, 0.3)
    for now, then in zip(while_it_lasts, always, strict=True):
        assert now == pytest.approx(np.array([0.0, then[1], 0.0]), abs=1e-12)


def test_a_rhythm_is_along_its_direction() -> None:
    time, zero = np.linspace(0.0, 2.0, 400), np.zeros(400)
    x, y, z = to_and_fro(time, zero, zero, zero, 2e-3, 1.5, 0.4, np.pi / 6, np.pi / 3, 0.21, 0.21)
    assert y == pytest.approx(x * np.tan(np.pi / 6))
    assert z == pytest.approx(np.hypot(x, y) * np.sign(x) * np.tan(np.pi / 3))
    assert 2e-3 < np.max(np.sqrt(x * x + y * y + z * z)) < 2.6e-3


def test_skin_that_moves_under_a_probe_at_rest_takes_it_along() -> None:
    text = "pulse_breathing:motion=1e-4,form=1,frequency=0.3,phase=0,azimuth=0,elevation=0"
    effect, values = parse_effect(text, "microrobot")
    time = np.arange(0.0, 10.0, 0.01)
    made = effect.apply(nominal("microrobot", tissue="forearm"), values).run(time, _sent(time))
    turn = 2 * np.pi * 0.3 * time
    in_phase, ahead = (2 / len(time) * float(w @ made["reaction_x"]) for w in (np.sin(turn), np.cos(turn)))
    assert 0.5 * 800.0 < np.hypot(in_phase, ahead) / 1e-4 < 1.1 * 840.0  # N/m, less what relaxes
    assert in_phase > 0  # skin that goes to +x pulls the probe along
    assert ahead > 0  # and relaxes


def test_a_rounded_speed_limit_lags_behind_an_abrupt_one() -> None:
    time = np.arange(0.0, 3.0, 0.005)
    halfway = []
    for text in ("span_time=1", "span_time=1,form=1,rounding=5e-5"):
        effect, values = parse_effect(f"slew_limit:{text}", "microrobot")
        made = effect.apply(nominal("microrobot", tissue="open air"), values).run(
            time, _sent(time, 1e-3 * (time > 0.5))
        )
        halfway.append(float(time[np.argmax(made["axis_1"] > 0.5e-3)]))
    assert halfway[1] - halfway[0] == pytest.approx(0.05, abs=0.01)  # a ramp through a low-pass


def test_a_limit_of_the_tip_keeps_it_on_its_way() -> None:
    """At its speed, whatever the direction; limits of axes by themselves bend the way."""
    time = np.arange(0.0, 3.0, 0.005)
    goal = 1e-3 * np.array([0.6, 0.0, 0.8])
    sent = {f"command_{a}": part * (time > 0.5) for a, part in zip("xyz", goal, strict=True)}
    off = []
    for text in ("span_time=1,form=2,rounding=1e-6", "span_time=1"):
        effect, values = parse_effect(f"slew_limit:{text}", "microrobot")
        made = effect.apply(nominal("microrobot", tissue="open air"), values).run(time, sent)
        tip = np.array([made[f"tip_{a}"] for a in "xyz"])
        on_way = goal[:, None] * (goal @ tip) / (goal @ goal)
        off.append(float(np.max(np.linalg.norm(tip - on_way, axis=0))))
        if len(off) == 1:
            speed = np.linalg.norm(np.diff(tip, axis=1), axis=0) / 0.005
            assert np.median(speed[(time[1:] > 0.8) & (time[1:] < 1.3)]) == pytest.approx(1e-3, rel=0.01)
    assert off[0] < 2e-6 < 2e-5 < off[1]


def _sent(time: np.ndarray, z: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Commands of a tip that rests, or goes along z."""
    still = np.zeros(len(time))
    return {"command_x": still, "command_y": still, "command_z": still if z is None else z}


def test_a_position_leaks_into_the_transducer_that_is_named() -> None:
    effect, values = parse_effect("crosstalk:share=0.1,pair=7", "microrobot")
    chain = effect.apply(nominal("microrobot", tissue="open air"), values)
    time = np.arange(0, 1, 0.01)
    given = {name: np.full(len(time), 1e-3 * (k == 1)) for k, name in enumerate(numbered("axis"))}
    made = chain.run(time, {**dict.fromkeys(xyz("command"), np.zeros(len(time))), **given})
    means = [float(np.mean(made[t])) for t in TRANSDUCERS]
    assert means == pytest.approx([0.1, 0.0, 0.0], abs=5e-3)


def _moved(time: FloatArray, target: FloatArray, **parameters: float) -> FloatArray:
    """An axis, m, whose loop follows a target (n,) m with these parameters."""
    loop = AxisLoop("axes", "actuator", ("target", "load"), ("axis",), **parameters)
    signals = {"target": target}
    loop.advance(loop.fresh(), time, signals)
    return signals["axis"]


def test_a_force_in_proportion_to_the_targets_speed_counts_against_the_limit() -> None:
    """A coil of 0.3 N on 60 g follows a target of 50 mm/s no sooner than 5 m/s² can."""
    time = np.arange(0.0, 0.04, 0.001)
    target = 0.05 * time
    reached = _moved(time, target, force_limit=0.3, fed=15.0)[10]
    most = 0.5 * 5.0 * time[10] ** 2
    assert 0.8 * most < reached < 1.01 * most
    assert _moved(time, target, fed=15.0)[10] > 1.2 * most


def test_a_coils_force_that_is_late_moves_an_axis_as_a_delay_in_the_loop_does() -> None:
    """Against a PID loop, integrated in steps of 10 µs, whose force is that of 0.3 ms ago: first the axis lags, then
    it catches up; a target that steps, and one that is a sine."""
    lag, h, m, p = 3e-4, 1e-5, 0.060, 100.0
    fine = np.arange(0.0, 0.15, h)
    # Nodes a µs apart where the target steps.
    time = np.sort(np.append(fine[::100], 0.02 - 1e-6))
    for target in (lambda t: np.where(t >= 0.02, 3e-4, 0.0), lambda t: 5e-4 * np.sin(40.0 * t) ** 2):
        force, (x, v, integral) = np.zeros(len(fine)), (0.0, 0.0, 0.0)
        true = np.zeros(len(fine))
        for i, r in enumerate(target(fine)):
            force[i] = 3 * m * p**2 * (r - x) + m * p**3 * integral - 3 * m * p * v
            integral += h * (r - x)
            v += h / m * (force[i - round(lag / h)] if i * h > lag else 0.0)
            x += h * v
            true[i] = x
        prompt, late = (np.interp(fine, time, _moved(time, target(time), lag=t)) for t in (0.0, lag))
        worst = np.max(np.abs(prompt - true)[::100])
        assert worst > 1e-6
        assert np.max(np.abs(late - true)[::100]) < 0.3 * worst


def test_dry_friction_that_is_higher_near_standstill_may_be_of_one_axis() -> None:
    effect, values = parse_effect("stribeck_friction:axis=3,stiction=0.2", "microrobot")
    loop = effect.apply(nominal("microrobot"), values)["axes"]
    assert isinstance(loop, AxisLoop)
    assert (loop.alone, loop.stiction) == (3, 0.2)


def test_the_heads_weight_turns_in_the_axes_of_the_platform() -> None:
    """Its parts are those of a rotation of the platform's axes, less the weight that was tared on the level one."""
    gx, gy, rho, weight = 0.06, -0.04, 0.03, 0.5
    x, y = np.array([1.0, 0.0, gx]), np.array([0.0, 1.0, gy])
    normal = np.cross(x, y)
    normal /= np.linalg.norm(normal)
    heights = [gx * rho * np.cos(t) + gy * rho * np.sin(t) for t in (0.0, 2 * np.pi / 3, 4 * np.pi / 3)]
    nothing = np.zeros(1)
    made = np.ravel(weighed(nothing, nothing, nothing, nothing, *(np.array([h]) for h in heights), weight, rho))
    axes = (x / np.linalg.norm(x), y / np.linalg.norm(y), normal)
    expected = weight * np.array([axis[2] for axis in axes]) - [0.0, 0.0, weight]
    np.testing.assert_allclose(made, expected, rtol=2e-3)
