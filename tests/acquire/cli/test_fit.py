"""``acquire fit``: without a solver it says what is missing; with one, the result reaches files and terminal."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acquire import plugins
from acquire.cli import app
from acquire.recording import Recording, RunInfo, Series, write_recording


class Result:
    """As much of a fit's result as the command uses."""

    def __init__(self, arguments: dict[str, Any]) -> None:
        self.arguments = arguments

    def as_dict(self) -> dict[str, Any]:
        return {"schema": "skinrig-fit/1", **self.arguments}

    def in_words(self) -> str:
        return "it fits"

    def write_page(self, path: Path) -> Path:
        path.write_text("<!doctype html>")
        return path

    def write_fields(self, folder: Path, times: tuple[float, ...]) -> list[Path]:
        folder.mkdir()
        (folder / "times").write_text(str(times))
        return [folder / "times"]


class Solver:
    """A plugin that reports what it was asked."""

    def models(self) -> dict[str, Any]:
        return {"sheet": None, "suction": None}

    def fit(self, recordings: list[Recording], spec: Path | None, **options: Any) -> Result:
        options.pop("progress")
        if options["model"] == "none":
            raise ValueError("model: there is no 'none'")
        return Result({"runs": [r.info.id for r in recordings], "spec": str(spec), **options})

    def compare(self, recordings: list[Recording], laws: list[str], **options: Any) -> Result:
        options.pop("progress")
        return Result({"runs": [r.info.id for r in recordings], "laws": laws, **options})


@pytest.fixture
def run(tmp_path: Path) -> Path:
    time = np.arange(10.0)
    pressure = Series(-1e3 * time, time, "Pa")
    info = RunInfo("a-run", "cutometer", "2026-01-01T00:00:00+00:00")
    return write_recording(Recording(info, {"pressure": pressure}), tmp_path / "a.h5")


def with_solvers(monkeypatch: pytest.MonkeyPatch, *found: plugins.Plugin) -> None:
    plain, solvers = PLUGINS, {p.name: p for p in found}
    monkeypatch.setattr(plugins, "plugins", lambda group: solvers if group == "acquire.solvers" else plain(group))


PLUGINS = plugins.plugins
WORKING = plugins.Plugin("acquire.solvers", "skinrig", "a:b", Solver)
BROKEN = plugins.Plugin("acquire.solvers", "other", "c:d", error="ImportError: no numba")


