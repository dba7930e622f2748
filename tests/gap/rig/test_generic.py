"""The effects that any rig can have, as they act on a signal."""

from __future__ import annotations

import numpy as np
import pytest

from gap.rig.catalogue import GENERIC
from gap.rig.generic import GenericEffect

TIME = np.linspace(0.0, 4.0, 801)
SIGNAL = 2.0 * np.sin(3 * TIME) + 0.5 * TIME
RELATED = {"velocity": np.gradient(SIGNAL, TIME), "position": SIGNAL, "other": np.cos(TIME)}


def acted(effect: GenericEffect, values: dict[str, float], chunks: int = 1) -> np.ndarray:
    state: dict[str, float] = {}
    parts = np.array_split(np.arange(len(TIME)), chunks)
    return np.concatenate(
        [effect.act(state, TIME[k], SIGNAL[k], {n: v[k] for n, v in RELATED.items()}, values) for k in parts]
    )


@pytest.mark.parametrize("effect", GENERIC, ids=lambda e: e.form or e.name)
def test_an_effect_without_strength_does_nothing(effect: GenericEffect) -> None:
    values = {p.name: p.default if p.null is None else p.null for p in effect.parameters}
    if effect.name in ("saturation", "lower_saturation"):
        values["limit"] = 100.0 if effect.name == "saturation" else -100.0
    if effect.name in ("low_pass", "quantisation", "slew_limit"):
        values[effect.parameters[0].name] = 1e-9 if effect.name != "slew_limit" else 1e9  # their limit, not 0
    assert acted(effect, values) == pytest.approx(SIGNAL, abs=1e-6)


def test_an_input_may_be_early_and_hysteresis_never_leads() -> None:
    early = next(e for e in GENERIC if e.looks_ahead)
    ahead = acted(early, {"time": 0.1})
    assert ahead[:-100] == pytest.approx(np.interp(TIME[:-100] + 0.1, TIME, SIGNAL))
    assert early.act({}, 1.0, 2.0, {}, {"time": 0.1}) == 2.0  # inside an integration nothing is known beforehand
    level = next(e for e in GENERIC if e.name == "hysteresis").parameters[0]
    assert level.low > 0.0


@pytest.mark.parametrize("effect", [e for e in GENERIC if not e.looks_ahead], ids=lambda e: e.form or e.name)
def test_chunks_and_single_samples_join_without_a_seam(effect: GenericEffect) -> None:
    values = {p.name: p.default for p in effect.parameters}
    if effect.name == "slew_limit":
        values["rate"] = 1.0
    if effect.name == "delay":
        values["time"] = 0.0123  # 2.46 samples
    whole = acted(effect, values)
    assert acted(effect, values, chunks=7) == pytest.approx(whole, rel=1e-9, abs=1e-9)
    state: dict = {}
    single = [
        effect.act(state, float(TIME[k]), float(SIGNAL[k]), {n: float(v[k]) for n, v in RELATED.items()}, values)
        for k in range(len(TIME))
    ]
    assert single == pytest.approx(whole, rel=1e-9, abs=1e-9)
    assert np.ptp(whole - SIGNAL) > 0 or effect.name in ("offset", "saturation", "lower_saturation")


def test_known_forms() -> None:
    named = {e.form or e.name: e for e in GENERIC}
    v = RELATED["velocity"]
    friction = acted(named["coulomb_friction"], {"level": 3.0, "sharpness": 1e-9, "asymmetry": 0.0}) - SIGNAL
    assert friction == pytest.approx(3.0 * np.sign(v))
    play = acted(named["backlash"], {"gap": 0.4})
    assert np.abs(play - SIGNAL).max() == pytest.approx(0.2)
    delayed = acted(named["delay"], {"time": 0.1})
    assert delayed[100:] == pytest.approx(np.interp(TIME[100:] - 0.1, TIME, SIGNAL))
    assert acted(named["saturation"], {"limit": 1.0}).max() == 1.0
    step = named["second_order_low_pass"].act({}, TIME, 1.0 * (TIME > 0), {}, {"tau": 0.4})
    assert step == pytest.approx(1 - np.exp(-TIME / 0.2) * (1 + TIME / 0.2), abs=0.02)
    both = acted(named["symmetric_saturation"], {"limit": 0.8})
    assert (both.min(), both.max()) == (-0.8, 0.8)
    still = {"velocity": np.zeros(3)}
    net = np.array([0.9, 1.1, -2.0])
    held = named["breakaway"].act({}, TIME[:3], net, still, {"level": 1.0})
    assert held == pytest.approx([0.0, 0.1, -1.0])
    assert named["stick_slip"].act({}, TIME[:3], net, still, {"level": 1.0, "excess": 0.5})[1] == 0.0
    warm = acted(named["warming"], {"amount": 2.0, "tau": 0.5}) - SIGNAL
    assert warm == pytest.approx(2.0 * (1 - np.exp(-TIME / 0.5)))
    lag = acted(named["low_pass"], {"tau": 0.2})
    rate = np.gradient(lag, TIME)
    assert 0.2 * rate[5:-5] + lag[5:-5] == pytest.approx(SIGNAL[5:-5], abs=2e-3)


