"""Speed of the sheet: the 16-direction protocol and its fit, cost against unknowns, and two peers at equal accuracy.

    python benchmarks/bench_sheet.py            # everything, about three minutes
    python benchmarks/bench_sheet.py protocol   # one part: start, protocol, fit, growth, peers

One thread. Seconds are of this machine; ratios to the peers are of the same run.
"""

from __future__ import annotations

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import subprocess
import sys
import tempfile
from collections.abc import Callable
from time import perf_counter

import numpy as np
from scipy.optimize import least_squares

from skinrig_solver import Experiment, models

FREE = ("mu1", "alpha1", "mu2", "alpha2", "sx", "sy")
CHANNELS = ("force_x", "force_y", "force_z")


def protocol(rate: float = 50.0, reach: float = 1.3e-3) -> Experiment:
    """Paper M's face protocol: 12 directions in plane, three at 45 degrees, the normal; three 0.1 Hz triangles each."""
    ways = [(np.radians(theta), 0.0) for theta in range(0, 360, 30)]
    ways += [(np.radians(theta), np.radians(45.0)) for theta in (0, 45, 90)] + [(0.0, np.radians(90.0))]
    per = round(30.0 * rate)
    time = np.arange(per * len(ways)) / rate
    triangle = reach * (1.0 - np.abs((np.arange(per) / rate / 10.0 % 1.0) * 2.0 - 1.0))
    unit = [(np.cos(t) * np.cos(f), np.sin(t) * np.cos(f), np.sin(f)) for t, f in ways]
    path = np.concatenate([np.outer(triangle, way) for way in unit])
    return Experiment(
        "microrobot", time, {f"probe_{a}": path[:, k] for k, a in enumerate("xyz")}, label="face protocol"
    )


def start() -> None:
    """Import and first run, with an empty and a filled compilation cache."""
    script = "import time; t = time.perf_counter(); from skinrig_solver import models; m = models()['sheet_ogden']; "
    script += "print(f'{time.perf_counter() - t:.2f}')"
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": folder}
        for name in ("cold start (all six laws compiled)", "warm import"):
            run = subprocess.run(
                [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
            )
            print(f"{name:40s} {run.stdout.strip():>8s} s")


def forward() -> None:
    """The whole protocol, with and without sensitivities, for every law."""
    experiment = protocol()
    print(f"16 directions x 3 cycles, {experiment.time.size} samples; target <= 15 s")
    for name in (n for n in models() if n.startswith("sheet_")):
        model = models()[name]
        model.simulate(experiment, {})
        plain = min(model.simulate(experiment, {}).cost.seconds for _ in range(2))
        full = model.simulate(experiment, {}, model.info.symbols)
        print(
            f"{name:18s} forward {plain:6.2f} s   {len(model.info.symbols)} sensitivities {full.cost.seconds:6.2f} s"
            f"   ({full.cost.seconds / plain:.2f} x)   {full.cost.newton_steps} Newton steps, {full.cost.dofs} unknowns"
        )
    rng = np.random.default_rng(0)
    noisy = {a: path + 15e-6 * rng.standard_normal(path.size) for a, path in experiment.drive.items()}
    model, wandering = models()["sheet_ogden"], Experiment("microrobot", experiment.time, noisy)
    plain, full = (model.simulate(wandering, {}, symbols).cost.seconds for symbols in ((), FREE))
    print(f"sheet_ogden, 15 um tracking noise: forward {plain:.2f} s, 6 sensitivities {full:.2f} s")


def fit() -> None:
    """Six parameters of the Ogden sheet from the protocol with 1 % noise, from a start 30 % off; trust region."""
    experiment, model = protocol(20.0), models()["sheet_ogden"]
    truth = model.info.defaults
    rng = np.random.default_rng(1)
    exact = model.simulate(experiment, truth).channels
    scale = {c: np.abs(exact[c]).max() for c in CHANNELS}
    noisy = {c: exact[c] + 0.01 * scale[c] * rng.standard_normal(experiment.time.size) for c in CHANNELS}
    wrong = np.array([truth[s] for s in FREE]) * np.array([0.7, 1.3, 1.3, 0.9, 0.75, 1.3])
    runs = 0

    def evaluate(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        nonlocal runs
        runs += 1
        result = model.simulate(experiment, {**truth, **dict(zip(FREE, wrong * np.exp(x), strict=True))}, FREE)
        assert result.sensitivities is not None
        residual = np.concatenate([(result.channels[c] - noisy[c]) / scale[c] for c in CHANNELS])
        return residual, np.concatenate([result.sensitivities[c] / scale[c] for c in CHANNELS]) * wrong * np.exp(x)

    memory: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def cached(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        key = x.tobytes()
        if key not in memory:
            memory.clear()
            memory[key] = evaluate(x)
        return memory[key]

    began = perf_counter()
    found = least_squares(lambda x: cached(x)[0], np.zeros(6), lambda x: cached(x)[1], method="trf", x_scale="jac")
    seconds = perf_counter() - began
    data = np.concatenate([noisy[c] / scale[c] for c in CHANNELS])
    vaf = 100.0 * (1.0 - 2.0 * found.cost / float(data @ data))
    deviation = np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)) * 2.0 * found.cost / (data.size - 6))
    print(f"6-parameter fit, {data.size} values: {seconds:.1f} s, {runs} runs, VAF {vaf:.2f} %; target <= 300 s")
    for symbol, x, start_, error in zip(FREE, found.x, wrong, deviation, strict=True):
        value = start_ * np.exp(x)
        print(
            f"  {symbol:7s} start {start_:9.4g}  found {value:9.4g} +- {error * value:.1g}  true {truth[symbol]:9.4g}"
        )


