"""Terms for what no known effect explains: found, tested on withheld recordings, saved and tried again."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from typer.testing import CliRunner

from acquire.cli.gap import app
from acquire.recording import write_bundle
from acquire.recording.model import Recording, RunInfo, Series
from gap.data.splits import splits_of_a_rig
from gap.decision.settle import Case
from gap.decision.thresholds import INSTRUMENT, RIG
from gap.decision.transfer import plain
from gap.design import simulated as own
from gap.diagnosis import Options, diagnose, gathered
from gap.effects.load import generic, library
from gap.null.robot_reference import ReferenceForceBlock
from gap.rig.problem import RigProblem
from gap.search.compare import Effort, compare
from gap.terms.dictionary import choices
from gap.terms.parts import ERROR, INPUT, OWN, START, Part, Place
from gap.terms.propose import Proposal, best_term, errors_of
from gap.terms.term import Term, as_effect, save_term
from sim_devices.chain import Parameter
from sim_devices.stages import nominal

EXAMPLE = Path(__file__).parents[3] / "examples/user_effect/pump_warm_up.py"
TIME = np.linspace(0.0, 10.0, 1001)
WAVES = (
    lambda t: np.sin(1.3 * t),
    lambda t: 0.8 * np.sin(0.9 * t) + 0.3 * np.sin(3.1 * t),
    lambda t: np.clip(np.sin(2 * t), -0.6, 0.6),
)
MASS, DRAG = 2.0, 1.2


class Cart:
    """Force = mass · acceleration, with a tap on a drag that it does not have."""

    name = "cart"
    channels = ("force",)
    stages: ClassVar = {"drag": "actuator"}
    units: ClassVar = {"drag": "N"}
    parameters = (Parameter("mass", "kg", 0.1, 10.0, None, 1.0, "log"),)

    def simulate(self, time, data, parameters, tap):
        v = data["velocity"]
        return {"force": parameters["mass"] * np.gradient(v, time) + tap("drag", 0 * v, velocity=v)}


def driven(drag, noise: float = 0.05) -> list[Recording]:
    """A cart on three waveforms with a ``drag`` (a function of velocity, N)."""
    out = []
    for k, wave in enumerate(WAVES):
        v = wave(TIME)
        force = MASS * np.gradient(v, TIME) + drag(v) + noise * np.random.default_rng(k).normal(size=len(TIME))
        streams = {"force": Series(force, TIME, "N"), "velocity": Series(v, TIME, "m/s")}
        out.append(Recording(RunInfo(f"r{k}", "cart", ""), streams, {"speed": Series(v, TIME, "m/s")}))
    return out


def proposed(recordings: list[Recording]) -> Proposal:
    """The best term on top of the model by itself, no effect being tried."""
    comparison = compare([RigProblem(recordings, Cart())], [])
    null = plain(comparison.problems, comparison.null)
    made = best_term(Case(comparison, (), (), null, splits_of_a_rig(recordings), {}), RIG)
    assert made is not None
    return made


@pytest.mark.parametrize(("function", "power"), [("x^2", 2), ("x^3", 3)])
def test_a_drag_that_the_model_lacks_is_found_with_its_coefficient(function: str, power: int) -> None:
    p = proposed(driven(lambda v: DRAG * v**power))
    assert p.helps
    assert p.term is not None
    (part,), (amount,), (error,) = p.term.parts, p.term.amounts, p.errors
    assert (part.of, part.function, part.tau) == ("velocity", function, 0.0)
    assert abs(amount / part.scale**power - DRAG) < 3.5 * error / part.scale**power
    assert error < 0.01 * amount
    assert p.shrinks["waveform"].after == pytest.approx(1.0, abs=0.05)


def test_noise_alone_needs_no_term() -> None:
    p = proposed(driven(lambda v: 0.0 * v))
    assert not p.helps
    assert p.term is None
    assert "no" in p.reason


def test_what_happens_in_one_recording_is_no_law() -> None:
    recordings = driven(lambda v: 0.0 * v)
    for k, r in enumerate(recordings):  # bursts that nothing foretells
        burst = np.random.default_rng(90 + k).normal(size=len(TIME)).cumsum()
        r.streams["force"].value[:] += 0.3 * (burst - np.convolve(burst, np.ones(99) / 99, "same"))
    p = proposed(recordings)
    assert not p.helps
    assert p.reason


def test_a_saved_term_is_an_effect_that_closes_the_gap(tmp_path: Path) -> None:
    recordings = driven(lambda v: DRAG * v**2)
    for r in recordings:
        write_bundle(r, tmp_path / "session" / r.info.id)
    model = tmp_path / "cart.py"
    model.write_text(
        "import numpy as np\nfrom sim_devices.chain import Parameter\n\n\nclass Cart:\n"
        "    name, channels, stages, units = 'cart', ('force',), {'drag': 'actuator'}, {'drag': 'N'}\n"
        "    parameters = (Parameter('mass', 'kg', 0.1, 10.0, None, 1.0, 'log'),)\n\n"
        "    def simulate(self, time, data, p, tap):\n        v = data['velocity']\n"
        "        return {'force': p['mass'] * np.gradient(v, time) + tap('drag', 0 * v, velocity=v)}\n"
    )
    saved = tmp_path / "lift.py"
    asked = ["diagnose", str(tmp_path / "session"), "--model", f"{model}:Cart", "--jobs", "1", "--json"]
    first = CliRunner().invoke(app, [*asked, "--term", str(saved), "-o", str(tmp_path / "out")])
    assert first.exit_code == 0, first.output
    report = json.loads(first.stdout)
    assert report["verdict"] == "unknown"
    assert report["term"]["helps"]
    assert report["term"]["shrink"]["waveform"] > 0.9
    assert "(velocity / 1.1)²" in report["term"]["formula"]
    assert "by 100 % on another waveform" in report["term"]["text"]
    assert report["term"]["text"] in (tmp_path / "out" / "gap.html").read_text().replace("&#39;", "'")
    second = CliRunner().invoke(app, [*asked, "--effects", str(saved)])
    report = json.loads(second.stdout)
    assert report["verdict"] == "effect"
    assert report["causes"][0]["effects"] == ["term_at_drag"]
    assert report["gap"]["after"] < 1.05
    assert report["term"] is None
    fitted = report["causes"][0]["parameters"]["amount"]
    assert fitted["value"] / 1.0966**2 == pytest.approx(DRAG, rel=0.01)


def test_what_cannot_be_saved_or_loaded_is_told(tmp_path: Path) -> None:
    nothing = tmp_path / "nothing.py"
    nothing.write_text("X = 1\n")
    with pytest.raises(ValueError, match=r"nothing.py: it defines no gap.GenericEffect"):
        diagnose(driven(lambda v: 0.0 * v), Cart(), user_effects=[nothing])


PLACE = Place(
    "regulator", "actuator", "Pa", 4e4, ("line_pressure",), ("setpoint_pressure",),
    {OWN: "pressure", INPUT: "set-point", ERROR: "error"}, {OWN: "Pa", INPUT: "Pa", ERROR: "Pa"}, ("pressure",),
)  # fmt: skip
PARTS = (Part(OWN, "x|x|", 4e4, tau=1.5), Part(ERROR, "x", 4e4), Part(OWN, "sgn x", 1e5, rate=True))


def test_a_term_acts_in_a_chain_and_at_none_changes_nothing() -> None:
    time = np.arange(0.0, 4.0, 1e-3)
    command = {"command_pressure": np.where(time > 0.5, -4e4, 0.0)}
    term = Term(PLACE, PARTS, (-800.0, 300.0, 20.0))
    effect = as_effect(term, ("cutometer",))
    chain = nominal("cutometer")
    before = chain.run(time, command)["line_pressure"]
    values = {p.name: p.default for p in effect.parameters}
    assert effect.apply(chain, values | {"amount": 0.0}).run(time, command)["line_pressure"] == pytest.approx(before)
    after = effect.apply(chain, values).run(time, command)["line_pressure"]
    # At rest at -40 kPa: the lagged square is -(1 - e^(-(3.5 - some delay)/1.5)), the error and the rate are nought.
    expected = 800.0 * (1.0 - np.exp(-(time[-1] - 0.5 - 0.08) / 1.5))
    assert (after - before)[-1] == pytest.approx(expected, rel=0.01)
    doubled = effect.apply(chain, values | {"amount": -1600.0}).run(time, command)["line_pressure"]
    assert doubled - before == pytest.approx(2.0 * (after - before))


def test_parts_join_chunks_without_a_seam() -> None:
    time = np.linspace(0.0, 3.0, 301)
    x = np.sin(4 * time)
    for part in (*PARTS, Part(OWN, "x^3", 0.5, times=INPUT, times_scale=2.0)):
        signals = {OWN: x, ERROR: 1 - x, INPUT: np.cos(time)}
        whole = part.value({}, time, signals, part.tau)
        memory: dict = {}
        pieces = [
            part.value(memory, time[k], {s: v[k] for s, v in signals.items()}, part.tau)
            for k in np.split(np.arange(len(time)), [1, 2, 140])
        ]
        assert np.concatenate(pieces)[2:] == pytest.approx(whole[2:])


def test_a_file_says_what_it_does_and_loads_alone(tmp_path: Path) -> None:
    term = Term(PLACE, PARTS, (-800.0, 300.0, 20.0))
    path = save_term(term, tmp_path / "term.py", "cutometer")
    assert "− 800 Pa · [(pressure / 40000 Pa)·|pressure / 40000 Pa|], late by 1.5 s" in path.read_text()
    loaded = library("cutometer", [path])["term_at_regulator"]
    assert [p.default for p in loaded.parameters] == [p.default for p in as_effect(term, ("cutometer",)).parameters]
    with pytest.raises(ValueError, match="no effect for instrument microrobot"):
        library("microrobot", [path])
    with pytest.raises(ValueError, match="GenericEffect"):
        generic([path])


@pytest.mark.slow
def test_a_pump_that_is_weak_while_cold_is_described_and_then_named(tmp_path: Path) -> None:
    """The session of examples/user_effect: 8 % of the pressure lack at first, dying out within 40 s."""
    cold = library("cutometer", [EXAMPLE])["pump_warm_up"]
    legs = [
        own.step_hold(-40e3, 10.0, 5.0),
        replace(own.step_hold(-40e3, 10.0, 5.0), repeat=2),
        own.step_hold(-20e3, 10.0, 5.0),
        own.triangle(-40e3, 8.0, 1, 5.0),
    ]
    values = {"shortfall": 0.08, "warming": 40.0}
    session = own.suction_session("cutometer", np.random.default_rng(1), [(cold, values)], legs=legs)
    case, _ = gathered(session, Options(effort=Effort().quicker()))
    found = best_term(case, INSTRUMENT)
    assert found is not None
    assert found.helps
    assert found.term is not None
    (part,), (amount,) = found.term.parts, found.term.amounts
    assert (part.of, part.times) == (OWN, START)
    assert amount / part.scale == pytest.approx(-0.08, rel=0.03)
    assert part.tau == pytest.approx(40.0, rel=0.03)
    path = save_term(found.term, tmp_path / "cold.py", "cutometer")
    second = diagnose(session, quick=True, user_effects=[path])
    assert second.verdict.claims
    assert second.verdict.causes[0].names[0] == "term_at_regulator"
    assert second.gap_after < 0.1 * second.gap_before
    assert second.term is None


def test_a_robot_on_a_reference_has_no_place_for_a_term() -> None:
    """Its block is named as that of a suction instrument's references, which have one at the optics."""
    block = object.__new__(ReferenceForceBlock)
    block.session = SimpleNamespace(instrument="microrobot")
    block.measured = np.ones(9)
    assert choices({"reference": block}) == []


def test_a_term_that_the_fit_took_away_has_an_error() -> None:
    """An amount of nought ended a diagnosis with a division by zero."""
    assert errors_of((0.2, -0.1), 0.05) == pytest.approx((0.05, 0.025))
    assert errors_of((0.0, 0.0), 0.05) == (0.05, 0.05)
