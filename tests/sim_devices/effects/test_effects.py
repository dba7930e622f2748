"""Each effect: nothing at its null, something at its default, no seam between chunks, finite all over its prior."""

from __future__ import annotations

import functools
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_devices.chain import Chain, Effect, FloatArray, Parameter, Runner, Signals
from sim_devices.effects import effects, variants
from sim_devices.effects.build import CHOICE
from sim_devices.stages import INSTRUMENTS, laws, noisy, nominal
from sim_devices.stages.robot import LOAD, TRANSDUCERS, numbered, xyz
from sim_devices.stages.sampling import time_grid

CASES = [pytest.param(i, e, id=f"{i}-{e.name}") for i in INSTRUMENTS for e in effects(i).values()]
MEASURED = {
    "cutometer": ("pressure", "apex_height"),
    "aspiration": ("pressure", "apex_height"),
    "microrobot": (*numbered("axis_position"), *TRANSDUCERS, *xyz("probe"), *xyz("force")),
}
FLOOR = {"pressure": 1.0, "apex_height": 1e-7, "axis": 1e-8, "transducer": 1e-5, "probe": 1e-8, "force": 1e-5}
"""Changes that count, per channel: far below any noise."""
STEPWISE = ("overshoot", "late_samples", "dropped_samples", "wrong_zeroing")
"""Effects whose strength is logarithmic or a count, so that they have no small form."""
UNHELD = ("force_saturation", "integral_windup", "stribeck_friction")
"""With a given load nothing holds an axis whose coil is at its limit, and one that sticks and slips multiplies what is
rounded; both are tested with the stages."""


@functools.cache
def session(instrument: str) -> tuple[FloatArray, Signals, Chain]:
    """Two recordings of a session, 5 minutes apart: time, inputs, nominal chain."""
    marks = (0.0, 320.0)
    if instrument == "microrobot":
        time = np.concatenate([np.arange(0, 12, 0.02), np.arange(320, 332, 0.02)])
        wave = 1.3e-3 * np.interp(time % 320, [0, 1, 3, 5, 7, 9], [0, 0, 1, -0.2, 0.8, 0])
        load = {name: 0.3 * (i - 1) * wave / 1.3e-3 for i, name in enumerate(LOAD)}
        commands = dict(zip(xyz("command"), (0.8 * wave, 0.5 * wave, 0.3 * wave), strict=True))
        return time, {**commands, **load}, nominal(instrument, marks=marks)
    level = 40e3 if instrument == "cutometer" else 20e3
    kinks = np.array([1.0, 6, 8, 9, 10, 11])
    shape = np.array([1.0, 0, 0.7, 0.7, 0.7, 0])  # of a table with steps at 1, 6 and 8 s and a ramp from 10 to 11 s
    table = np.concatenate([np.repeat(kinks, 2), 320 + np.repeat(kinks, 2)])
    before = np.array([0.0, 1, 0, 0.7, 0.7, 0])
    values = np.tile(np.column_stack([before, shape]).ravel(), 2)
    stamps = [np.concatenate([np.arange(0, 14, 0.02), np.arange(320, 334, 0.02)])]
    time = time_grid(table, stamps)
    return time, {"command_pressure": -level * np.interp(time, table, values)}, nominal(instrument, marks=marks)


@functools.cache
def reference(instrument: str) -> Signals:
    time, inputs, chain = session(instrument)
    return chain.run(time, inputs)


def changed(instrument: str, out: Signals) -> list[str]:
    """Measured channels that differ from nominal."""
    return [n for n in MEASURED[instrument] if np.abs(out[n] - reference(instrument)[n]).max() > floor(n)]


def quantile(p: Parameter, u: float) -> float:
    return p.low * (p.high / p.low) ** u if p.scale == "log" else p.low + u * (p.high - p.low)


def floor(channel: str) -> float:
    return FLOOR.get(channel) or FLOOR[channel.split("_")[0]]


