"""Speed of the suction solver: against felupe and NGSolve, its own targets, growth with unknowns, cold and warm start.

Run with ``python benchmarks/bench_suction.py [peers] [own] [growth] [starts]``. Every figure is one thread, the fastest
of several runs, in processor seconds, since machines are shared. The peers are set up as their experts would: NGSolve
with condensed interiors, symbolic factors reused, of several orders, interpreted and compiled to C++, on meshes as
coarse as each order allows; felupe with PARDISO; Newton's method ends at equal tolerance.
"""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"  # before numpy is imported

import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from time import perf_counter, process_time

import numpy as np
import peers
from scipy.linalg import lu_factor

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


def calibration(repeats: int) -> float:
    """Processor seconds of a fixed piece of work, LU factors of a 600 x 600 matrix: the machine's speed just then."""
    matrix, least = np.random.default_rng(0).standard_normal((600, 600)), np.inf
    for _ in range(repeats):
        began = process_time()
        lu_factor(matrix)
        least = min(least, process_time() - began)
    return least


DENSITIES = (0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 4.0)
WITHIN = 4e-3  # relative error of the apex at which the codes are compared
COMPILE_LIMIT = 420.0  # seconds that NGSolve's compiled run may take altogether, compiling included


def compiled(case: peers.Case, density: float, repeats: int, order: int) -> peers.Timing:
    """NGSolve with ``realcompile``, in a process of its own that ends where the C++ compiler takes too long."""
    code = (
        "import peers; from dataclasses import astuple;"
        f"print(*astuple(peers.with_ngsolve(peers.{case!r}, {density}, {repeats}, {order}, compiled=True)), sep=';')"
    )
    here = os.path.dirname(os.path.abspath(__file__))
    # NGSolve looks for its compiler's wrapper, which pip installs beside Python, on the path
    path = os.pathsep.join([os.path.dirname(sys.executable), os.environ["PATH"]])
    try:
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=here, timeout=COMPILE_LIMIT, capture_output=True, text=True, check=True,
            env={**os.environ, "PATH": path},
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"not compiled within {COMPILE_LIMIT:.0f} s") from None
    except subprocess.CalledProcessError as error:
        raise RuntimeError(f"cannot be compiled here: {error.stderr.strip().splitlines()[-1]}") from None
    apex, unknowns, setup, solve, tolerance = done.stdout.strip().splitlines()[-1].split(";")
    return peers.Timing(float(apex), int(unknowns), float(setup), float(solve), tolerance)


def against_peers() -> None:
    """The Yeoh suction without rim, each code at its coarsest mesh that is within `WITHIN` of its own fine mesh."""
    case = peers.Case(rim=False, pressure=-2e4)
    print(f"\nYeoh suction, {case.steps} load steps; error against the code's own fine mesh; ratio of seconds to ours")
    head = ("unknowns", "apex mm", "error %", "tolerance", "seconds", "ratio")
    print(f"{'code':36s}" + "".join(f"{name:>17s}" if name == "tolerance" else f"{name:>10s}" for name in head))
    codes: dict[str, tuple[Callable[..., peers.Timing], float]] = {  # and the density of the fine mesh
        "ours, rings around the load's edge": (partial(peers.ours, rings=True), 4.0),
        "ours, grid": (peers.ours, 6.0),
        "felupe, PARDISO": (peers.with_felupe, 5.0),
    }
    orders = {order: f"NGSolve, order {order}, condensed" for order in (3, 4, 5)}
    codes |= {name: (partial(peers.with_ngsolve, order=order), 8.0) for order, name in orders.items()}
    own, chosen = np.nan, {}
    for name, (run, fine) in codes.items():
        try:
            reference = run(case, fine, 1).apex
            timing, coarse = coarsest(run, case, reference)
        except (ImportError, RuntimeError) as error:
            print(f"{name:36s}left out: {error}")
            continue
        own = timing.solve if np.isnan(own) else own
        chosen[name] = (coarse, reference)
        _row(name, timing, reference, own)
    for order, name in orders.items():
        if name in chosen and order < 5:
            try:
                density, reference = chosen[name]
                _row(f"NGSolve, order {order}, compiled to C++", compiled(case, density, 6, order), reference, own)
            except RuntimeError as error:
                print(f"NGSolve, order {order}, compiled to C++ left out: {error}")