def made(effect: str, values: dict[str, float], time: np.ndarray, signal: np.ndarray) -> np.ndarray:
    act = next(e for e in GENERIC if e.name == effect).act
    return act({}, time, signal, {}, values)


@pytest.mark.parametrize("duration", [10.0, 1e4])
@pytest.mark.parametrize("power", [0.0, 0.15, 0.4])
def test_creep_follows_the_logarithm_and_powers_of_time(power: float, duration: float) -> None:
    time = np.linspace(0.0, duration, 3001)
    slow = np.log1p(time / (1e-3 * duration)) if power == 0 else time**power
    after = time > 0.003 * duration
    left = []
    for tau in duration * np.array([0.5, 1.0, 3.0, 9.0]):
        for exponent in np.arange(0.0, 0.7, 0.1):
            values = {"share": 1.0, "tau": tau, "exponent": exponent, "settled": 0.0}
            crept = made("creep", values, time, np.ones_like(time))[after]
            basis = np.column_stack([np.ones_like(crept), crept])
            left.append(np.std(slow[after] - basis @ np.linalg.lstsq(basis, slow[after], rcond=None)[0]))
    assert min(left) < 0.02 * np.std(slow[after])


def test_creep_under_a_load_that_it_had_settled_under_is_nothing_new() -> None:
    values = {"share": 0.1, "tau": 1.0, "exponent": 0.5, "settled": 1.0}
    assert made("creep", values, TIME, np.full_like(TIME, 3.0)) == pytest.approx(3.3)


def test_a_leak_bleeds_what_is_held_until_a_move_makes_good_for_it() -> None:
    held = np.where(TIME < 2.0, 2.0, 4.0)
    lost = held - made("leak", {"share": 1.0, "tau": 50.0, "refill": 0.1}, TIME, held)
    before, after = np.searchsorted(TIME, [1.99, 2.01])
    assert lost[before] == pytest.approx(2.0 * 1.99 / 50, rel=0.05)
    assert lost[after] < 0.05 * lost[before]
    assert lost[-1] == pytest.approx(2 * lost[before], rel=0.05)  # in proportion to what is held


def test_hysteresis_loops_inside_others_close() -> None:
    corners = np.array([0.0, 1.0, 0.4, 0.8, 0.4, 0.8, -2.0, 2.0])
    signal = np.interp(np.linspace(0, 7, 701), np.arange(8), corners)
    values = {"level": 0.1, "width": 0.5, "exponent": 1.0, "initial": 0.0, "bend": 100.0}
    out = made("hysteresis", values, np.arange(701.0), signal)
    assert out[300] == pytest.approx(out[500], abs=1e-9)  # 0.8, twice
    assert out[200] == pytest.approx(out[400], abs=1e-9)
    down, up = np.interp(0.5, -signal[500:600], out[500:600]), np.interp(-0.5, signal[600:], out[600:])
    assert down - up == pytest.approx(0.2, abs=1e-3)


def test_late_crosstalk_comes_with_its_time() -> None:
    time = np.linspace(0.0, 10.0, 501)
    other = np.where(time > 0.0, 5.0, 1.0)
    act = next(e for e in GENERIC if e.form == "slow_crosstalk").act
    got = act({}, time, np.zeros(501), {"other": other}, {"share": 0.3, "tau": 2.0})
    assert got == pytest.approx(0.3 * 4.0 * (1 - np.exp(-time / 2.0)), abs=0.02)


def test_bristles_slide_as_stribeck_friction_and_bend_as_dahls() -> None:
    named = {e.form or e.name: e for e in GENERIC}
    values = {"level": 2.0, "excess": 0.7, "stribeck_velocity": 0.5, "presliding": 1e-6, "asymmetry": 0.0}
    moving = (np.abs(RELATED["velocity"]) > 0.3) & (TIME > 0)
    slides = acted(named["stribeck_friction"], values)
    assert acted(named["bristles"], values)[moving] == pytest.approx(slides[moving], abs=5e-3)
    bends = acted(named["dahl_friction"], {**values, "presliding": 0.3})
    assert acted(named["bristles"], {**values, "presliding": 0.3, "excess": 0.0}) == pytest.approx(bends)


def test_a_drag_of_the_second_power_is_the_quadratic_one() -> None:
    named = {e.form or e.name: e for e in GENERIC}
    power = acted(named["power_drag"], {"force": 3.0, "speed": 2.0, "exponent": 2.0})
    assert power == pytest.approx(acted(named["quadratic_drag"], {"coefficient": 0.75}))
