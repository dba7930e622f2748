"""Fits of finite-element models find the truth from starts 30 % off; twenty seeds of each: benchmarks/recovery.py."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recovery import LEVEL, SETTINGS, YEOH, Setting, joint_bound, recorded, suction_steps

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


def test_the_bound_of_several_parameters_is_that_of_one_taken_together() -> None:
    random = np.random.default_rng(1)
    for count in (1, 4):
        farthest = np.abs(random.standard_normal((400_000, count))).max(axis=1)
        assert np.mean(farthest > joint_bound(count, 10**6)) == pytest.approx(LEVEL, rel=0.1)
    assert joint_bound(4, 10) > joint_bound(4, 1000) > joint_bound(1, 1000) > 3.0


def test_no_fit_ends_above_the_truth() -> None:
    """The truth's own chi-squared is never below that of the optimum, and above it by noise alone."""
    setting = SETTINGS[1]
    rise = setting.rise(setting.run(seed=2, noise=0.02, wrong=0.5), setting.recordings(2, 0.02))
    assert 0.0 < rise < 16.3  # chi-squared with four degrees of freedom: 99.7 %


def test_processes_give_what_one_process_gives() -> None:
    experiments = [suction_steps(name, (-2e4,), 1.0, 20.0, name) for name in ("cutometer", "aspiration")]
    coarse = [replace(e, geometry={"mesh": 0.4, "steps": 0.5}) for e in experiments]
    recordings = [recorded("suction_yeoh_qlv", e, YEOH, 0.01, k) for k, e in enumerate(coarse)]
    spec = {
        "model": "suction_yeoh_qlv",
        "parameters": {"G": {"start": 2.5e4}, "c20": {"start": 2e4}, "g1": YEOH["g1"], "tau1": YEOH["tau1"]},
        "geometry": {"mesh": 0.4, "steps": 0.5},
        "recordings": {"cutometer": {"geometry": {"opening_radius": 2e-3}}},  # as simulated
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
