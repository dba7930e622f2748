"""The interlock's plausibility on made signals: which must trip, how soon, and which must not."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from acquire.engine.checks import LIMITS, Watch
from acquire.engine.plausibility import PLAUSIBILITY, Pictures
from acquire.engine.rules import Rules, Trip
from drivers.signals import Block, FloatArray, Frame
from protocols.limits import Limits, Range

RATE = 100.0
#: s: at rest, at full suction, at rest again.
EDGES = (3.0, 13.0, 18.0)
FULL = -30e3
TIME = np.arange(round(EDGES[-1] * RATE)) / RATE
TARGET = np.where((EDGES[0] <= TIME) & (EDGES[1] > TIME), FULL, 0.0)
HARM = 8.0  # s: in the middle of the hold


def lagged(target: FloatArray, tau: float) -> FloatArray:
    out = np.zeros(len(target))
    for k in range(1, len(target)):
        out[k] = out[k - 1] + (target[k] - out[k - 1]) / (tau * RATE)
    return out


def sound(sigma: float = 30.0, step: float = 10.0, seed: int = 0) -> dict[str, FloatArray]:
    """Pressure with noise, on a converter's grid; height with creep and recovery."""
    random = np.random.default_rng(seed)
    pressure = lagged(TARGET, 0.05) + sigma * random.standard_normal(len(TIME))
    height = -lagged(TARGET, 0.1) * 5e-9 - lagged(TARGET, 3.0) * 2e-9 + 2e-6 * random.standard_normal(len(TIME))
    return {
        "pressure": np.round(pressure / step) * step if step else pressure,
        "apex_height": np.round(height / 1e-5) * 1e-5,
    }


def look(values: Mapping[str, FloatArray], size: int = 4, target: FloatArray = TARGET, **more: object) -> Trip | None:
    watch = Watch(Limits({"pressure": Range(-50e3, 0.0)}), Rules(), **more)  # type: ignore[arg-type]
    checks = [check(watch) for check in (*LIMITS, *PLAUSIBILITY)]
    for first in range(0, len(TIME), size):
        part = slice(first, first + size)
        seq = np.arange(len(TIME))[part]
        block = Block({n: v[part] for n, v in values.items()}, seq, TIME[part], TIME[part])
        for check in checks:
            if trip := check.look(block, {"pressure": target[part]}):
                return trip
    return None


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("size", [1, 7, 50])
def test_a_sound_instrument_does_not_trip(seed: int, size: int) -> None:
    assert look(sound(seed=seed), size) is None


@pytest.mark.parametrize(
    ("sigma", "step"), [(0.0, 0.0), (0.0, 10.0), (30.0, 0.0), (3.0, 10.0), (30.0, 100.0), (5.0, 100.0)]
)
def test_neither_does_a_quiet_or_a_coarse_one(sigma: float, step: float) -> None:
    for seed in range(3):
        assert look(sound(sigma, step, seed)) is None


AFTER = TIME >= HARM
HARMS = {
    "frozen": (lambda v: np.where(AFTER, v[~AFTER][-1], v), "frozen", 0.55),
    "stuck at rest": (lambda v: np.where(AFTER, 0.0, v), "jump", 0.05),
    "scaled": (lambda v: np.where(AFTER, 1.25 * v, v), "jump", 0.05),
    "offset": (lambda v: np.where(AFTER, v + 7e3, v), "jump", 0.05),
    "drifting": (lambda v: np.where(AFTER, v + 8e3 * (TIME - HARM), v), "tracking", 4.3),
    "of the other sign": (lambda v: np.where(AFTER, -v, v), "value", 0.05),
    "out of limits": (lambda v: np.where(AFTER, -60e3, v), "value", 0.05),
}


@pytest.mark.parametrize("harm", HARMS)
def test_a_gauge_that_fails_in_a_hold_trips(harm: str) -> None:
    change, code, within = HARMS[harm]
    values = sound()
    trip = look({**values, "pressure": change(values["pressure"])})
    assert trip is not None
    assert trip.code == code
    assert HARM <= trip.time <= HARM + within


