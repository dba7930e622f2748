"""A whole diagnosis on each instrument, from the own simulator with one effect or none; and what bad input gets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from acquire.recording.model import Recording
from gap.design import simulated as own
from gap.diagnosis import DiagnosisError, diagnose
from gap.report.document import as_json
from gap.rig.model import ModelError
from sim_devices.effects import effects

pytestmark = pytest.mark.slow

SUCTION = [
    own.step_hold(-40e3, 8.0, 5.0),
    replace(own.step_hold(-40e3, 8.0, 5.0), repeat=2),
    own.step_hold(-20e3, 8.0, 5.0),
    own.triangle(-40e3, 6.0, 1, 5.0),
]
WEAKER = [
    replace(leg, quantity_tables={q: (t, 0.5 * v) for q, (t, v) in leg.quantity_tables.items()}) for leg in SUCTION
]
ROBOT = [
    own.direction_cycles(0.0, 0.0, 1.2e-3, 8.0, 1),
    own.direction_cycles(np.pi / 2, 0.0, 1.2e-3, 8.0, 1),
    own.direction_cycles(0.0, 0.0, 1.2e-3, 3.0, 2),
]


def session(instrument: str, effect: str = "", seed: int = 11, **values: float) -> list[Recording]:
    acting = [(effects(instrument)[effect], values)] if effect else []
    rng = np.random.default_rng(seed)
    if instrument == "microrobot":
        return own.robot_session(rng, acting, legs=ROBOT)
    return own.suction_session(instrument, rng, acting, legs=SUCTION if instrument == "cutometer" else WEAKER)


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("overshoot", {"overshoot": 0.38, "slowness": 0.13}),
        # Of which a fit tried a rate's limit with a lag of 1e-8 s, and took hours:
        ("regulator_lag", {"tau": 0.5}),
    ],
)
def test_what_a_strained_regulator_of_another_make_does_as_well_is_named(effect: str, values: dict[str, float]) -> None:
    """That regulator strains its tolerances by 25 to 50 of χ², and no gap is left to shrink."""
    report = as_json(diagnose(session("cutometer", effect, **values)))
    first = report["causes"][0]
    assert report["verdict"] == "effect"
    assert effect in first["class"]
    assert first["detectability"] > 5


@pytest.mark.parametrize(
    ("instrument", "effect", "values"),
    [
        ("cutometer", "regulator_lag", {"tau": 0.3, "form": 3}),
        ("aspiration", "leak", {"shortfall": 0.12}),
        ("microrobot", "latency", {"delay": 0.07}),
        # The simulation by itself strains its tolerances or its skin for this:
        ("cutometer", "wrong_zeroing", {"delay": 5.3}),
        ("cutometer", "jitter", {"sigma": 7e-3, "channel": 1}),
        ("aspiration", "late_samples", {"fraction": 0.2, "channel": 1, "form": 1, "delay": 0.03}),
    ],
)
def test_a_strong_effect_is_named_with_its_stage(instrument: str, effect: str, values: dict[str, float]) -> None:
    report = as_json(diagnose(session(instrument, effect, **values)))
    first = report["causes"][0]
    assert report["verdict"] in ("effect", "several")
    assert effect in {n for name in first["class"] for n in name.split(" + ")}
    assert report["where"][0]["stage"] == effects(instrument)[effect].stage
    assert first["detectability"] > 10
    by_chance = effects(instrument)[effect].scatter is not None  # only widens the noise
    if (
        instrument != "microrobot" and not by_chance
    ):  # whose recomputed channels, exact to their rounding, thin its gap out
        assert first["shrink"]["fitted"] > 0.8
        assert first["shrink"]["waveform"] > 0.8


@pytest.mark.parametrize("instrument", ["cutometer", "aspiration"])
def test_a_sound_actuator_is_not_accused(instrument: str) -> None:
    report = as_json(diagnose(session(instrument)))
    assert not any(c["probability"] > 0.5 and set(c["stages"]) == {"actuator"} for c in report["causes"])
    assert report["gap"]["before"] == pytest.approx(1.0, abs=0.25)


def spoiled(recording: Recording, channel: str, change) -> Recording:
    series = recording.streams[channel]
    return replace(recording, streams={**recording.streams, channel: change(series)})


def test_samples_that_are_not_numbers_are_left_out_and_told() -> None:
    recordings = session("cutometer")

    def holes(series):
        value = series.value.copy()
        value[100:160] = np.nan
        return replace(series, value=value)

    diagnosis = diagnose([spoiled(recordings[0], "pressure", holes), *recordings[1:]])
    assert any("pressure has 60 of" in r for r in diagnosis.remarks)
    assert np.isfinite(diagnosis.verdict.posterior.gap_before)


def test_a_missing_height_still_gives_the_actuator() -> None:
    lagging = [
        replace(r, streams={"pressure": r.streams["pressure"]}) for r in session("cutometer", "regulator_lag", tau=0.3)
    ]
    report = as_json(diagnose(lagging))
    assert "regulator_lag" in report["causes"][0]["class"]


def test_one_recording_alone_says_what_cannot_be_tested() -> None:
    diagnosis = diagnose(session("cutometer")[:1])
    assert any("one recording only" in r for r in diagnosis.remarks)


def test_what_cannot_be_diagnosed_is_refused_by_name() -> None:
    cutometer = session("cutometer")
    with pytest.raises(DiagnosisError, match="no recording"):
        diagnose([])
    with pytest.raises(DiagnosisError, match="several instruments \\(aspiration, cutometer\\)"):
        diagnose([cutometer[0], session("aspiration")[0]])
    with pytest.raises(DiagnosisError, match="has no measured channel"):
        diagnose([replace(cutometer[0], streams={})])
    with pytest.raises(ValueError, match="no set-points of pressure"):
        diagnose([replace(cutometer[0], setpoints={})])
    strange = replace(cutometer[0].streams["pressure"])
    with pytest.raises(ValueError, match="neither channel pressure nor apex_height"):
        diagnose([replace(cutometer[0], streams={"temperature": strange})])
    with pytest.raises(DiagnosisError, match=r"'balance' has no built-in forward model: give one with --model"):
        diagnose([replace(cutometer[0], info=replace(cutometer[0].info, instrument="balance"))])
    with pytest.raises(ValueError, match="no set-points of probe_x"):
        diagnose([replace(session("microrobot")[0], setpoints={})])


def test_too_few_samples_are_refused(recording) -> None:
    class Rig:
        name, channels, stages, parameters = "rig", ("force",), {"force": "sensor"}, ()

        def simulate(self, time, data, parameters, tap):
            return {"force": tap("force", 0 * time)}

    time = np.arange(5.0)
    with pytest.raises(ModelError, match="channel force has 5 samples; 20 are needed"):
        diagnose([recording({"force": time}, time, instrument="rig")], model=Rig())


def test_recordings_in_any_order_give_the_same_answer() -> None:
    recordings = session("cutometer", "regulator_lag", tau=0.3)
    forth, back = (as_json(diagnose(r)) for r in (recordings, recordings[::-1]))
    assert forth["recordings"] == back["recordings"]
    assert forth["causes"][0]["probability"] == back["causes"][0]["probability"]


def test_clocks_that_begin_anew_are_told() -> None:
    anew = []
    for r in session("cutometer"):
        first = r.streams["pressure"].time[0]
        shifted = {n: replace(s, time=s.time - first) for n, s in r.streams.items()}
        commands = {n: replace(s, time=s.time - first) for n, s in r.setpoints.items()}
        anew.append(replace(r, info=replace(r.info, start_time=""), streams=shifted, setpoints=commands))
    diagnosis = diagnose(anew)
    assert any("rests of 45 s" in r for r in diagnosis.remarks)
    assert diagnosis.verdict.posterior.gap_before < 2
