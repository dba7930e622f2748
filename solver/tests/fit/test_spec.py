"""Specifications: what they free, and where they say a fault is."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skinrig_solver import models
from skinrig_solver.fit import SpecError, load_spec, read_spec, units

YEOH = models()["suction_yeoh_qlv"].info
TEXT = """\
model: suction_yeoh_qlv
parameters:
  G: {start: 12 kPa, lower: 1 kPa, upper: 200 kPa}
  nu: 0.48
  g1: free
  g2: {tied: g1, factor: 0.5}
  tau1: fixed
geometry: {rim_fillet: 0.1 mm, layers: {tissue: 2.5 mm}, probe: held}
channels: {apex_height: 2}
phases:
  - {from: 0 s, to: 500 ms, weight: 4}
  - {from: 5, to: 1 min}
recordings:
  cutometer: {weight: 0.5, geometry: {preload_time: 2 s}}
optimiser: slsqp
stages: [viscous, {name: last, free: [G]}]
profile: all
"""


def test_everything_is_read_in_si(tmp_path: Path) -> None:
    path = tmp_path / "spec.yaml"
    path.write_text(TEXT)
    spec = load_spec(path)
    variables = spec.variables(YEOH)
    assert variables.symbols == ("G", "g1")
    assert variables.free[0].start == 12e3
    assert (variables.free[0].lower, variables.free[0].upper) == (1e3, 200e3)
    assert variables.values(variables.start)["g2"] == pytest.approx(0.5 * variables.free[1].start)
    assert variables.held["nu"] == 0.48
    assert spec.geometry == {"rim_fillet": pytest.approx(1e-4), "layers": {"tissue": 2.5e-3}, "probe": "held"}
    assert [(p.start, p.stop, p.weight) for p in spec.phases] == [(0.0, 0.5, 4.0), (5.0, 60.0, 1.0)]
    assert spec.recordings[0].geometry == {"preload_time": 2.0}
    assert spec.stages[0].moving(variables.symbols) == ("g1",)
    assert spec.stages[1].moving(variables.symbols) == ("G",)
    assert spec.profile == "all"


def test_without_a_word_the_papers_parameters_are_free() -> None:
    assert read_spec({"model": "suction_yeoh_qlv"}).variables(YEOH).symbols == ("G", "c20", "g1", "tau1", "g2", "tau2")
    ogden = models()["sheet_ogden"].info
    assert read_spec({"model": "sheet_ogden"}).variables(ogden).symbols == (
        "mu1",
        "alpha1",
        "mu2",
        "alpha2",
        "sx",
        "sy",
    )
    rubin = models()["suction_rubin_bodner"].info
    assert len(read_spec({"model": "suction_rubin_bodner"}).variables(rubin).symbols) == 14  # paper W


@pytest.mark.parametrize(
    ("line", "number", "words"),
    [
        ("  G: {strat: 12 kPa}", 3, "unknown key 'strat'"),
        ("  G: {start: 12 mm}", 3, "'12 mm' is not a number in"),
        ("  G: {start: 900 kPa, upper: 200 kPa}", 3, "start 900000.0 is outside"),
        ("  G: {lower: 0}", 3, "positive lower bound"),
        ("  G: {upper: 1 GPa}", 3, "leave the model's"),
        ("  G: 1e9 Pa", 3, "outside"),
        ("  E: 12 kPa", 3, "has G, nu, c20"),
        ("  G: {tied: nu}", 3, "which is not free"),
        ("geometry: {rim_fillet: 3 kPa}", 3, "'3 kPa'"),
        ("optimizer: slsqp", 3, "unknown; there are"),
        ("optimiser: simplex", 3, "'simplex' is none of trust-region"),
        ("phases: [{from: 0}]", 3, "needs 'from' and 'to'"),
        ("phases: {from: 0}", 3, "must be a list"),
        ("stages: [plastic]", 3, "none of viscous, elastic, all"),
        ("starts: 0", 3, "whole number of at least 1"),
        ("channels: {apex_height: -1}", 3, "must not be negative"),
        ("recordings: {cutometer: {wait: 1}}", 3, "unknown key 'wait'"),
        ("  G: {start: [1}", 3, "not YAML"),
    ],
)
def test_faults_name_file_line_and_field(tmp_path: Path, line: str, number: int, words: str) -> None:
    path = tmp_path / "spec.yaml"
    path.write_text(f"model: suction_yeoh_qlv\n{'parameters:' if line.startswith(' ') else ''}\n{line}\n")
    with pytest.raises(SpecError) as caught:
        load_spec(path)
    assert words in str(caught.value)
    where, _, _ = str(caught.value).partition(": ")
    assert where in (f"{path}:{number}", f"{path}:{number - 1}")


@pytest.mark.parametrize("data", [None, [], {}, {"model": 3}, {"model": "none"}, {"model": "sheet_ogden", "x": 1}])
def test_what_is_no_specification_is_refused(data: object) -> None:
    with pytest.raises(SpecError):
        read_spec(data)


@given(st.floats(-1e12, 1e12).filter(lambda x: x == 0 or abs(x) > 1e-12), st.sampled_from(["Pa", "m", "s", "N"]))
@settings(max_examples=50, deadline=None)
def test_a_shown_number_reads_back(value: float, unit: str) -> None:
    assert units.read(units.show(value, unit, 12), unit, "x") == pytest.approx(value, rel=1e-9)
