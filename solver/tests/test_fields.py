"""Fields: what they say agrees with the channels and with the loads, and other programs read their files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest

from skinrig_solver import Experiment, models
from skinrig_solver.export import file_name, write
from skinrig_solver.fit.pictures import largest_load

TIME = np.linspace(0.0, 8.0, 81)
SUCTION = -2e4
HOLD = Experiment(
    "cutometer", TIME, {"pressure": SUCTION * np.interp(TIME, [0, 0.5, 4, 4.5, 8], [0, 1, 1, 0, 0])},
    {"mesh": 0.7, "zero_at_start": False}, snapshots=(0.0, 0.3, 2.0, 5.7),
)  # fmt: skip
PULL = Experiment("microrobot", TIME, {"probe_x": 1e-3 * np.sin(TIME)}, {"radial": 4}, snapshots=(0.0, 1.5))


def test_the_apex_moves_as_the_channel_says_also_between_steps() -> None:
    result = models()["suction_yeoh_qlv"].simulate(HOLD, {})
    for field in result.fields:
        apex = int(np.argmin(np.hypot(*field.nodes.T)))
        height = float(np.interp(field.time, TIME, result.channels["apex_height"]))
        assert field.displacement[apex, 1] - result.notes["probe_height"] == pytest.approx(height, abs=2e-8)
    assert [field.time for field in result.fields] == [0.0, 0.3, 2.0, 5.7]


def test_stress_at_the_free_surface_is_the_suction() -> None:
    field = models()["suction_yeoh_qlv"].simulate(HOLD, {}).fields[2]
    dome = np.flatnonzero((field.nodes[:, 1] == 0.0) & (field.nodes[:, 0] < 0.5 * 2e-3))
    normal = field.values["cauchy_stress"][dome, 1]
    assert normal.mean() == pytest.approx(-SUCTION, rel=0.05)
    assert field.values["stress_max"][dome].min() > 0.8 * -SUCTION
    assert field.values["stress_von_mises"].min() >= 0.0
    assert np.abs(field.values["volume_ratio"] - 1.0).mean() < 0.02  # nearly incompressible
    assert {n for n in field.values if n.startswith("history_")} >= {"history_S_rr", "history_h3_tt"}


def test_a_sheet_at_rest_carries_its_pre_stress() -> None:
    result = models()["sheet_yeoh"].simulate(PULL, {})
    rest, pulled = result.fields
    x, y = result.notes["prestretch_x"], result.notes["prestretch_y"]
    sx = models()["sheet_yeoh"].info["sx"].default
    volume = rest.values["volume_ratio"]
    assert rest.values["cauchy_stress"][:, 0] == pytest.approx(sx * x / volume, rel=1e-6)  # sx is a nominal stress
    assert rest.values["stretch_max"] == pytest.approx(max(x, y), rel=1e-6)
    assert pulled.values["stress_max"].max() > 1.2 * rest.values["stress_max"].max()


def test_layers_share_no_nodes_so_stress_may_jump() -> None:
    run = replace(HOLD, snapshots=(2.0,), geometry={"mesh": 0.7})
    field = models()["suction_rubin_bodner"].simulate(run, {}).fields[0]
    skin, smas = (np.unique(field.cells[field.layer == k]) for k in (0, 1))
    assert not set(skin) & set(smas)
    depth = field.nodes[skin, 1].min()
    inside = [n[np.isclose(field.nodes[n, 1], depth)] for n in (skin, smas)]
    assert np.allclose(field.displacement[inside[0]], field.displacement[inside[1]])
    hoop = [field.values["cauchy_stress"][n, 2].mean() for n in inside]
    assert abs(hoop[0] - hoop[1]) > 10.0


@pytest.mark.parametrize(("model", "run"), [("suction_yeoh_qlv", HOLD), ("sheet_yeoh", PULL)])
def test_files_read_back(tmp_path: Path, model: str, run: Experiment) -> None:
    fields = models()[model].simulate(run, {}).fields
    files = write(fields, tmp_path, "run")
    read = meshio.read(tmp_path / "run_0001.vtu")
    assert read.cells[0].type == "quad9"
    assert np.array_equal(read.cells[0].data, fields[1].cells)
    assert np.allclose(read.point_data["cauchy_stress"], fields[1].values["cauchy_stress"])
    assert np.allclose(read.points[:, : fields[1].nodes.shape[1]], fields[1].nodes)
    with meshio.xdmf.TimeSeriesReader(tmp_path / "run.xdmf") as series:
        points, cells = series.read_points_cells()
        steps = [series.read_data(k) for k in range(series.num_steps)]
    assert [time for time, *_ in steps] == list(run.snapshots)
    assert np.allclose(points, read.points)
    assert cells[0].type == "quad9"
    assert np.allclose(steps[1][1]["stretch_max"], fields[1].values["stretch_max"])
    index = json.loads((tmp_path / "run.json").read_text())
    assert {q["name"] for q in index["quantities"]} == {*read.point_data, *read.cell_data}
    assert [entry["time"] for entry in index["times"]] == list(run.snapshots)
    assert all(file.parent == tmp_path and file.exists() for file in files)


def test_mid_nodes_reach_vtk_as_curves(tmp_path: Path) -> None:
    vtk = pytest.importorskip("vtk")
    fields = models()["suction_yeoh_qlv"].simulate(HOLD, {}).fields
    write(fields, tmp_path, "run")
    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(tmp_path / "run_0002.vtu"))
    reader.Update()
    grid = reader.GetOutput()
    assert grid.GetCellType(0) == vtk.VTK_BIQUADRATIC_QUAD
    assert grid.GetNumberOfCells() == len(fields[2].cells)
    corners, middle = fields[2].cells[0, :2], fields[2].cells[0, 4]  # VTK: the fifth node lies between the first two
    assert np.allclose(fields[2].nodes[middle], fields[2].nodes[corners].mean(axis=0))


def test_a_time_outside_the_run_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match=r"snapshot at 9.0 s lies outside 0 to 8 s"):
        replace(HOLD, snapshots=(9.0,))
    with pytest.raises(ValueError, match="gave no fields"):
        write((), Path(), "run")
    assert file_name("a/b: c") == "a_b_c"
    assert largest_load(HOLD) == pytest.approx(0.5)