def test_without_a_solver_it_says_what_is_missing(
    monkeypatch: pytest.MonkeyPatch, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with_solvers(monkeypatch)
    assert app.run(["fit", str(run), "--model", "suction"]) == app.BAD_INPUT
    assert "pip install ./solver" in capsys.readouterr().err
    with_solvers(monkeypatch, BROKEN)
    assert app.run(["fit", str(run), "--model", "suction"]) == app.BAD_INPUT
    assert "does not load: ImportError: no numba" in capsys.readouterr().err


def test_result_goes_to_files_or_to_stdout(
    monkeypatch: pytest.MonkeyPatch, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with_solvers(monkeypatch, BROKEN, WORKING)
    out = tmp_path / "deep" / "out"
    assert app.run(["fit", str(run), str(run), "--model", "suction", "--jobs", "2", "-o", str(out)]) == app.DONE
    data = json.loads((out / "fit.json").read_text())
    assert data["runs"] == ["a-run", "a-run"]
    assert (data["model"], data["jobs"], data["cluster"]) == ("suction", 2, "")
    assert (out / "fit.html").exists()
    assert "it fits" in capsys.readouterr().out
    assert app.run(["fit", str(run), "--model", "suction", "--json"]) == app.DONE
    assert json.loads(capsys.readouterr().out)["schema"] == "skinrig-fit/1"


def test_fields_go_to_their_folder_at_the_times_named(
    monkeypatch: pytest.MonkeyPatch, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with_solvers(monkeypatch, WORKING)
    folder, out = tmp_path / "fields", tmp_path / "out"
    asked = ["fit", str(run), "--model", "suction", "-o", str(out), "--fields", str(folder), "--times", "0.5, 5 s,60"]
    assert app.run(asked) == app.DONE
    assert (folder / "times").read_text() == "(0.5, 5.0, 60.0)"
    assert "1 files of fields" in capsys.readouterr().out


def test_laws_are_compared_by_name(
    monkeypatch: pytest.MonkeyPatch, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with_solvers(monkeypatch, WORKING)
    asked = ["fit", str(run), "--model", "suction", "--compare", "sheet, suction", "--jobs", "2", "-o", str(tmp_path)]
    assert app.run(asked) == app.DONE
    data = json.loads((tmp_path / "compare.json").read_text())
    assert (data["laws"], data["jobs"]) == (["suction", "sheet", "suction"], 2)
    assert "it fits" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["RUN", "--model", "suction", "--compare", "nope"], "no model 'nope'"),
        (["RUN", "--spec", "fit.yaml", "--compare", "sheet"], "--compare goes with --model"),
        (["--model", "suction"], "at least one recording"),
        (["RUN"], "needs --model or --spec; models are sheet, suction"),
        (["RUN", "--model", "none"], "there is no 'none'"),
        (["RUN", "--model", "suction", "--times", "soon"], "--times 'soon': expected seconds"),
        (["missing.h5", "--model", "suction"], "missing.h5"),
        (["--list", "--model", "nope"], "no model 'nope'"),
    ],
)
def test_bad_input_is_said_with_status_2(
    monkeypatch: pytest.MonkeyPatch, run: Path, arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with_solvers(monkeypatch, WORKING)
    assert app.run(["fit", *(str(run) if a == "RUN" else a for a in arguments)]) == app.BAD_INPUT
    assert words in capsys.readouterr().err


def bundle(folder: Path, pressure_unit: str) -> Path:
    """A bundle of a Cutometer, with a channel that it does not have."""
    folder.mkdir()
    rows = "\n".join(f"{0.1 * k:.1f},{-30 * k},{0.03 * k},1" for k in range(11))
    (folder / "data.csv").write_text(f"t,p,h,x\n{rows}\n")
    (folder / "recording.yaml").write_text(
        "schema: recording-bundle/1\ninstrument: cutometer\nchannels:\n"
        f"  pressure: {{file: data.csv, column: p, unit: {pressure_unit}, time: {{column: t, unit: s}}}}\n"
        "  apex_height: {file: data.csv, column: h, unit: mm, time: {column: t, unit: s}}\n"
        "  colour: {file: data.csv, column: x, unit: '1', time: {column: t, unit: s}}\n"
    )
    return folder


def test_a_bundle_is_told_about_as_by_an_import(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with_solvers(monkeypatch, WORKING)
    right, wrong = bundle(tmp_path / "right", "mbar"), bundle(tmp_path / "wrong", "Pa")
    assert app.run(["fit", str(right), str(run), "--model", "suction", "--json"]) == app.DONE
    told = capsys.readouterr().err
    assert "pressure -300 to 0 mbar, apex_height 0 to 0.3 mm" in told
    assert "warning: colour: kept, but not among the channels of the cutometer" in told
    assert "a-run" not in told
    assert app.run(["import", str(right), "-o", str(tmp_path / "right.h5")]) == app.DONE
    for line in capsys.readouterr().err.splitlines():
        assert line.split(": ", 1)[1] in told
    assert app.run(["fit", str(wrong), "--model", "suction", "--json"]) == app.DONE
    assert "channel pressure reaches 3 mbar only: is its unit right?" in capsys.readouterr().err


def test_bounds_are_listed_as_a_person_reads_them(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("skinrig_solver")
    for model in ("suction_yeoh_qlv", "suction_rubin_bodner", "sheet_bischoff"):
        assert app.run(["fit", "--list", "--model", model]) == app.DONE
    lines = {line.split()[0]: " ".join(line.split()) for line in capsys.readouterr().out.splitlines()}
    assert lines["G"] == "G 20 kPa 100 Pa … 10 MPa instantaneous shear modulus, 2 c10"
    assert "10 kPa 0 Pa … 10 MPa second Yeoh coefficient; down to -1 MPa if asked" in lines["c20"]
    assert lines["nu"].startswith("nu 0.49 0.3 … 0.49999 ")
    assert "1.34 Hz 10⁻⁸ Hz … 10000 Hz" in lines["skin.Gamma1"]
    assert lines["n"].startswith("n 6.632·10²³ 1/m^3 10¹⁶ 1/m^3 … 10²⁸ 1/m^3")
    assert not any(re.search(r"\de[+-]\d", line) for line in lines.values())


def test_the_installed_solver_lists_its_models(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("skinrig_solver")
    assert app.run(["fit", "--list"]) == app.DONE
    assert "suction_yeoh_qlv" in capsys.readouterr().out
    assert app.run(["fit", "--list", "--model", "suction_yeoh_qlv", "--json"]) == app.DONE
    (model,) = json.loads(capsys.readouterr().out)
    assert {"symbol", "unit", "lower", "upper", "default"} <= set(model["parameters"][0])
