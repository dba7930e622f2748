"""Fits of finite-element models find the truth from starts 30 % off; twenty seeds of each: benchmarks/recovery.py."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recovery import SETTINGS, YEOH, Setting, recorded, suction_steps

from skinrig_solver.fit import workers
from skinrig_solver.plugin import SkinrigSolver


@pytest.mark.parametrize("setting", SETTINGS, ids=lambda s: s.name)
def test_identifiable_parameters_are_found_within_three_standard_errors(setting: Setting, tmp_path: Path) -> None:
    result = setting.run(seed=7)
    assert result.converged
    assert result.vaf > 0.995
    errors = setting.errors(result)
    assert len(errors) >= 4
    assert max(abs(x) for x in errors.values()) < 3.0
    page = result.write_page(tmp_path / "fit.html").read_text()
    assert page.count("data:image/png;base64,") == 4  # correlations, curves, deformed mesh, stress and stretch


def test_a_start_half_wrong_is_no_trap() -> None:
    """Without a bound on c20 this fit ended in a material that loses its stability, and called it identifiable."""
    result = SETTINGS[1].run(seed=1, noise=0.02, wrong=0.5)
    errors = SETTINGS[1].errors(result)
    assert result.trusted
    assert len(errors) == 4
    assert max(abs(x) for x in errors.values()) < 3.0


def test_processes_give_what_one_process_gives() -> None:
    experiments = [suction_steps(name, (-2e4,), 1.0, 20.0, name) for name in ("cutometer", "aspiration")]
    coarse = [replace(e, geometry={"mesh": 0.4, "steps": 0.5}) for e in experiments]
    recordings = [recorded("suction_yeoh_qlv", e, YEOH, 0.01, k) for k, e in enumerate(coarse)]
    spec = {
        "model": "suction_yeoh_qlv",
        "parameters": {"G": {"start": 2.5e4}, "c20": {"start": 2e4}, "g1": YEOH["g1"], "tau1": YEOH["tau1"]},
        "geometry": {"mesh": 0.4, "steps": 0.5},
    }
    solver = SkinrigSolver()
    alone = solver.fit(recordings, spec)
    apart = solver.fit(recordings, spec, jobs=2)
    assert [e.value for e in apart.estimates] == pytest.approx([e.value for e in alone.estimates], rel=1e-6)
    assert apart.effort.forward_runs == alone.effort.forward_runs
    assert {c.instrument for c in apart.curves} == {"cutometer", "aspiration"}
    assert np.isfinite(apart.covariance).all()


def test_a_cluster_without_dask_says_what_to_install() -> None:
    try:
        import distributed  # noqa: F401
    except ImportError:
        with pytest.raises(ImportError, match="cluster"), workers(cluster="tcp://127.0.0.1:1"):
            pass
