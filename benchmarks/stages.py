"""The cost of the forward chains, one core: ``python benchmarks/stages.py``.

Nanoseconds per sample of each operator, whole sessions without and with each effect, and how much faster than real time
a running instrument could go.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from sim_devices.chain import Chain, FloatArray, Operator, Signals
from sim_devices.effects import effects
from sim_devices.stages import INSTRUMENTS, RATES, noisy, nominal, runner
from sim_devices.stages.robot import closed_loop, xyz
from sim_devices.stages.sampling import simulate


def seconds(task: Callable[[], object], repeats: int = 7) -> float:
    """Shortest processor time of a few, after one that compiles or loads."""
    task()
    best = np.inf
    for _ in range(repeats):
        start = time.process_time()
        task()
        best = min(best, time.process_time() - start)
    return best


def session(instrument: str, duration: float = 100.0) -> tuple[FloatArray, Signals]:
    """A uniform grid of 100 Hz and commands that keep every stage busy."""
    grid = np.arange(0, duration, 0.01)
    wave = 0.5 - 0.5 * np.cos(2 * np.pi * grid / 10)
    if instrument == "microrobot":
        return grid, dict(zip(xyz("command"), (1.2e-3 * wave, 0.5e-3 * wave, 0 * wave), strict=True))
    return grid, {"command_pressure": -30e3 * wave}


def run(chain: Chain, grid: FloatArray, inputs: Signals) -> Signals:
    """A whole session, the robot's loop closed."""
    return closed_loop(chain, grid, inputs) if chain.instrument == "microrobot" else chain.run(grid, inputs)


def stream(chain: Chain, grid: FloatArray, inputs: Signals, chunk: int) -> None:
    """The same as a running instrument does it."""
    advancing = runner(chain)
    for a in range(0, len(grid), chunk):
        advancing.advance(grid[a : a + chunk], {k: v[a : a + chunk] for k, v in inputs.items()})


def operator_alone(op: Operator, grid: FloatArray, signals: Signals) -> None:
    """One operator on its recorded inputs."""
    op.advance(op.fresh(), grid, dict(signals))


def report(instrument: str) -> None:
    """Figures of one instrument."""
    grid, inputs = session(instrument)
    chain = nominal(instrument)
    signals = run(chain, grid, inputs)
    print(f"\n{instrument}: ns per sample of each operator")
    for op in chain.operators:
        print(f"  {op.name:34s} {seconds(partial(operator_alone, op, grid, signals)) / len(grid) * 1e9:8.1f}")
    whole = seconds(partial(run, chain, grid, inputs))
    print(f"  whole chain, 100 s at 100 Hz: {whole * 1e3:.2f} ms ({whole / len(grid) * 1e9:.0f} ns per sample)")
    print(f"{instrument}: whole chain with each effect, times the nominal one")
    for name, effect in effects(instrument).items():
        took = seconds(partial(run, effect.apply(chain), grid, inputs), 3)
        print(f"  {name:34s} {took / whole:8.2f}")
    rate = max(RATES[instrument], 100.0)
    fine = np.arange(0, 20, 1 / rate)
    commands = {k: np.interp(fine, grid, v) for k, v in inputs.items()}
    took = seconds(partial(stream, noisy(chain, 1), fine, commands, max(round(0.05 * rate), 1)), 3)
    print(f"{instrument}: as a running instrument, {rate:.0f} Hz in chunks of 50 ms: {20 / took:.0f} x real time")


def main() -> None:
    """Print the figures."""
    for instrument in INSTRUMENTS:
        report(instrument)
    levels = np.arange(15e3, 46e3, 5e3)
    starts = 76.0 * np.arange(len(levels))
    table = np.concatenate([[s, s + 1, s + 1, s + 61, s + 61, s + 76] for s in starts])
    value = np.concatenate([[0, 0, -p, -p, 0, 0] for p in levels])
    stamps = np.arange(0, 532, 0.01)
    chain = nominal("cutometer", opening=4e-3, tissue="fingertip")
    took = seconds(lambda: simulate(chain, {"pressure": (table, value)}, {"pressure": stamps, "apex_height": stamps}))
    print(f"\nfingertip protocol (7 levels x 75 s, 100 Hz): {took * 1e3:.1f} ms, {532 / took:,.0f} x real time")


if __name__ == "__main__":
    main()
