"""CSV and MATLAB exports, curves through a column map, the catalogue, and the commands around them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat
from typer.testing import CliRunner

from acquire.catalogue import catalogue
from acquire.cli.app import application
from acquire.recording import JournalWriter, RecordingError, load, open_info, open_recording, write_recording
from acquire.recording.curves_import import read_curves
from acquire.recording.export import write_csv, write_mat
from acquire.recording.model import difference
from tests.acquire.recording.samples import sample_recording
from tests.acquire.recording.test_bundle import DATA, make


def test_csv(tmp_path: Path) -> None:
    recording = sample_recording()
    (path,) = write_csv(recording, tmp_path / "a.csv")
    header, first, *_ = path.read_text().splitlines()
    assert header == "time [s],pressure [Pa],apex_height [m],commanded pressure [Pa]"
    assert first == "0.0,-30000.0,0.0,-30000.0"
    values = np.loadtxt(path, delimiter=",", skiprows=1)
    assert np.array_equal(values[:, 2], recording.streams["apex_height"].value)
    assert np.array_equal(values[:, 3], np.where(values[:, 0] < 15, -3e4, 0))
    with pytest.raises(FileExistsError):
        write_csv(recording, path)
    with pytest.raises(RecordingError, match="no channels"):
        write_csv(replace(recording, streams={}), tmp_path / "b.csv")


def test_mat(tmp_path: Path) -> None:
    recording = sample_recording()
    content = loadmat(write_mat(recording, tmp_path / "a.mat"), simplify_cells=True)
    assert np.array_equal(content["streams"]["pressure"]["value"], recording.streams["pressure"].value)
    assert content["streams"]["apex_height"]["unit"] == "m"
    assert content["frames"]["data"].shape == (5, 24, 32)
    assert content["run"]["subject"] == "P07"


EXPORT = "Time [s];Curve 1;Curve 2;Pressure\n0,00;0;0;0\n0,01;0,1;0,2;300\n0,02;0,12;0,21;300\n"
MAP = """schema: column-map/1
time: {column: 'Time [s]', unit: s}
channels:
  apex_height: {column: 'Curve *', unit: mm}
  pressure: {column: Pressure, unit: mbar, suction: positive}