def growth() -> None:
    """Cost and error of one ray (1.3 mm along x and z) against the mesh."""
    time = np.linspace(0.0, 10.0, 501)
    path = 1.3e-3 * (1.0 - np.abs(time / 5.0 - 1.0)) / np.sqrt(2.0)
    model, reference = models()["sheet_ogden"], None
    for radial, around in ((16, 48), (12, 32), (8, 24), (6, 16), (4, 12), (3, 8)):
        geometry = {"radial": radial, "around": around, "points": 10}
        experiment = Experiment("microrobot", time, {"probe_x": path, "probe_z": path}, geometry)
        model.simulate(experiment, {})
        result = model.simulate(experiment, {})
        force = np.stack([result.channels[c] for c in CHANNELS])
        reference = force if reference is None else reference
        error = np.abs(force - reference).max(axis=1)[[0, 2]] / np.abs(reference).max(axis=1)[[0, 2]]
        cost = f"{result.cost.dofs:6d} unknowns  {result.cost.seconds:7.3f} s"
        print(f"  {cost}  error in x, z {error[0]:.1e} {error[1]:.1e}")


def peers() -> None:
    """The Ogden sheet at equal accuracy: every code's coarsest run within 0.3 % of the finest NGSolve run."""
    import sheet_peers as p

    case = p.Case()
    case.state  # noqa: B018 - the pre-stress is everyone's
    finest, unknowns, seconds = p.with_ngsolve(case, 3, 2.0, 12)
    reference = finest[-1]
    print(f"reference: NGSolve, order 3, {unknowns} unknowns, {seconds:.1f} s: {reference:.5f} N at 1.3 mm")
    p.ours(case, 3, 8, 6)
    runs: dict[str, Callable[[], p.Answer]] = {
        "this solver 3 x 8": lambda: p.ours(case, 3, 8, 6),
        "this solver 4 x 12": lambda: p.ours(case, 4, 12, 6),
        "this solver 6 x 16": lambda: p.ours(case, 6, 16, 6),
        "felupe linear 32 x 32": lambda: p.with_felupe(case, 32, 32, 6),
        "felupe quadratic 4 x 6": lambda: p.with_felupe(case, 4, 6, 6, quadratic=True),
        "felupe quadratic 6 x 8": lambda: p.with_felupe(case, 6, 8, 6, quadratic=True),
        "NGSolve order 2, 4 mm": lambda: p.with_ngsolve(case, 2, 4.0, 6),
        "NGSolve order 3, 4 mm": lambda: p.with_ngsolve(case, 3, 4.0, 6),
    }
    times = {}
    for name, run in runs.items():
        force, unknowns, seconds = min((run() for _ in range(2)), key=lambda answer: answer[2])
        error = abs(force[-1] / reference - 1.0)
        times[name] = seconds if error <= 3e-3 else np.inf
        print(f"  {name:24s} {unknowns:6d} unknowns  {seconds:7.3f} s  error {100.0 * error:.3f} %")
    fastest = min(times[n] for n in times if n.startswith("this"))
    for peer in ("felupe", "NGSolve"):
        print(f"  {peer} takes {min(times[n] for n in times if n.startswith(peer)) / fastest:.0f} x as long at 0.3 %")


PARTS = {"start": start, "protocol": forward, "fit": fit, "growth": growth, "peers": peers}

if __name__ == "__main__":
    for part in sys.argv[1:] or PARTS:
        print(f"== {part}")
        PARTS[part]()
