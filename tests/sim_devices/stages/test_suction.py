"""The nominal suction chains: published ranges, seams, smooth latency, recorded inputs."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from sim_devices.chain import Runner
from sim_devices.effects import effects, variants
from sim_devices.stages import noisy, nominal
from sim_devices.stages.operators import Delay
from sim_devices.stages.sampling import Table, mean_before, sampled, simulate, time_grid
from sim_devices.stages.specimens import meets

STAMPS = np.arange(0.0, 20.0, 0.01)


def steps(level: float) -> Table:
    """Suction of ``level`` Pa from 1 to 11 s and from 13 to 18 s."""
    time = np.array([0.0, 1, 1, 11, 11, 13, 13, 18, 18, 20])
    return time, -level * np.array([0.0, 0, 1, 1, 0, 0, 1, 1, 0, 0])


@pytest.mark.parametrize(
    ("instrument", "level", "lowest", "highest"),
    [
        ("cutometer", 15e3, 0.1e-3, 0.3e-3),
        ("cutometer", 45e3, 0.2e-3, 0.65e-3),
        ("aspiration", 20e3, 1e-3, 4e-3),
    ],
)
@pytest.mark.parametrize("tissue", ["forearm", "face", "cheek"])
def test_heights_lie_in_the_published_ranges(
    instrument: str, level: float, lowest: float, highest: float, tissue: str
) -> None:
    chain = nominal(instrument, tissue=tissue)
    height = simulate(chain, {"pressure": steps(level)}, {"apex_height": STAMPS})["apex_height"]
    assert lowest <= height.max() <= highest
    first, second = height[(STAMPS > 1) & (STAMPS < 11)].max(), height[(STAMPS > 13) & (STAMPS < 18)].max()
    assert first < second * 1.05, "a second curve is softer, or at least not stiffer"
    assert 0 < height[1299] < 0.3 * first, "some height remains after release"


def test_rigid_block_and_open_air_do_not_rise() -> None:
    for name in ("rigid block", "open air"):
        out = simulate(nominal("cutometer", tissue=name), {"pressure": steps(45e3)}, {"apex_height": STAMPS})
        assert np.abs(out["apex_height"]).max() < 1e-8


def test_unknown_tissue_and_instrument_are_named() -> None:
    with pytest.raises(ValueError, match="no tissue 'elbow'; there are forearm"):
        nominal("cutometer", tissue="elbow")
    with pytest.raises(ValueError, match="no instrument 'ruler'"):
        nominal("ruler")


@pytest.mark.parametrize("instrument", ["cutometer", "aspiration"])
def test_chunks_join_without_a_seam(instrument: str) -> None:
    chain = noisy(nominal(instrument, latency=0.013, marks=(12.5,)), seed=4)
    delay = chain["latency"]
    assert isinstance(delay, Delay)
    grid = time_grid(steps(30e3)[0], [STAMPS], delays=[delay])
    command = np.interp(grid, *steps(30e3))
    whole = chain.run(grid, {"command_pressure": command})
    runner = Runner(chain)
    cuts = [0, 1, 2, 90, 400, 401, 1200, len(grid)]
    parts = [runner.advance(grid[a:b], {"command_pressure": command[a:b]}) for a, b in itertools.pairwise(cuts)]
    for name in whole:
        np.testing.assert_allclose(np.concatenate([p[name] for p in parts]), whole[name], rtol=1e-9, atol=1e-12)


def test_results_depend_smoothly_on_latency() -> None:
    latencies = np.linspace(0.0101, 0.0199, 25)
    values = np.array(
        [
            simulate(nominal("cutometer", latency=d), {"pressure": steps(30e3)}, {"pressure": STAMPS})["pressure"][105]
            for d in latencies
        ]
    )
    curvature = np.diff(values, 2)
    assert np.abs(np.diff(curvature)).max() < 0.02 * np.abs(np.diff(values)).max()


def test_the_grid_step_hardly_matters() -> None:
    chain = nominal("cutometer")
    fine = simulate(chain, {"pressure": steps(40e3)}, {"apex_height": STAMPS}, step=0.0005)["apex_height"]
    coarse = simulate(chain, {"pressure": steps(40e3)}, {"apex_height": STAMPS[::10]})["apex_height"]
    assert np.abs(coarse - fine[::10]).max() < 2e-7


def test_a_stage_runs_on_its_recorded_input() -> None:
    chain = nominal("cutometer")
    commands = {"pressure": steps(40e3)}
    stamps = {"apex_height": STAMPS, "line_pressure": STAMPS}
    full = simulate(chain, commands, stamps)
    doubled = simulate(
        chain, commands, {"apex_height": STAMPS}, given={"line_pressure": (STAMPS, 0.5 * full["line_pressure"])}
    )
    assert 0.5 < doubled["apex_height"].max() / full["apex_height"].max() < 0.8
    running = [op.name for op in Runner(chain, given=["line_pressure"])._operators]
    assert "regulator" not in running
    assert "command_resolution" not in running
    assert "latency" in running, "the zeroing still needs the due pressure"


def test_height_is_zeroed_when_each_recording_starts() -> None:
    stamps = {"apex_height": STAMPS}
    once = simulate(nominal("cutometer"), {"pressure": steps(40e3)}, stamps)["apex_height"]
    twice = simulate(nominal("cutometer", marks=(12.0,)), {"pressure": steps(40e3)}, stamps)["apex_height"]
    np.testing.assert_allclose(twice[:1200], once[:1200])
    assert once[1300] > 1e-6
    assert twice[1300] == pytest.approx(0.0, abs=1e-12)


def test_a_command_that_is_looked_at_seldom_acts_at_the_next_look() -> None:
    effect = effects("cutometer")["latency"]
    chain = effect.apply(nominal("cutometer"), {"form": 1, "interval": 0.5, "phase": 0.2})
    grid = np.arange(0.0, 6.0, 0.01)
    due = chain.run(grid, {"command_pressure": np.where(grid >= 1.0, -10e3, 0.0)})["line_pressure"]
    began = grid[np.flatnonzero(due < -1.0)[0]]
    assert 1.1 <= began < 1.13


def test_a_ramp_that_is_looked_at_now_and_then_is_a_staircase() -> None:
    """However sparse the stamps are: looks in a ramp are no kinks of the command, and were lost between nodes."""
    ramps = {"pressure": (np.array([0.0, 1, 10, 13, 20]), -3e4 * np.array([0.0, 0, 1, 1, 0]))}
    sparse = np.array([2.3, 4.41, 7.77, 9.6, 14.2, 15.55, 18.8])
    made = []
    for form in (1, 2):
        chain = nominal("cutometer", marks=(0.0, 12.05))
        chain = effects("cutometer")["latency"].apply(chain, {"form": form, "interval": 0.2, "phase": 0.35})
        made.append(simulate(chain, ramps, {"pressure": STAMPS}, step=1e-3)["pressure"])
        here = simulate(chain, ramps, {"pressure": sparse})["pressure"]
        np.testing.assert_allclose(here, np.interp(sparse, STAMPS, made[-1]), atol=1.0)
    assert np.array_equal(made[0][STAMPS < 12.0], made[1][STAMPS < 12.0])
    # By intervals that begin anew at 12.05 s, each look is 50 ms later: so much of a ramp.
    assert np.max(np.abs(made[0] - made[1])[STAMPS > 13.0]) > 200.0


def test_a_zero_may_be_late_between_samples_or_a_mean_that_is_taken_off_at_once() -> None:
    stamps = {"apex_height": STAMPS}
    table = {"pressure": steps(40e3)}
    plain = simulate(nominal("cutometer"), table, stamps)["apex_height"]
    zeroing = effects("cutometer")["wrong_zeroing"]
    zeros = []
    for delay in (0.0503, 0.0505, 0.0507):  # s; nodes are a millisecond apart
        late = simulate(zeroing.apply(nominal("cutometer"), {"delay": delay}), table, stamps)["apex_height"]
        zeros.append(plain[300] - late[300])
    assert zeros[0] < zeros[1] < zeros[2]
    mean = simulate(zeroing.apply(nominal("cutometer"), {"delay": 0.05, "form": 2}), table, stamps)["apex_height"]
    off = plain - mean
    first = int(np.flatnonzero(off > 1e-9)[0])
    np.testing.assert_allclose(off[first : first + 1000], off[first], atol=1e-12)  # at once, and for the whole suction
    assert 0 < off[first] < zeros[0]


def test_a_probe_that_is_tipped_flat_stays_so_until_it_is_put_on_again() -> None:
    tilt = effects("cutometer")["probe_tilt"]
    block = tilt.apply(
        nominal("cutometer", tissue="rigid block", marks=(12.0,)), {"form": 1, "angle": 0.01, "seat": 2e3}
    )
    time, value = steps(20e3)
    again = np.concatenate([time, time + 12.0]), np.concatenate([value, value])
    height = simulate(block, {"pressure": again}, {"apex_height": np.arange(0, 24, 0.01)})["apex_height"]
    vented = height[1150]
    assert vented == pytest.approx(50e-6, rel=0.01)  # 0.01 rad at 5 mm, flat by ten times the suction it takes
    assert abs(height[1205]) < 1e-9
    assert height[2350] == pytest.approx(vented, rel=1e-3)


@pytest.mark.parametrize(("form", "shows"), [(0, False), (1, True)])
def test_a_probe_is_tipped_flat_on_whatever_it_stands(form: int, shows: bool) -> None:
    """Blocks that rose by 80 µm as the probe tipped left an effect of 189 sigma unknown."""
    tilt = variants(effects("cutometer")["probe_tilt"])[f"probe_tilt[form={form}]"]
    assert meets(tilt, "rigid block") is shows
    assert meets(tilt, "reference membrane")


def test_averaged_samples_are_means_of_the_window_before() -> None:
    time = np.sort(np.random.default_rng(2).uniform(0, 3, 400))
    signal = np.sin(5 * time)
    stamps = np.linspace(0.5, 2.5, 40)
    fine = np.linspace(-0.2, 0.0, 20_001)
    expected = [np.interp(t + fine, time, signal).mean() for t in stamps]
    out = sampled(time, {"pressure": signal}, {"pressure": stamps}, {"pressure": 0.2})
    np.testing.assert_allclose(out["pressure"], expected, atol=2e-5)
    constant = mean_before(np.array([0.0, 1.0]), np.array([3.0, 3.0]), np.array([-5.0, 0.05, 9.0]), 0.1)
    np.testing.assert_allclose(constant, 3.0)


def test_an_armed_loop_begins_with_its_integral_empty() -> None:
    """Also in parts, and where one begins after it was armed: the second suction is answered as the first."""
    valve = (0.3, 1.0, 0.4, 0.5, 0.2, np.inf, 0.0, 0.0, 0.0)
    time = np.arange(0.0, 40.0, 0.01)
    asked = {"command_pressure": -20e3 * (((time > 2.0) & (time < 8.0)) | ((time > 22.0) & (time < 28.0)))}
    loops = {
        armed: nominal("cutometer").tuned("regulator", valve=valve, highest=0.0, armed=armed) for armed in ((), (20.0,))
    }
    line = {armed: loop.run(time, asked)["line_pressure"] for armed, loop in loops.items()}
    first, second = time < 20.0, time >= 20.0
    np.testing.assert_allclose(line[20.0,][second], line[20.0,][first], atol=1e-6)
    assert np.max(np.abs(line[()][second] - line[()][first])) > 300.0
    stream = Runner(loops[20.0,])
    parts = [
        stream.advance(time[a : a + 300], {k: v[a : a + 300] for k, v in asked.items()}) for a in range(0, 4000, 300)
    ]
    np.testing.assert_allclose(np.concatenate([p["line_pressure"] for p in parts]), line[20.0,], atol=1e-6)


def test_crosstalk_that_bends_grows_ever_less_as_suction_does() -> None:
    effect = effects("cutometer")["crosstalk"]
    values = {p.name: p.default for p in effect.parameters} | {"form": 3.0, "amount": 20e-6, "knee": 20e3}
    read = []
    for level in (15e3, 30e3, 45e3):
        chain = effect.apply(nominal("cutometer", tissue="rigid block"), values)
        height = simulate(chain, {"pressure": steps(level)}, {"apex_height": STAMPS})["apex_height"]
        read.append(float(np.median(height[(STAMPS > 5) & (STAMPS < 10)])))
    np.testing.assert_allclose(read, 20e-6 * np.tanh([0.75, 1.5, 2.25]) / np.tanh(1.5), rtol=0.01)


@pytest.mark.parametrize(("form", "axis"), [(0, 0.0), (1, 1e-3)])
def test_a_lens_distorts_about_its_axis_and_not_at_rest(form: int, axis: float) -> None:
    effect, sound = effects("aspiration")["lens_distortion"], nominal("aspiration")
    values = {p.name: p.default for p in effect.parameters} | {"form": float(form), "coefficient": 0.1, "axis": 1e-3}
    seen, true = (
        simulate(chain, {"pressure": steps(20e3)}, {"apex_height": STAMPS})["apex_height"]
        for chain in (effect.apply(sound, values), sound)
    )
    np.testing.assert_allclose(seen - true, 0.1 / 2e-3**2 * ((true - axis) ** 3 + axis**3), atol=1e-8)
    assert abs(seen[50] - true[50]) < 1e-9