subject: 7
"""


def test_exported_curves(tmp_path: Path) -> None:
    (tmp_path / "export.csv").write_text(EXPORT)
    (tmp_path / "map.yaml").write_text(MAP)
    first, second = read_curves(tmp_path / "export.csv", tmp_path / "map.yaml")
    assert np.allclose(first.stream("apex_height").value, [0, 1e-4, 1.2e-4])
    assert np.allclose(second.stream("apex_height").value, [0, 2e-4, 2.1e-4])
    assert np.allclose(second.stream("pressure").value, [0, -3e4, -3e4])
    assert (first.info.repeat, second.info.repeat) == (1, 2)
    assert first.info.subject == "7"
    assert first.info.id == "import-export-1"
    assert not first.events


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("Curve *", "Kurve *", r"export\.csv: no column fits 'Kurve \*'; there is Time \[s\], Curve 1"),
        ("unit: mm", "unit: m m m", r"map\.yaml:4:\d+: channels\.apex_height\.unit|'m m m' is m\^3"),
        ("suction: positive", "suction: up", r"map\.yaml:5:\d+: channels\.pressure\.suction"),
    ],
)
def test_faulty_maps(tmp_path: Path, old: str, new: str, message: str) -> None:
    (tmp_path / "export.csv").write_text(EXPORT)
    (tmp_path / "map.yaml").write_text(MAP.replace(old, new))
    with pytest.raises(RecordingError, match=message):
        read_curves(tmp_path / "export.csv", tmp_path / "map.yaml")


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    folder = tmp_path / "runs"
    for number, site in enumerate(["forehead", "cheek"], start=1):
        recording = sample_recording(300, run_id=f"r{number}", frames=0)
        info = replace(recording.info, site=site, repeat=number, start_time=f"2026-01-0{3 - number}T00:00:00+00:00")
        write_recording(replace(recording, info=info), folder / f"r{number}.h5")
    (folder / "broken.h5").write_bytes(b"no")
    JournalWriter(folder / "left.journal", sample_recording().info).close()
    return folder


def test_catalogue(runs: Path) -> None:
    assert [entry.path.name for entry in catalogue(runs)] == ["r2.h5", "r1.h5", "broken.h5", "left.journal"]
    assert [entry.path.name for entry in catalogue(runs, ["site=FORE"])] == ["r1.h5"]
    assert [entry.path.name for entry in catalogue(runs, ["cheek", "repeat=2"])] == ["r2.h5"]
    assert [entry.path.name for entry in catalogue(runs, ["crash"])] == ["left.journal"]
    with pytest.raises(RecordingError, match="unknown field 'sight'"):
        catalogue(runs, ["sight=x"])
    assert open_info(runs / "r1.h5").site == "forehead"


def invoke(*arguments: object, status: int = 0) -> str:
    result = CliRunner().invoke(application(), [str(argument) for argument in arguments])
    assert result.exit_code == status, result.output
    return result.stdout


def test_commands(runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert "forehead" in invoke("ls")
    assert len(json.loads(invoke("ls", "site=cheek", "--json"))) == 1
    run = runs / "r1.h5"
    assert json.loads(invoke("show", run, "--json", "--png", "a.png"))["subject"] == "P07"
    assert (tmp_path / "a.png").exists()
    assert "no sample is missing" in invoke("show", run)
    assert invoke("export", run, "-o", "x.csv").strip() == "x.csv"
    invoke("export", run, "-o", "x.mat")
    invoke("export", run, "-o", "bundle")
    written = json.loads(invoke("import", "bundle", "-o", "back.h5", "--json"))["files"]
    assert written == ["back.h5"]
    assert difference(open_recording(run), open_recording(tmp_path / "back.h5")) == ""
    assert invoke("report", run, "bundle", "-o", "page.html").strip() == "page.html"
    (tmp_path / "export.csv").write_text(EXPORT)
    (tmp_path / "map.yaml").write_text(MAP)
    assert invoke("import", "export.csv", "--map", "map.yaml", "-o", "curves").count(".h5") == 2
    assert "left.h5" in invoke("recover", runs / "left.journal")
    assert load(runs / "left.h5").info.subject == "P07"


def test_a_folder_may_be_named_as_a_first_word(runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert "forehead" in invoke("ls", runs)
    assert len(json.loads(invoke("ls", runs, "site=cheek", "--json"))) == 1
    assert "no recordings yet" in invoke("ls")


def test_a_folder_of_bundles_is_imported_in_one_call(tmp_path: Path) -> None:
    (tmp_path / "session").mkdir()
    for name in ("a", "b"):
        make(tmp_path / "session" / name)
    written = json.loads(invoke("import", tmp_path / "session", "-o", tmp_path / "runs", "--json"))["files"]
    assert len(written) == len(list((tmp_path / "runs").glob("*.h5"))) == 2
    result = CliRunner().invoke(application(), ["import", str(tmp_path / "session"), "-o", str(tmp_path / "x.h5")])
    assert "one file cannot hold 2 recordings" in str(result.exception)
    make(tmp_path / "session" / "c", {"data.csv": "t,p\nx,y\n"})
    result = CliRunner().invoke(application(), ["import", str(tmp_path / "session"), "-o", str(tmp_path / "other")])
    assert result.exit_code
    assert not (tmp_path / "other").exists()


def test_what_is_strange_about_a_bundle_is_printed_also_as_json(tmp_path: Path) -> None:
    make(tmp_path / "bundle", {"data.csv": DATA.replace("-300", "300")})
    printed = json.loads(invoke("import", tmp_path / "bundle", "-o", tmp_path / "a.h5", "--json"))
    assert printed["files"] == [str(tmp_path / "a.h5")]
    (warning,) = printed["warnings"]
    assert "warning: the pressure goes up to 300 mbar above the air's" in warning
    make(tmp_path / "sound")
    assert json.loads(invoke("import", tmp_path / "sound", "-o", tmp_path / "b.h5", "--json"))["warnings"] == []


def test_an_imported_name_does_not_lead_out_of_the_folder(tmp_path: Path) -> None:
    make(tmp_path / "bundle", run={"id": "../../evil"})
    (name,) = json.loads(invoke("import", tmp_path / "bundle", "-o", tmp_path / "runs", "--json"))["files"]
    assert Path(name).parent == tmp_path / "runs"
