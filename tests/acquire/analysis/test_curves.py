"""Curve parameters: the published record keeps the identities, and a curve of known form gives its own numbers back."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from acquire.analysis.curves import (
    DEFINITIONS,
    curve_parameters,
    identity_errors,
    recording_parameters,
    relative_parameters,
)
from acquire.analysis.cycles import Cycle, find_cycles, suction_cycles
from acquire.recording import Recording, RunInfo, Series

# A record printed in the literature on the instrument (mm and ratios), three decimals.
_VALUES = (0.167, 0.058, 0.653, 0.208, 0.085, 0.765, 0.965, 0.389, 0.109, 0.041)
PUBLISHED = {f"R{number}": value for number, value in enumerate(_VALUES)}


def test_published_record_keeps_the_identities() -> None:
    for name, error in identity_errors(PUBLISHED).items():
        assert abs(error) < 1e-3, name


def test_published_record_is_reproduced_from_its_deformations() -> None:
    ue = PUBLISHED["R0"] / (1 + PUBLISHED["R6"])
    computed = relative_parameters(ue, PUBLISHED["R0"], PUBLISHED["R5"] * ue, PUBLISHED["R1"])
    for name, value in computed.items():
        assert value == pytest.approx(PUBLISHED[name], abs=1e-3), name


def curve(time: np.ndarray, cycles: list[Cycle]) -> np.ndarray:
    """Half at once, half with 0.5 s; a part back at once, the rest with 1 s, a tenth stays."""
    height = np.zeros_like(time)
    for cycle in cycles:
        on = (time > cycle.onset) & (time <= cycle.release)
        off = (time > cycle.release) & (time <= cycle.end)
        height[on] += 1e-4 + 1e-4 * (1 - np.exp(-(time[on] - cycle.onset) / 0.5))
        height[off] += 2e-5 + 1.2e-4 * np.exp(-(time[off] - cycle.release) / 1.0)
    return height


def test_a_known_curve() -> None:
    time = np.arange(0, 20, 0.001)
    cycles = [Cycle(1, 6, 11, -3e4, 0, 0), Cycle(11, 16, 19.999, -3e4, 0, 0)]
    p = curve_parameters(time, curve(time, cycles) + 5e-5, cycles)
    assert set(p) == set(DEFINITIONS)
    assert p["Ue"] == pytest.approx(1e-4 + 1e-4 * (1 - math.exp(-0.2)), rel=1e-3)
    assert p["Uf"] == pytest.approx(2e-4, rel=1e-3)
    assert p["Ur"] == pytest.approx(2e-4 - 2e-5 - 1.2e-4 * math.exp(-0.1), rel=1e-3)
    assert p["R1"] == pytest.approx(2e-5 + 1.2e-4 * math.exp(-5), rel=0.03)
    assert p["R3"] == pytest.approx(p["R0"], rel=1e-3)
    assert p["Q0"] == pytest.approx(2e-4 * 5, rel=1e-3)
    recovered = 1.8e-4 * 5 - 1.2e-4 * (1 - math.exp(-5))
    assert p["Q1"] == pytest.approx(recovered / (2e-4 * 5), rel=2e-3)
    assert max(map(abs, identity_errors(p).values())) < 1e-12


def test_a_ramp_has_no_immediate_response() -> None:
    time = np.arange(0, 40, 0.01)
    suction = np.interp(time, [1, 18.5, 36], [0, 2.6e4, 0])
    series = {"pressure": Series(-suction, time, "Pa"), "apex_height": Series(1e-8 * suction, time, "m")}
    recording = Recording(RunInfo("r", "cutometer", ""), series)
    (cycle,) = suction_cycles(recording)
    assert cycle.onset == pytest.approx(1 + 0.1 * 17.5, abs=0.05), "as measured: where suction leaves a tenth"
    p = recording_parameters(recording)
    assert math.isnan(p["Ue"])
    assert math.isnan(p["R5"])
    assert p["R0"] == pytest.approx(2.6e-4 * 0.9, rel=0.01)


def test_cycles_follow_the_setpoints() -> None:
    time = np.arange(0, 30, 0.01)
    levels = np.array([0, -3e4, -3e4, 0, 0, -2e4, -2e4, 0])
    moments = np.array([2.0, 2, 7, 7, 12, 12, 17, 17])
    streams = {"apex_height": Series(np.zeros_like(time), time, "m")}
    recording = Recording(RunInfo("r", "cutometer", ""), streams, {"pressure": Series(levels, moments, "Pa")})
    first, second = suction_cycles(recording)
    assert (first.onset, first.release, first.end, first.level) == (2, 7, 12, -3e4)
    assert (second.onset, second.release, second.end, second.level) == (12, 17, pytest.approx(29.99), -2e4)
    assert (first.rise, first.fall) == (0, 0)
    assert suction_cycles(replace(recording, setpoints={})) == ()


def test_noise_and_nothing() -> None:
    time = np.arange(0, 10, 0.01)
    noise = np.random.default_rng(1).normal(0, 50, len(time))
    pressure = np.where((time > 2) & (time < 6), -3e4, 0) + noise
    recording = Recording(RunInfo("r", "cutometer", ""), {"pressure": Series(pressure, time, "Pa")})
    assert len(suction_cycles(recording)) == 1
    assert recording_parameters(recording) == {}
    assert recording_parameters(Recording(RunInfo("r", "x", ""), {})) == {}


def test_suction_too_brief_for_a_cycle_is_none() -> None:
    time = np.arange(100) / 100
    pulse = Series(np.where((time > 0.5) & (time < 0.53), -3e4, 0.0), time, "Pa")
    assert find_cycles(pulse, threshold=0.5) == ()


AFTER_THE_FIRST = {"R3", "R4", "R9"}
RECOVERY = {"Ua", "R1", "R2", "R8", "Q0", "Q1", "Q2", "Q3"}
RELEASE = {"Ur", "R5", "R7"} | RECOVERY
SUCTION = {"Uf", "Uv", "R0", "R6"} | RELEASE


@pytest.mark.parametrize(
    ("end", "unknown"),
    [
        (0.5, set(DEFINITIONS)),
        (1.05, set(DEFINITIONS)),
        (4.0, SUCTION | AFTER_THE_FIRST),
        (6.05, RELEASE | AFTER_THE_FIRST),
        (8.0, RECOVERY | AFTER_THE_FIRST),
        (10.99, AFTER_THE_FIRST),
        (14.0, AFTER_THE_FIRST),
        (16.0, {"R4"}),
        (18.0, set()),
    ],
)
def test_phases_that_were_not_recorded_give_no_parameters(end: float, unknown: set[str]) -> None:
    cycles = [Cycle(1, 6, 11, -3e4, 0, 0), Cycle(11, 16, 21, -3e4, 0, 0)]
    time = np.arange(0, end, 0.01)
    p = curve_parameters(time, curve(time, cycles), cycles)
    assert {name for name, value in p.items() if math.isnan(value)} == unknown
    whole = np.arange(0, 21, 0.01)
    full = curve_parameters(whole, curve(whole, cycles), cycles)
    for name in set(p) - unknown - {"R4"}:
        assert p[name] == pytest.approx(full[name], rel=1e-3, abs=1e-9)