def _row(name: str, timing: peers.Timing, reference: float, own: float) -> None:
    error = 100 * abs(timing.apex / reference - 1.0)
    print(
        f"{name:36s}{timing.unknowns:10d}{1e3 * timing.apex:10.4f}{error:10.2f}{timing.tolerance:>17s}"
        f"{timing.solve:10.4f}{timing.solve / own:10.1f}",
        flush=True,
    )


def coarsest(run: Callable[..., peers.Timing], case: peers.Case, reference: float) -> tuple[peers.Timing, float]:
    """The timing on the coarsest mesh that is accurate enough, and its density. Raises RuntimeError for none.

    A mesh counts if the next finer one is accurate enough too: errors of coarse meshes may cancel by chance.
    """
    fits = [abs(run(case, density, 1).apex / reference - 1.0) <= WITHIN for density in DENSITIES]
    for density, here, finer in zip(DENSITIES, fits, [*fits[1:], True], strict=True):
        if here and finer:
            return run(case, density, 6), density
    raise RuntimeError("no mesh of the benchmark is accurate enough")


def instant(**geometry: float) -> Experiment:
    time = np.arange(0.0, 60.0 + 1e-9, 0.01)
    return Experiment("cutometer", time, {"pressure": np.where(time > 0.0, -30e3, 0.0)}, geometry)


def own_targets() -> None:
    print("\nRubin-Bodner, 'instant 300 mbar, 60 s' (6001 samples); targets: 0.08 s, 0.5 %, sensitivities 1.3 times")
    fine = MODEL.simulate(instant(mesh=2.5, steps=6.0), {}).channels["apex_height"]
    print("  mesh  unknowns  steps  iterations  error %       s  with 12  times   s / LU of 600 x 600")
    for density in (1.0, 0.7):
        run = instant(mesh=density)
        cpu = both = unit = np.inf
        for _ in range(12):  # in turn, so that a machine that is slower for a while is so for all three
            result, _, once = fastest(partial(MODEL.simulate, run, {}), 1)
            cpu, both = min(cpu, once), min(both, fastest(partial(MODEL.simulate, run, {}, TWELVE), 1)[2])
            unit = min(unit, calibration(2))
        error = np.abs(result.channels["apex_height"] - fine).max() / fine.max()
        cost = result.cost
        print(
            f"{density:6.1f}{cost.dofs:10d}{cost.time_steps:7d}{cost.newton_steps:12d}{100 * error:9.2f}{cpu:8.3f}"
            f"{both:9.3f}{both / cpu:7.2f}{cpu / unit:14.1f}"
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
        "from time import perf_counter as c, process_time as p; a = c(); import numpy as np;"
        "from skinrig_solver import Experiment, models; m = models()['suction_rubin_bodner']; b = c();"
        "t = np.linspace(0, 1, 3); r = Experiment('cutometer', t, {'pressure': -3e4 * t});"
        "m.simulate(r, {}, ['skin.mu0']); print(f'import {b - a:.2f} s, first run with a sensitivity {c() - b:.2f} s; '"
        "f'{p():.2f} s of processor altogether')"
    )
    print()
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache, "SKINRIG_CACHE_DIR": cache}
        for start in ("cold", "warm"):
            print(f"{start} start: ", end="", flush=True)
            subprocess.run([sys.executable, "-c", code], env=environment, check=True)
    print("(targets: cold 20 s, warm import 1 s)")


if __name__ == "__main__":
    parts = {"peers": against_peers, "own": own_targets, "growth": growth, "starts": starts}
    for part in sys.argv[1:] or parts:
        parts[part]()
