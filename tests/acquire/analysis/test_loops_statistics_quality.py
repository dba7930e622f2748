"""Loops and their energy, mean curves and analysis of variance, quality flags."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import f_oneway

from acquire.analysis.loops import by_direction, loops
from acquire.analysis.quality import quality
from acquire.analysis.statistics import anova, mean_curve, spread
from acquire.recording import Recording, RunInfo, Series
from tests.acquire.recording.samples import sample_recording


def robot(angles: list[float], cycles: int = 3, phase: float = 0.1) -> Recording:
    """Triangles of 1.3 mm at 0.1 Hz along ``angles`` with a linear spring of 800 N/m and a lag that loses energy."""
    per_cycle = np.arange(0, 10, 0.01)
    triangle = 1.3e-3 * np.interp(per_cycle, [0, 5, 10], [0, 1, 0])
    time = np.arange(len(angles) * cycles * len(per_cycle)) * 0.01
    amount = np.tile(triangle, len(angles) * cycles)
    angle = np.repeat(np.deg2rad(angles), cycles * len(per_cycle))
    probe = {"x": amount * np.cos(angle), "y": amount * np.sin(angle), "z": 0 * amount}
    velocity = np.gradient(amount, time)
    held = 800 * amount + phase * 800 * velocity
    force = {"x": -held * np.cos(angle), "y": -held * np.sin(angle), "z": 0 * amount}
    streams = {f"probe_{a}": Series(v, time, "m") for a, v in probe.items()}
    streams |= {f"force_{a}": Series(v, time, "N") for a, v in force.items()}
    setpoints = {f"probe_{a}": Series(v, time, "m") for a, v in probe.items()}
    return Recording(RunInfo("r", "microrobot", ""), streams, setpoints)


def test_loops() -> None:
    found = loops(robot([0, 90]))
    assert len(found) == 6
    groups = by_direction(found)
    assert list(groups) == [(1, 0, 0), (0, 1, 0)]
    loop = groups[(1.0, 0.0, 0.0)][0]
    displacement, force = loop.peak
    assert displacement == pytest.approx(1.3e-3, rel=0.01)
    assert force == pytest.approx(800 * 1.3e-3, rel=0.03)
    # Viscous force 0.1 s * 800 N/m * 0.26 mm/s both ways over 1.3 mm.
    assert loop.lost == pytest.approx(2 * 0.1 * 800 * 0.26e-3 * 1.3e-3, rel=0.15)
    assert 0.05 < loop.loss < 0.2
    assert loops(robot([0], phase=0.0))[0].loss == pytest.approx(0.0, abs=0.01)
    assert loops(sample_recording()) == ()


def test_mean_curve_and_its_band() -> None:
    rng = np.random.default_rng(0)
    time = np.linspace(5, 7, 400)
    curves = [(time - shift, np.full(400, value)) for shift, value in enumerate(rng.normal(1.0, 0.1, 10))]
    with pytest.raises(ValueError, match="no time in common"):
        mean_curve(curves)
    curves = [(t + 0.1 * shift + shift, value) for shift, (t, value) in enumerate(curves)]
    mean = mean_curve(curves)
    values = [value[0] for _, value in curves]
    assert mean.count == 10
    assert (mean.time[0], mean.time[-1]) == (pytest.approx(5.9), pytest.approx(7.0))
    assert mean.mean == pytest.approx(np.full(500, np.mean(values)))
    assert mean.half_width == pytest.approx(np.full(500, 2.2622 * np.std(values, ddof=1) / np.sqrt(10)), rel=1e-4)
    assert np.isnan(mean_curve(curves[:1]).half_width).all()
    with pytest.raises(ValueError, match="no curves"):
        mean_curve([])


def test_spread() -> None:
    found = spread([1.0, 1.2, 0.8, float("nan")])
    assert (found.mean, found.count) == (pytest.approx(1.0), 3)
    assert found.half_width == pytest.approx(4.3027 * 0.2 / np.sqrt(3), rel=1e-4)
    assert found.relative == pytest.approx(0.2)
    assert spread([0.1 + 0.2, 0.3]).half_width == 0.0  # rounding is no scatter
    with pytest.raises(ValueError, match="at least two repeats, not 1"):
        spread([1.0])


def test_anova_agrees_with_scipy() -> None:
    groups = [[1.0, 1.2, 0.9], [1.5, 1.4], [1.1, 1.0, 1.3, 1.2]]
    ours, theirs = anova(groups), f_oneway(*groups)
    assert ours.f == pytest.approx(theirs.statistic)
    assert ours.p == pytest.approx(theirs.pvalue)
    assert (ours.between, ours.within) == (2, 6)
    with pytest.raises(ValueError, match="at least two groups"):
        anova([[1.0, 2.0]])


def flags(recording: Recording) -> dict[str, str]:
    return {flag.name: flag.level for flag in quality(recording)}


def test_a_good_recording_has_no_warning() -> None:
    assert set(flags(sample_recording()).values()) == {"ok"}


def test_each_trouble_has_its_flag() -> None:
    good = sample_recording()
    pressure, height = good.streams["pressure"], good.streams["apex_height"]
    assert pressure.seq is not None
    gap = replace(pressure, seq=np.where(pressure.seq > 100, pressure.seq + 3, pressure.seq))
    assert flags(replace(good, streams={"pressure": gap}))["lost samples"] == "bad"
    full = replace(height, value=np.minimum(height.value * 40, 4e-3))
    assert flags(replace(good, streams={"apex_height": full}))["saturation"] == "bad"
    time = pressure.time
    step = np.where((time > 1) & (time < 16), -3e4, 0.0)
    moved = replace(pressure, value=step + 2e3 * (time > 10), range=None)
    late = {"pressure": replace(good.setpoints["pressure"], time=good.setpoints["pressure"].time + 1)}
    assert flags(replace(good, streams={"pressure": moved}, setpoints=late))["drift"] == "warning"
    weak = {"contour_confidence": Series(np.array([0.9, 0.2, 0.1]), np.arange(3.0), "1")}
    assert flags(replace(good, derived=weak))["contour"] == "bad"
    assert flags(replace(good, info=replace(good.info, status="tripped", trip_reason="too strong")))["ending"] == "bad"


def test_a_command_that_is_not_followed_is_named() -> None:
    good = sample_recording()
    pressure = good.streams["pressure"]
    assert flags(good)["command"] == "ok"
    weak = replace(pressure, value=0.9 * pressure.value)
    assert flags(replace(good, streams={"pressure": weak}))["command"] == "warning"
    dead = replace(pressure, value=0.0 * pressure.value)
    flag = next(f for f in quality(replace(good, streams={"pressure": dead})) if f.name == "command")
    assert (flag.level, flag.value) == ("bad", 1.0)
    assert flag.text == "pressure was 0 mbar at 0.0 s, where -300 mbar was held"
    still = robot([0])
    moving = replace(
        still,
        streams={
            **still.streams,
            "probe_x": replace(still.streams["probe_x"], value=0 * still.streams["probe_x"].value),
        },
    )
    assert (flags(still)["command"], flags(moving)["command"]) == ("ok", "bad")


def test_values_that_no_skin_has_and_a_rate_that_was_not_set() -> None:
    good = sample_recording()
    height = good.streams["apex_height"]
    flag = quality(replace(good, streams={"apex_height": replace(height, value=1e4 * height.value)}))
    assert [f.text for f in flag if f.name == "impossible"] == [
        "apex_height is 2000 mm: skin does not rise higher than an opening is wide (2 to 8 mm)"
    ]
    protocol = "schema: protocol/1\nname: x\ninstrument: cutometer\nsetup: {sampling: 500 Hz}\n"
    asked = replace(good.info, protocol=protocol + "steps: [{type: wait, duration: 1 s}]\n")
    found = quality(replace(good, info=asked))
    assert [f.text for f in found if f.name == "rate"] == [
        "the protocol states 500 Hz (sampling); the instrument took 100 Hz"
    ]


def test_first_curve() -> None:
    time = np.arange(0, 40, 0.01)
    height = np.where((time - 0.05) % 10 < 5, 1e-4, 0.0) * np.where(time < 10, 0.8, 1.0)
    levels = np.tile([0, -3e4, -3e4, 0], 4)
    moments = np.ravel([[k, k, k + 5, k + 5] for k in (0, 10, 20, 30)])
    streams = {"apex_height": Series(height, time, "m")}
    recording = Recording(RunInfo("r", "cutometer", ""), streams, {"pressure": Series(levels, moments, "Pa")})
    flag = next(f for f in quality(recording) if f.name == "first curve")
    assert flag.level == "warning"
    assert flag.value < -0.1
    same = np.where((time + 0.1 * (time > 8)) % 10 < 5, 1e-4, 0.0)  # three lost frames: heights come early afterwards
    early = replace(recording, streams={"apex_height": Series(np.where(time < 0.05, 0.0, same), time, "m")})
    assert next(f for f in quality(early) if f.name == "first curve").level == "ok"