def between_segments(every: float = 1.0, unknown: float = 0.05) -> FloatArray:
    """The set-point of segments of ``every`` s: at their ends the host does not know it for a moment."""
    return np.where(TIME % every < unknown, np.nan, TARGET)


@pytest.mark.parametrize("size", [1, 4, 50])
def test_an_unknown_set_point_between_segments_hides_nothing(size: int) -> None:
    for harm in ("stuck at rest", "offset"):
        change, code, within = HARMS[harm]
        values = sound()
        trip = look({**values, "pressure": change(values["pressure"])}, size, between_segments())
        assert trip is not None
        assert trip.code == code
        assert trip.time <= HARM + within + 0.06
    trip = look({**sound(), "apex_height": np.zeros(len(TIME))}, size, between_segments())
    assert trip is not None
    assert trip.code == "response"
    assert look(sound(), size, between_segments()) is None
    assert look(sound(), size, between_segments(1.0, 0.5)) is None


def test_one_spike_is_passed_over_and_two_are_not() -> None:
    for count in (1, 2):
        for size in (10e3, -60e3):
            values = sound()
            at = round(HARM * RATE)
            values["pressure"][at : at + count] += size
            trip = look(values)
            assert (trip is not None) == (count == 2)
            if trip is not None:
                assert trip.time == pytest.approx(HARM + 1 / RATE)
                assert trip.code in ("jump", "value")


def test_a_height_that_does_not_follow_trips() -> None:
    values = sound()
    dead = {**values, "apex_height": np.zeros(len(TIME))}
    trip = look(dead)
    assert trip is not None
    assert (trip.code, trip.time) == ("response", pytest.approx(EDGES[0] + 2.0, abs=0.05))
    assert look(dead, yields=False) is None, "a rigid block does not come up"
    up = {**values, "apex_height": np.full(len(TIME), 1e-4)}
    assert look(up) is None, "skin that never came down need not come up"
    downward = {**values, "apex_height": -values["apex_height"]}
    trip = look(downward)
    assert trip is not None
    assert trip.code == "response"


def test_a_height_made_of_pictures_stops_nothing() -> None:
    dead = {**sound(), "apex_height": np.zeros(len(TIME))}
    assert look(dead, gappy=frozenset({"apex_height"})) is None


def test_one_picture_for_ever_trips() -> None:
    random = np.random.default_rng(0)
    pictures = Pictures()
    images = [random.integers(0, 255, (8, 8), np.uint8) for _ in range(30)]
    assert not any(pictures.look(Frame(image, k, k / 25, 0.0)) for k, image in enumerate(images))
    assert not any(pictures.look(Frame(images[k // 4], k, k / 25, 0.0)) for k in range(30, 60)), "a slow camera"
    trips = [pictures.look(Frame(images[0], k, k / 25, 0.0)) for k in range(60, 90)]
    first = next(trip for trip in trips if trip)
    assert (first.code, first.time) == ("frozen", pytest.approx(60 / 25 + 0.52, abs=0.05))


def test_a_gauge_that_says_vented_while_the_skin_stays_up_trips() -> None:
    values = sound()
    still = EDGES[1] <= TIME
    held = np.where(still, values["apex_height"][~still][-1], values["apex_height"])
    trip = look({**values, "apex_height": held})
    assert trip is not None
    assert (trip.code, trip.time) == ("response", pytest.approx(EDGES[1] + 2.0, abs=0.05))
    assert "is there still suction?" in trip.message


def test_two_gauges_that_disagree_trip() -> None:
    values = sound()
    other = lagged(TARGET, 0.1) + 30.0 * np.random.default_rng(1).standard_normal(len(TIME))
    assert look({**values, "pressure_reference": other}) is None
    for wrong in (other * 0.9, other + 3e3):  # from the very beginning: one gauge alone would not be doubted
        trip = look({**values, "pressure_reference": wrong})
        assert trip is not None
        assert trip.code == "reference"
