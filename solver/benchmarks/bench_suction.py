"""Speed of the suction solver: against felupe and NGSolve, its own targets, growth with unknowns, cold and warm start.

Run with ``python benchmarks/bench_suction.py``; every figure is one thread, the fastest of several runs, in seconds.
"""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"  # before numpy is imported

import subprocess
import sys
import tempfile
from collections.abc import Callable
from time import perf_counter, process_time

import numpy as np
import peers

from skinrig_solver import Experiment, Result, models

MODEL = models()["suction_rubin_bodner"]
TWELVE = [f"{layer}.{name}" for layer in ("skin", "smas") for name in ("mu0", "q", "n", "m2", "Gamma1", "Gamma2")]


def fastest(run: Callable[[], Result], repeats: int = 5) -> tuple[Result, float, float]:
    """The result, and the smallest wall and processor seconds."""
    result, wall, cpu = run(), np.inf, np.inf
    for _ in range(repeats):
        a, b = perf_counter(), process_time()
        result = run()
        wall, cpu = min(wall, perf_counter() - a), min(cpu, process_time() - b)
    return result, wall, cpu


def against_peers() -> None:
    """The Yeoh suction without rim, each code at its coarsest mesh that is within 0.4 % of the common limit."""
    case = peers.Case(rim=False, pressure=-2e4)
    reference = peers.ours(case, 6.0, repeats=1).apex
    print(f"\nYeoh suction, {case.steps} load steps; apex of the fine mesh {1e3 * reference:.4f} mm")
    print(f"{'code':14s}{'unknowns':>10s}{'error %':>9s}{'set up s':>10s}{'solve s':>10s}")
    rows = {}
    for run in (peers.ours, peers.with_felupe, peers.with_ngsolve):
        for density in (1.0, 1.5, 2.0, 3.0, 4.0):
            try:
                timing = run(case, density, repeats=4)
            except ImportError as error:
                print(f"{run.__name__:14s}not installed: {error}")
                break
            error = abs(timing.apex / reference - 1.0)
            if error <= 4e-3:
                rows[run.__name__] = timing
                print(
                    f"{run.__name__:14s}{timing.unknowns:10d}{100 * error:9.2f}{timing.setup:10.3f}{timing.solve:10.3f}"
                )
                break
    if len(rows) > 1:
        mine = rows.pop("ours")
        solve = min(t.solve for t in rows.values()) / mine.solve
        whole = min(t.setup + t.solve for t in rows.values()) / (mine.setup + mine.solve)
        print(f"faster peer / ours: {solve:.1f} on a mesh at hand, {whole:.1f} with setting up (target 8)")


def instant(**geometry: float) -> Experiment:
    time = np.arange(0.0, 60.0 + 1e-9, 0.01)
    return Experiment("cutometer", time, {"pressure": np.where(time > 0.0, -30e3, 0.0)}, geometry)


def own_targets() -> None:
    run = instant()
    result, wall, cpu = fastest(lambda: MODEL.simulate(run, {}))
    fine = MODEL.simulate(instant(mesh=2.5, steps=6.0), {}).channels["apex_height"]
    error = np.abs(result.channels["apex_height"] - fine).max() / fine.max()
    print("\nRubin-Bodner, 'instant 300 mbar, 60 s' (6001 samples)")
    print(
        f"forward: {wall:.3f} s ({cpu:.3f} s processor), {result.cost.dofs} unknowns, {result.cost.time_steps} steps,"
    )
    print(f"  {result.cost.newton_steps} Newton iterations; error {100 * error:.2f} % (targets 0.3 s, 0.5 %)")
    _, with_wall, with_cpu = fastest(lambda: MODEL.simulate(run, {}, TWELVE))
    print(
        f"with 12 sensitivities: {with_wall:.3f} s ({with_cpu:.3f} s processor), {with_cpu / cpu:.2f} x forward"
        " (target 1.4)"
    )


def growth() -> None:
    print("\ncost against unknowns (same run)")
    print(f"{'mesh':>6s}{'unknowns':>10s}{'seconds':>9s}{'Newton':>8s}{'apex mm':>10s}")
    for density in (0.7, 1.0, 1.5, 2.0, 3.0):
        result, wall, _ = fastest(lambda d=density: MODEL.simulate(instant(mesh=d), {}), 2)  # type: ignore[misc]
        apex = 1e3 * result.channels["apex_height"][-1]
        print(f"{density:6.1f}{result.cost.dofs:10d}{wall:9.3f}{result.cost.newton_steps:8d}{apex:10.5f}")


def starts() -> None:
    code = (
        "from time import perf_counter as c; a = c(); import numpy as np;"
        "from skinrig_solver import Experiment, models; m = models()['suction_rubin_bodner']; b = c();"
        "t = np.linspace(0, 1, 3); r = Experiment('cutometer', t, {'pressure': -3e4 * t});"
        "m.simulate(r, {}, ['skin.mu0']); print(f'import {b - a:.2f} s, first run with a sensitivity {c() - b:.2f} s')"
    )
    print()
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache, "SKINRIG_CACHE_DIR": cache}
        for start in ("cold", "warm"):
            print(f"{start} start: ", end="", flush=True)
            subprocess.run([sys.executable, "-c", code], env=environment, check=True)
    print("(targets: cold 60 s, warm import 1 s)")


if __name__ == "__main__":
    against_peers()
    own_targets()
    growth()
    starts()
