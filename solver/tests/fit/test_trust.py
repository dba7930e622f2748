"""A fit is trusted where the data hold a response, and every parameter is told by it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from intervals import PROTOCOL, TRUTH, Creep, Scenario, noise, recorded
from recovery import Info, Recording, Series

from skinrig_solver.fit import FitResult, fit

FREE = {symbol: "free" for symbol in TRUTH}


def silence(seed: int, memory: float = 0.0, level: float = 0.0) -> Recording:
    """Suction as ever, over a height that is noise."""
    plain = recorded(Scenario(""), seed)
    time = plain.streams["pressure"].time
    height = level + noise(np.random.default_rng(seed), time.size, 3e-6, memory)
    streams = {"pressure": plain.streams["pressure"], "apex_height": Series(time, height, "m")}
    return Recording(Info(f"noise {seed}", "cutometer", PROTOCOL), streams)


def go(recording: Recording, **spec: Any) -> FitResult:
    return fit([recording], {"parameters": FREE, **spec}, model=Creep())


@pytest.mark.parametrize("memory", [0.0, 0.95])
@pytest.mark.parametrize("zero", ["free", "fixed"])
def test_noise_is_never_trusted(memory: float, zero: str) -> None:
    for seed in range(6):
        result = go(silence(seed, memory), zero=zero)
        assert not result.trusted
        assert not any(e.identifiable for e in result.estimates)
        assert any("no response" in reason for reason in result.reasons)
        assert "not to be trusted: " in result.in_words()


def test_noise_beside_an_offset_is_not_trusted_either() -> None:
    assert any("no response" in reason for reason in go(silence(1, level=2e-3)).reasons)


def test_a_small_response_is_one() -> None:
    loud = recorded(Scenario("", height=6e-5), 3)  # noise of a fifth of the height
    assert not any("no response" in reason for reason in go(loud).reasons)
    result = go(recorded(Scenario(""), 3))
    assert (result.trusted, result.reasons) == (True, ())
    assert result.as_dict()["not_trusted_because"] == []


def test_whole_hundredths_of_a_millimetre_and_a_wrong_law_are_a_response_all_the_same() -> None:
    """Slow, systematic residuals were taken for noise that remembers for longer than the recording lasts."""
    plain = recorded(Scenario(""), 0)
    height = plain.streams["apex_height"]
    value = np.round((height.value + 5e-6 * np.sin(0.4 * height.time)) / 1e-5) * 1e-5
    result = go(replace(plain, streams={**plain.streams, "apex_height": replace(height, value=value)}))
    assert not any("no response" in reason for reason in result.reasons)
    assert result.estimates[0].standard_error < 0.3 * result.estimates[0].value


def test_a_parameter_on_a_bound_or_not_told_is_a_reason() -> None:
    bound = go(recorded(Scenario(""), 0), parameters={**FREE, "tau": {"start": 0.4, "upper": 0.8}})
    assert not bound.trusted
    assert "tau ended on its bound" in bound.reasons
    plain = recorded(Scenario("", height=1e-5), 0)
    half = {k: replace(s, time=s.time[:100], value=s.value[:100]) for k, s in plain.streams.items()}
    short = go(replace(plain, streams=half))
    assert not short.trusted
    assert any("not identifiable from these recordings" in reason for reason in short.reasons)
    assert any(e.identifiable for e in short.estimates)  # the others stand
    stopped = go(recorded(Scenario(""), 0), evaluations=2)
    assert "the optimiser stopped before it converged" in stopped.reasons