@pytest.mark.parametrize(("instrument", "effect"), CASES)
def test_nothing_changes_at_the_null_values(instrument: str, effect: Effect) -> None:
    _time, _inputs, chain = session(instrument)
    nothing = {p.name: p.null for p in effect.parameters if p.null is not None}
    assert effect.apply(chain, nothing) == chain


@pytest.mark.parametrize(("instrument", "effect"), [c for c in CASES if c.values[1].name not in STEPWISE])
def test_a_tiny_strength_is_a_tiny_change(instrument: str, effect: Effect) -> None:
    time, inputs, chain = session(instrument)
    tiny = {p.name: p.null + 1e-7 * (p.default - p.null) for p in effect.parameters if p.null is not None}
    tiny |= {p.name: p.null * (1 - 1e-9) for p in effect.parameters if p.null is not None and p.null == p.high}
    out = effect.apply(chain, tiny).run(time, inputs)
    for name in MEASURED[instrument]:
        # A mean, as next to a jump of the command a sample may change wholly; the jump may move by a node of the grid.
        mean = np.trapezoid(np.abs(out[name] - reference(instrument)[name]), time) / (time[-1] - time[0])
        assert mean <= floor(name) * (10.0 if effect.stage == "timing" else 1.0), name


@pytest.mark.parametrize(("instrument", "effect"), CASES)
def test_the_default_shows_and_chunks_join_without_a_seam(instrument: str, effect: Effect) -> None:
    time, inputs, chain = session(instrument)
    chain = effect.apply(chain)
    whole = chain.run(time, inputs)
    assert changed(instrument, whole), "the default strength is visible in a measured channel"
    if effect.name in UNHELD:
        return
    runner = Runner(chain)
    cuts = [0, 1, 2, 77, len(time) // 2 - 3, len(time) // 2 + 5, len(time)]
    parts = [runner.advance(time[a:b], {k: v[a:b] for k, v in inputs.items()}) for a, b in itertools.pairwise(cuts)]
    for name in MEASURED[instrument]:
        scale = np.abs(whole[name]).max()
        np.testing.assert_allclose(np.concatenate([p[name] for p in parts]), whole[name], atol=1e-8 * scale)


@pytest.mark.parametrize(("instrument", "effect"), CASES)
@settings(max_examples=6, deadline=None)
@given(data=st.data())
def test_outputs_are_finite_all_over_the_prior(instrument: str, effect: Effect, data: st.DataObject) -> None:
    time, inputs, chain = session(instrument)
    values = {}
    for p in effect.parameters:
        u = data.draw(st.sampled_from([0, 1000]) | st.integers(0, 1000), label=p.name) / 1000
        values[p.name] = quantile(p, u)
        if p.unit == CHOICE:
            values[p.name] = float(round(values[p.name]))
    out = effect.apply(chain, values).run(time, inputs)
    for name in MEASURED[instrument]:
        assert np.isfinite(out[name]).all(), (name, values)


@pytest.mark.parametrize("instrument", INSTRUMENTS)
def test_effects_combine_in_any_order(instrument: str) -> None:
    time, inputs, chain = session(instrument)
    everything = list(effects(instrument).values())
    for order in (everything, everything[::-1]):
        combined = chain
        for effect in order:
            combined = effect.apply(combined)
        out = combined.run(time, inputs)
        assert all(np.isfinite(out[name]).all() for name in MEASURED[instrument])


@pytest.mark.parametrize(
    ("name", "channels"),
    [
        ("gauge_offset", ["pressure", "apex_height"]),  # vented, it shows
        ("rim_leak", ["apex_height"]),
        ("leak", ["pressure", "apex_height"]),
        ("sensor_gain", ["apex_height"]),
        ("slow_creep", ["apex_height"]),
    ],
)
def test_effects_show_where_they_should(name: str, channels: list[str]) -> None:
    time, inputs, chain = session("cutometer")
    assert changed("cutometer", effects("cutometer")[name].apply(chain).run(time, inputs)) == channels


@pytest.mark.parametrize(
    "name", ["latency", "regulator_lag", "leak", "reservoir_depletion", "slew_limit", "overshoot", "dead_band"]
)
def test_actuator_effects_leave_a_recorded_line_pressure_alone(name: str) -> None:
    time, inputs, chain = session("cutometer")
    recorded = {"line_pressure": 0.9 * reference("cutometer")["line_pressure"], **inputs}
    expected = chain.run(time, recorded)
    out = effects("cutometer")[name].apply(chain).run(time, recorded)
    np.testing.assert_array_equal(out["pressure"], expected["pressure"])
    np.testing.assert_array_equal(out["bulge"], expected["bulge"])


@pytest.mark.parametrize(("instrument", "effect"), CASES)
def test_noise_may_be_switched_on_before_or_after(instrument: str, effect: Effect) -> None:
    chain = nominal(instrument)
    assert noisy(effect.apply(chain), 5) == effect.apply(noisy(chain, 5))


def test_dropped_samples_repeat_noise_and_all() -> None:
    time, inputs, _ = session("cutometer")
    stamps = np.arange(0, 14, 0.01)
    chain = effects("cutometer")["dropped_samples"].apply(noisy(nominal("cutometer"), 5))
    pressure = chain.run(stamps, {"command_pressure": np.interp(stamps, time, inputs["command_pressure"])})["pressure"]
    hold = (stamps > 2) & (stamps < 6)
    assert 0.05 < np.mean(np.diff(pressure[hold]) == 0) < 0.3


def test_a_burst_moves_up_what_follows_in_its_recording_alone() -> None:
    time, inputs, chain = session("cutometer")
    lost = {"form": 3, "lost": 0.5, "moment": 5.0}
    height = effects("cutometer")["dropped_samples"].apply(chain, lost).run(time, inputs)["apex_height"]
    nominal_height = reference("cutometer")["apex_height"]
    inside, behind = (time >= 5.0) & (time < 13.0), time >= 320.0
    np.testing.assert_array_equal(height[time < 5.0], nominal_height[time < 5.0])
    np.testing.assert_allclose(height[inside], np.interp(time[inside] + 0.5, time, nominal_height))
    np.testing.assert_array_equal(height[behind], nominal_height[behind])


@pytest.mark.parametrize(("name", "size"), [("illumination_drift", "change"), ("sensor_drift", "amount")])
def test_what_is_switched_on_with_every_recording_warms_up_in_each(name: str, size: str) -> None:
    """A drift over the session begins once: no form could follow a lamp that is switched on each time."""
    time, inputs, chain = session("cutometer")
    effect = effects("cutometer")[name]
    values = {"form": 3, size: 0.2 if size == "change" else 5e-5, "warming": 1.0, "shift": 0.0}
    values = {p.name: values[p.name] for p in effect.parameters if p.name in values}
    height = effect.apply(chain, values).run(time, inputs)["apex_height"]
    off = np.abs(height - reference("cutometer")["apex_height"])
    zeroed = off[np.isclose(time % 320, 13.9, atol=0.011)].mean()  # the zero is taken while it warms up
    for begin in (0.0, 320.0):
        early, late = (np.interp(begin + at, time, np.abs(off - (size == "amount") * zeroed)) for at in (1.5, 5.5))
        assert early > 10 * late


def test_a_height_that_jumps_anew_in_every_recording() -> None:
    time, inputs, chain = session("cutometer")
    jump = {"offset": 5e-5, "form": 2, "later": 9.5}
    height = effects("cutometer")["sensor_offset"].apply(chain, jump).run(time, inputs)["apex_height"]
    off = height - reference("cutometer")["apex_height"]
    for begin in (0.0, 320.0):
        before, behind = (np.interp(begin + at, time, off) for at in (9.3, 9.7))
        assert before == pytest.approx(0.0, abs=1e-9)
        assert behind == pytest.approx(5e-5)


def test_friction_at_the_rim_may_carry_some_of_the_suction() -> None:
    time = np.linspace(0.0, 20.0, 4001)
    asked = {"command_pressure": -30e3 * np.interp(time, [0, 10, 20], [0, 1, 0])}
    rubbing = effects("cutometer")["rim_friction"].apply(
        nominal("cutometer"), {"width": 0.0, "friction": 1e3, "share": 0.0, "form": 2.0}
    )
    less = rubbing.run(time, asked)["skin_pressure"] - nominal("cutometer").run(time, asked)["skin_pressure"]
    np.testing.assert_allclose(less[(time > 5) & (time < 9)], 1e3, atol=1.0)
    np.testing.assert_allclose(less[(time > 12) & (time < 16)], -1e3, atol=1.0)


def test_a_spell_ends() -> None:
    time, inputs, chain = session("cutometer")
    spell = {"form": 2, "share": 0.3, "moment": 3.0, "duration": 1.0}
    height = effects("cutometer")["rim_leak"].apply(chain, spell).run(time, inputs)["apex_height"]
    off = np.abs(height - reference("cutometer")["apex_height"])
    assert off[time < 3.0].max() == 0.0
    assert off[(time > 3.1) & (time < 4.0)].min() > 1e-6
    assert off[(time > 60.0)].max() < 0.05 * off.max()


def test_what_a_spell_does_is_continuous_in_when_it_begins_and_ends() -> None:
    time = np.concatenate([np.arange(0.0, 10.0, 0.01), np.arange(30.0, 40.0, 0.01)])
    for moment, duration in ((2.004, 1.5), (2.006, 1.507), (31.0, 2.003)):
        part = laws.spell(time, moment, duration)
        assert part.sum() * 0.01 == pytest.approx(duration)
        assert np.sum((part > 0) & (part < 1)) <= 2
    within = laws.spell(time, 20.0, 12.0)  # it begins in a pause
    inside = np.abs(time - 32.0) > 1e-3
    np.testing.assert_array_equal(within[inside], ((time >= 20.0) & (time < 32.0))[inside])


def test_what_comes_and_goes_gradually_is_half_there_at_its_moments() -> None:
    time = np.arange(0.0, 20.0, 0.01)
    part = laws.spell(time, 5.0, 6.0, 2.0)
    np.testing.assert_allclose(
        np.interp([3.9, 4.5, 5.0, 8.0, 11.5, 12.1], time, part), [0, 0.25, 0.5, 1, 0.25, 0], atol=0.01
    )
    assert part.sum() * 0.01 == pytest.approx(6.0)


def test_friction_may_be_one_axis_alone() -> None:
    time, inputs, chain = session("microrobot")
    rough = effects("microrobot")["coulomb_friction"].apply(chain, {"axis": 2}).run(time, inputs)
    off = [np.abs(rough[n] - reference("microrobot")[n]).max() for n in numbered("axis_position")]
    assert max(off[0], off[2]) < 1e-12
    assert off[1] > 1e-6


def test_channels_may_be_mixed_up_only_where_others_are_computed_from_them() -> None:
    time, inputs, chain = session("microrobot")
    swap = effects("microrobot")["axis_swap"]
    mixed = swap.apply(chain, {"share": 1.0, "pair": 12.0}).run(time, inputs)
    sound = reference("microrobot")
    for name in TRANSDUCERS:
        np.testing.assert_array_equal(mixed[name], sound[name])
    matrix = chain["force_matrix"].fresh()
    expected = matrix @ np.stack([sound[TRANSDUCERS[k]] for k in (1, 0, 2)])
    np.testing.assert_allclose(np.stack([mixed[n] for n in xyz("force")]), expected, atol=1e-9)


def test_each_transducer_may_have_a_gain_of_its_own_and_all_computed_channels_a_unit() -> None:
    time, inputs, chain = session("microrobot")
    errors, sound = (0.1, -0.06, 0.02), reference("microrobot")
    values = {"form": 2.0, **{f"error_{leg}": e for leg, e in zip("abc", errors, strict=True)}}
    wrong = effects("microrobot")["sensor_gain"].apply(chain, values).run(time, inputs)
    for name, error in zip(TRANSDUCERS, errors, strict=True):
        np.testing.assert_allclose(wrong[name], (1.0 + error) * sound[name])
    inches = {"form": 2.0, "computed": 7.0, "factor": 2.54}
    wrong = effects("microrobot")["wrong_unit"].apply(chain, inches).run(time, inputs)
    for name in (*xyz("probe"), *numbered("axis_position")):
        np.testing.assert_allclose(wrong[name], (2.54 if name in xyz("probe") else 1.0) * sound[name])


def test_a_carried_weight_brings_one_limit_nearer() -> None:
    time, inputs, chain = session("microrobot")
    saturation, quiet = effects("microrobot")["force_saturation"], {n: np.zeros_like(v) for n, v in inputs.items()}
    for sign in (1.0, -1.0):
        push = {**quiet, "load_1": sign * 0.3 * np.minimum(time, 1.0)}
        form = {"form": 2, "limit": 0.5, "carried": 0.6}  # 0.2 N are left one way, 0.8 N the other
        moved = np.abs(saturation.apply(chain, form).run(time, push)["axis_position_1"]).max()
        assert (moved > 1e-3) == (sign < 0)


@pytest.mark.parametrize(("instrument", "effect"), [c for c in CASES if len(variants(c.values[1])) > 1])
def test_no_two_forms_are_the_same(instrument: str, effect: Effect) -> None:
    """Neither by default nor elsewhere in the prior: each form that is offered does something of its own."""
    time, inputs, chain = session(instrument)
    made = {}
    for key, form in variants(effect).items():
        places = [{}, *({p.name: quantile(p, u) for p in form.parameters} for u in (0.3, 0.6))]
        runs = [form.apply(chain, values).run(time, inputs) for values in places]
        made[key] = np.concatenate([run[n] / floor(n) for run in runs for n in MEASURED[instrument]])
    for one, other in itertools.combinations(made, 2):
        assert np.abs(made[one] - made[other]).max() > 1.0, f"{one} and {other}"


def test_frames_counted_at_a_wrong_rate_come_ever_later_in_each_recording() -> None:
    time, inputs, chain = session("aspiration")
    growing = variants(effects("aspiration")["desynchronisation"])["desynchronisation[form=3]"]
    out = growing.apply(chain, {"growth": 0.01}).run(time, inputs)["apex_height"]
    for begin in (0.0, 320.0):
        at = begin + np.array([1.5, 8.5, 11.5])
        late = np.interp(at - 0.01 * (at - begin), time, reference("aspiration")["apex_height"])
        np.testing.assert_allclose(np.interp(at, time, out), late, atol=3e-6)


def test_softening_by_work_begins_anew_with_each_recording() -> None:
    time, inputs, chain = session("microrobot")
    effect = variants(effects("microrobot")["preconditioning"])["preconditioning[form=3]"]
    made = effect.apply(chain, {"amount": 0.25, "rise": 0.2}).run(time, inputs)
    whole, soft = (np.sqrt(sum(np.square(run[n]) for n in xyz("reaction"))) for run in (reference("microrobot"), made))
    first, second = time < 12.0, time >= 320.0
    loaded = np.minimum(whole[first], whole[second]) > 0.1
    left = [soft[part][loaded] / whole[part][loaded] for part in (first, second)]
    assert left[0].min() == pytest.approx(1.0 / 1.25, abs=0.02)
    np.testing.assert_allclose(left[1], left[0], atol=0.03)


def test_an_integral_may_run_on_at_the_coils_own_limit() -> None:
    forms, chain = variants(effects("microrobot")["integral_windup"]), nominal("microrobot")
    at_its_own = forms["integral_windup[form=1]"].apply(chain, {"share": 0.4})["axes"]
    assert (at_its_own.windup, at_its_own.force_limit) == (0.4, chain["axes"].force_limit)
    below = forms["integral_windup[form=0]"].apply(chain, {"limit": 0.3, "running": 1.0})["axes"]
    assert (below.windup, below.force_limit) == (1.0, 0.3)


def test_a_used_up_preload_bends_a_reading_one_way_alone() -> None:
    u = np.linspace(-2.0, 2.0, 9)
    bent = laws.saturation_one_way(u, u, 0.5, -1.0)
    np.testing.assert_array_equal(bent[u >= 0.0], u[u >= 0.0])
    np.testing.assert_allclose(bent[u <= -1.5], -0.5, atol=1e-3)
    np.testing.assert_allclose(laws.saturation_one_way(u, -u, 0.5, 1.0), -bent)
    time, inputs, chain = session("microrobot")
    effect = variants(effects("microrobot")["sensor_saturation"])["sensor_saturation[channel=0,form=2]"]
    cut = effect.apply(chain, {"limit": 0.1}).run(time, inputs)["transducer_force_a"]
    whole = reference("microrobot")["transducer_force_a"]
    np.testing.assert_allclose(cut[whole > 0.0], whole[whole > 0.0])
    assert cut.min() == pytest.approx(max(whole.min(), -0.1), abs=2e-3)


def test_suction_sags_by_what_rises_and_holds_have_drawn() -> None:
    """With a store that fills up within hours: the share of a rise, and of a hold by its length."""
    time, inputs, chain = session("cutometer")
    sagging = variants(effects("cutometer")["reservoir_depletion"])["reservoir_depletion[form=3]"]
    full = reference("cutometer")["line_pressure"]
    line = sagging.apply(chain, {"sag": 0.03, "bleed": 0.1, "fill": 300.0}).run(time, inputs)["line_pressure"]
    lost = 1.0 - np.interp([2.0, 5.0], time, line) / np.interp([2.0, 5.0], time, full)
    rise = 0.03 * 40e3 / 30e3
    np.testing.assert_allclose(lost, [rise + 0.1 * rise, rise + 0.4 * rise], rtol=0.05)


def test_suction_never_exceeds_what_its_store_has_left() -> None:
    time, inputs, chain = session("cutometer")
    limited = variants(effects("cutometer")["reservoir_depletion"])["reservoir_depletion[form=2]"]
    full = reference("cutometer")["line_pressure"]
    values = {"draw": 0.1, "capacity": 41e3, "bleed": 0.5, "fill": 30.0, "soft": 10.0}
    line = limited.apply(chain, values).run(time, inputs)["line_pressure"]
    assert np.all(line >= full - 1e-6)
    hold = (time > 3.0) & (time < 6.0)
    assert np.all(np.diff(line[hold]) >= 0.0)  # sags as the bleed draws on
    low = (time > 6.5) & (time < 8.0)
    np.testing.assert_allclose(line[low], full[low], atol=1.0)
    assert np.interp(326.0, time, line) < np.interp(6.0, time, line) + 50.0  # filled up over five minutes
    # Through a valve it falls short before: by w ln 2 where the store has just what is asked for.
    soft = limited.apply(chain, values | {"draw": 1e-3, "capacity": 40e3, "bleed": 3e-3, "soft": 2e3})
    short = np.interp(2.0, time, soft.run(time, inputs)["line_pressure"] - full)
    assert short == pytest.approx(2e3 * np.log(2.0), abs=150.0)


def test_slips_in_a_row_at_the_rim_are_a_sensor_s_of_the_same_law() -> None:
    """An outside author's Maxwell slip at the rim was claimed as hysteresis of the sensor alone."""
    time = np.linspace(0.0, 12.0, 1201)
    asked = {"command_pressure": -30e3 * np.abs(np.sin(0.5 * time))}
    sound = nominal("cutometer").run(time, asked)["apex_height"]
    rim, sensor = (
        effects("cutometer")[name].apply(nominal("cutometer"), values).run(time, asked)["apex_height"] - sound
        for name, values in (
            ("rim_friction", {"width": 8e-6, "form": 4, "friction": 0.0, "share": 0.0}),
            ("sensor_hysteresis", {"width": 8e-6, "form": 1}),
        )
    )
    assert np.max(np.abs(rim)) > 2e-6
    np.testing.assert_allclose(rim, sensor, atol=1e-9)
