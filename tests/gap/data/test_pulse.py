"""A pulse whose rate wanders shows in the spectrum; noise of any colour, creep and moving commands do not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from acquire.recording.model import Recording
from gap.data.pulse import pulse
from gap.data.signatures import Signature

TIME = np.arange(0.0, 26.0, 0.02)
HOLD = {"pressure": ([0.0, 1.0, 1.0, 16.0, 16.0, 26.0], [0.0, 0.0, -3e4, -3e4, 0.0, 0.0])}
LONG = {"pressure": ([0.0, 1.0, 1.0, 26.0], [0.0, 0.0, -3e4, -3e4])}
SINE = {"pressure": (TIME, -1.5e4 * (1.0 - np.cos(2 * np.pi * 0.9 * TIME)))}


def wandering(rng: np.random.Generator, rate: float, amplitude: float) -> np.ndarray:
    """A pulse whose frequency wanders by a tenth."""
    slow = np.interp(TIME, np.linspace(0, 26, 7), rng.normal(0.0, 0.1, 7))
    return amplitude * np.sin(2 * np.pi * np.cumsum(rate * (1.0 + slow)) * 0.02 + rng.uniform(0, 6))


def skin(rng: np.random.Generator, slow: float = 0.0) -> np.ndarray:
    """Height that creeps, with noise of 4 µm of which a share ``slow`` forgets within a second."""
    since = np.maximum(TIME - 1.0, 0.0)
    height = np.where(TIME < 16.0, 3e-4 * since**0.1, 8e-5 * np.exp(-np.maximum(TIME - 16.0, 0.0) / 8.0))
    noise = rng.normal(size=len(TIME))
    walk = np.zeros(len(TIME))
    for k in range(1, len(TIME)):
        walk[k] = 0.98 * walk[k - 1] + np.sqrt(1 - 0.98**2) * rng.normal()
    return height + 4e-6 * (np.sqrt(1 - slow**2) * noise + slow * walk)


@pytest.mark.parametrize("rate", [0.9, 1.2, 1.8])
def test_a_pulse_that_wanders_is_found_at_its_rate(recording: Callable[..., Recording], rate: float) -> None:
    rng = np.random.default_rng(4)
    session = [recording({"apex_height": skin(rng) + wandering(rng, rate, 4e-6)}, TIME, HOLD) for _ in range(5)]
    mark = marked(session, "a pulse", rate, 0.15)
    assert mark.noise > 1.2
    assert not mark.alone  # a device's effect that explains more leads


def test_a_faint_pulse_of_a_steady_rate_is_found_in_three_recordings(recording: Callable[..., Recording]) -> None:
    """An outside author's pulse of 3 µm under noise of 4.5 µm at 40 Hz was not: of stretches cut at 10 s, beside bands
    that counted for half of what they told."""
    rng = np.random.default_rng(7)

    def beating(k: int) -> np.ndarray:
        return skin(rng) + 1.7e-6 * np.sin(2 * np.pi * 1.13 * TIME + k)

    session = [recording({"apex_height": beating(k)}, TIME, HOLD) for k in range(3)]
    marked(session, "a pulse", 1.13, 0.1)


def marked(session: list[Recording], rhythm: str, rate: float, within: float) -> Signature:
    """The one mark of a session, which is of a rhythm within some Hz of a rate."""
    (mark,) = pulse(session)
    assert mark.effect == "pulse_breathing"
    assert mark.text.endswith(f"as from {rhythm}")
    assert float(mark.text.split("about ")[1].split(" Hz")[0]) == pytest.approx(rate, abs=within)
    return mark


def held(rng: np.random.Generator) -> np.ndarray:
    """Height that creeps all the while."""
    return 3e-4 * np.maximum(TIME - 1.0, 0.0) ** 0.1 + 4e-6 * rng.normal(size=len(TIME))


@pytest.mark.parametrize("rate", [0.2, 0.26, 0.34])
@pytest.mark.parametrize("amplitude", [8e-6, 8e-5])
def test_a_breath_that_wanders_is_found_at_its_rate(
    recording: Callable[..., Recording], rate: float, amplitude: float
) -> None:
    """One of 85 um, whose rate wanders by a tenth, left a gap of 18.6 and was unknown: no sine follows it."""
    rng = np.random.default_rng(5)
    session = [recording({"apex_height": held(rng) + wandering(rng, rate, amplitude)}, TIME, LONG) for _ in range(4)]
    marked(session, "breath", rate, 0.07)


def test_a_rhythm_of_the_pressure_is_no_breath(recording: Callable[..., Recording]) -> None:
    rng = np.random.default_rng(5)
    session = []
    for _ in range(4):
        hunting = wandering(rng, 0.26, 1.0)
        pressure = np.interp(TIME, *LONG["pressure"]) + 300.0 * hunting + 50.0 * rng.normal(size=len(TIME))
        session.append(recording({"apex_height": held(rng) + 8e-5 * hunting, "pressure": pressure}, TIME, LONG))
    assert pulse(session) == []


@pytest.mark.parametrize("slow", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("seed", range(4))
def test_noise_of_any_colour_is_no_pulse(recording: Callable[..., Recording], slow: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert pulse([recording({"apex_height": skin(rng, slow)}, TIME, HOLD) for _ in range(5)]) == []


def test_what_answers_a_command_is_no_pulse(recording: Callable[..., Recording]) -> None:
    rng = np.random.default_rng(1)
    height = 1e-4 * (1.0 - np.cos(2 * np.pi * 0.9 * TIME)) + 4e-6 * rng.normal(size=len(TIME))
    assert pulse([recording({"apex_height": height}, TIME, SINE) for _ in range(4)]) == []


def test_a_reference_specimen_has_no_pulse(recording: Callable[..., Recording]) -> None:
    rng = np.random.default_rng(4)
    height = skin(rng) + wandering(rng, 1.2, 4e-6)
    assert pulse([recording({"apex_height": height}, TIME, HOLD, specimen="silicone") for _ in range(4)]) == []
