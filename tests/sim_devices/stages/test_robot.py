"""The nominal robot chain: published ranges, the loop through the tissue, recorded inputs."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from drivers.microrobot import forces, kinematics
from sim_devices.chain import FloatArray, Runner, Signals
from sim_devices.stages import noisy, nominal, runner
from sim_devices.stages.axes import LOOP_RATE, MASS, AxisLoop
from sim_devices.stages.kernels import evaluate, low_pass
from sim_devices.stages.robot import TRANSDUCERS, closed_loop, numbered, xyz
from sim_devices.stages.sheet import Glue, Sheet
from sim_devices.stages.tissues import SHEET, SheetTissue

TIME = np.arange(0.0, 30.0, 0.01)
TRIANGLE = 1.3e-3 * (1 - np.abs((TIME / 10 % 1) * 2 - 1))


def command(direction: str, wave: FloatArray = TRIANGLE) -> Signals:
    return {name: wave if name.endswith(direction) else np.zeros(len(wave)) for name in xyz("command")}


def stacked(signals: Signals, names: tuple[str, ...]) -> FloatArray:
    return np.stack([signals[n] for n in names], axis=-1)


@pytest.mark.parametrize("tissue", [*SHEET])
def test_forces_and_losses_lie_in_the_published_ranges(tissue: str) -> None:
    for direction in "xy":
        out = closed_loop(nominal("microrobot", tissue=tissue), TIME, command(direction))
        force, probe = -out[f"force_{direction}"], out[f"probe_{direction}"]
        assert 0.5 <= force.max() <= 1.2
        up, cycle = (TIME >= 20) & (TIME <= 25), TIME >= 20
        loss = np.trapezoid(force[cycle], probe[cycle]) / np.trapezoid(force[up], probe[up])
        assert 0.12 <= loss <= 0.34
        first, second, third = (force[(a <= TIME) & (a + 10 > TIME)].max() for a in (0, 10, 20))
        assert first > second > 0.97 * third, "preconditioned after one cycle"
        assert 0.85 < third / first < 1.0


def test_tracking_is_good_and_off_axis_motion_small() -> None:
    out = closed_loop(nominal("microrobot"), TIME, command("x"))
    assert np.abs(out["probe_x"] - TRIANGLE).max() < 10e-6
    assert np.abs(out["probe_y"]).max() < 10e-6


def test_processed_signals_are_what_the_drivers_compute() -> None:
    out = closed_loop(nominal("microrobot"), TIME, command("y"))
    np.testing.assert_allclose(
        stacked(out, xyz("probe")), kinematics.forward(stacked(out, numbered("axis_position"))), atol=1e-15
    )
    np.testing.assert_allclose(stacked(out, xyz("force")), forces.reaction(stacked(out, TRANSDUCERS)), atol=1e-12)
    np.testing.assert_allclose(stacked(out, xyz("force")), stacked(out, xyz("reaction")), atol=1e-12)


def test_streaming_and_session_agree() -> None:
    time = np.arange(0.0, 6.0, 0.001)
    wave = np.interp(time, TIME, TRIANGLE)
    chain = nominal("microrobot")
    whole = closed_loop(chain, time, command("x", wave), tolerance=1e-7)
    stream = runner(chain)
    parts = [
        stream.advance(time[a : a + 50], {k: v[a : a + 50] for k, v in command("x", wave).items()})
        for a in range(0, len(time), 50)
    ]
    for name, atol in (("force_x", 1e-3), ("probe_x", 2e-6)):
        np.testing.assert_allclose(np.concatenate([p[name] for p in parts]), whole[name], atol=atol)


def test_chunks_with_given_load_join_without_a_seam() -> None:
    chain = noisy(nominal("microrobot", latency=0.003).tuned("axes", coulomb=0.1, presliding=20e-6), seed=1)
    inputs = {**command("x"), **{n: 0.2 * np.sin(TIME + i) for i, n in enumerate(numbered("load"))}}
    whole = chain.run(TIME, inputs)
    stream = Runner(chain)
    cuts = [0, 1, 3, 500, 501, 1700, len(TIME)]
    parts = [stream.advance(TIME[a:b], {k: v[a:b] for k, v in inputs.items()}) for a, b in itertools.pairwise(cuts)]
    for name in whole:
        np.testing.assert_allclose(np.concatenate([p[name] for p in parts]), whole[name], rtol=1e-7, atol=1e-10)


def test_recorded_axis_positions_replace_the_actuator() -> None:
    chain = nominal("microrobot")
    out = closed_loop(chain, TIME, command("x"))
    given = {n: out[n] for n in numbered("axis")}
    names = [op.name for op in Runner(chain, given=list(given))._operators]
    assert names[0] == "platform"
    again = chain.run(TIME, given)
    np.testing.assert_allclose(again["force_x"], out["force_x"], atol=1e-12)


@pytest.mark.parametrize("kind", ["step", "load"])
def test_axis_loop_against_its_transfer_function(kind: str) -> None:
    """Step of target or load: partial fractions of the triple pole at -p."""
    time = np.concatenate([[0.0, 1e-9], np.sort(np.random.default_rng(0).uniform(0.001, 0.3, 60))])
    step = np.where(time > 0, 1.0, 0.0)
    loop = AxisLoop("axes", "actuator", ("target_1", "load_1"), ("axis_1",))
    signals = {
        "target_1": 1e-3 * step if kind == "step" else 0 * step,
        "load_1": 0.5 * step if kind == "load" else 0 * step,
    }
    loop.advance(loop.fresh(), time, signals)
    p, a = LOOP_RATE, LOOP_RATE * time
    if kind == "step":  # x/r = (3 p² s + p³) / (s + p)³, derivative on the measurement
        expected = 1e-3 * (1 - np.exp(-a) * (1 + a - a**2))
    else:  # x/F = (s / m) / (s + p)³
        expected = 0.5 / MASS * 0.5 * time**2 * np.exp(-p * time)
    np.testing.assert_allclose(signals["axis_1"], expected, atol=2e-10)


def test_dry_friction_sticks_and_costs_the_right_force() -> None:
    time = np.arange(0.0, 4.0, 0.01)
    loop = AxisLoop("axes", "actuator", ("target_1", "load_1"), ("axis_1",), coulomb=0.3)
    push = 0.2 * np.sin(2 * np.pi * time)  # never breaks away
    signals = {"target_1": np.zeros(len(time)), "load_1": push}
    loop.advance(loop.fresh(), time, signals)
    assert np.abs(signals["axis_1"]).max() < 1e-8


@pytest.mark.parametrize("rubbing", [{"coulomb": 0.1}, {"coulomb": 0.1, "presliding": 1e-5}])
def test_long_steps_of_steady_friction_are_as_good_as_short_ones(rubbing: dict[str, float]) -> None:
    loop = AxisLoop("axes", "actuator", ("target_1", "load_1"), ("axis_1",), **rubbing)
    corners = np.array([0.0, 0.5, 1.0, 1.6, 2.4, 3.0])
    after = np.concatenate([np.arange(0, 0.1, 0.004), np.arange(0.1, 0.8, 0.04)])
    coarse = np.unique(np.concatenate([c + after[after < 0.8] for c in corners] + [corners, corners + 1e-6]))
    there = []
    for time in (coarse, np.union1d(coarse, np.arange(0.0, 3.6, 2.5e-4))):
        to_and_fro = np.interp(time, corners, 1e-3 * np.array([0, 0, 1, 1, -0.5, -0.5]))
        signals = {"target_1": to_and_fro, "load_1": 0.02 * np.sin(2 * np.pi * time)}
        loop.advance(loop.fresh(), time, signals)
        there.append(np.interp(coarse, time, signals["axis_1"]))
    np.testing.assert_allclose(there[0], there[1], atol=1e-6)


def test_the_tissue_has_a_potential_and_the_glue_yields() -> None:
    still = {**command("x", np.zeros(2)), **dict.fromkeys(numbered("load"), np.zeros(2))}
    chain = nominal("microrobot")

    def elastic(u: FloatArray, glue: Glue = Glue()) -> FloatArray:
        inputs = {**still, **{n: np.array([0.0, c]) for n, c in zip(xyz("tip"), u, strict=True)}}
        out = chain.tuned("tissue", glue=glue).run(np.array([0.0, 1e-9]), inputs)
        return stacked(out, xyz("reaction"))[-1]

    u, step = np.array([0.8e-3, -0.4e-3, 0.5e-3]), 1e-7
    slope = np.stack([(elastic(u + step * e) - elastic(u - step * e)) / (2 * step) for e in np.eye(3)])
    np.testing.assert_allclose(slope, slope.T, atol=0.05)
    glue = np.array([2e-4, 2e-4, 1e-4])
    reaction = elastic(u, Glue(2e-4, 1e-4))
    np.testing.assert_allclose(elastic(u + glue * reaction), reaction, atol=1e-6)


@pytest.mark.parametrize("windup", [0.0, 1.0])
def test_coils_at_their_limit_are_still_stopped_by_the_tissue(windup: float) -> None:
    chain = nominal("microrobot").tuned("axes", force_limit=0.25, windup=windup)
    time = TIME[:1200]
    out = closed_loop(chain, time, command("x", TRIANGLE[:1200]))
    assert 0.5e-3 < np.abs(out["tip_x"]).max() < 1.2e-3
    assert np.abs(out["axis_load_1"]).max() < 0.26
    fine = np.arange(0, 4, 0.004)
    inputs = command("x", np.interp(fine, TIME, TRIANGLE))
    whole = runner(chain).advance(fine, inputs)
    stream = runner(chain)
    parts = [
        stream.advance(fine[a : a + 90], {k: v[a : a + 90] for k, v in inputs.items()}) for a in range(0, 1000, 90)
    ]
    np.testing.assert_allclose(np.concatenate([p["force_x"] for p in parts]), whole["force_x"], rtol=1e-7, atol=1e-9)


def test_a_sheet_tells_grids_and_times_of_memory_apart() -> None:
    """Weights of steps are kept from run to run: neither another grid of as many nodes nor another time gets them."""
    grid = np.linspace(0.0, 4.0, 201)
    other = 4.0 * np.linspace(0.0, 1.0, 201) ** 2
    path = {f"skin_{a}": 1e-3 * np.sin(grid) for a in "xyz"}

    def force(time: FloatArray, tau: float) -> FloatArray:
        skin = SheetTissue((800.0, 600.0, 500.0), relaxation=(0.3,), times=(tau,), softening=0.0, exponent=0.0, angle=0)
        signals = dict(path)
        sheet = Sheet("tissue", "tissue", xyz("skin"), xyz("reaction"), skin)
        sheet.advance(sheet.fresh(), time, signals)
        return signals["reaction_x"]

    for time, tau in ((grid, 0.5), (other, 0.5), (grid, 2.0), (grid, 0.5)):
        elastic = -800.0 * path["skin_x"]
        assert force(time, tau) == pytest.approx(elastic - 0.3 * evaluate(low_pass, time, elastic, tau), abs=1e-12)
