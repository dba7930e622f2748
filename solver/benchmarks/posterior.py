"""How long the posterior of the demo's Cutometer recording takes, by the command that a person types.

    python benchmarks/posterior.py [RECORDING] [--jobs 2]

Without a recording the demo's protocol is run on the simulated instrument first. Prints wall and processor seconds
(start-up of Python and of the worker processes included; compiled code is cached from the first run on), and how many
processes competed for the cores: on cores that others use, wall seconds say nothing.
"""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")  # for the processes below

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

ACQUIRE = Path(sys.executable).with_name("acquire")


def recorded(folder: Path) -> Path:
    """The demo's recording of a simulated Cutometer."""
    path = folder / "cutometer.h5"
    person = ("--subject", "P01", "--site", "forearm", "--seed", "1")
    subprocess.run([ACQUIRE, "run", "demo-cutometer", "--sim", "--speed", "20", *person, "-o", path], check=True)
    return path


def main() -> None:
    ask = argparse.ArgumentParser(description="Seconds that the posterior of a recording takes")
    ask.add_argument("recording", type=Path, nargs="?")
    ask.add_argument("--model", default="suction_yeoh_qlv")
    ask.add_argument("--jobs", default="2")
    told = ask.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recording = told.recording or recorded(folder)
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), perf_counter()
        words = ["fit", recording, "--model", told.model, "--posterior", "--jobs", told.jobs, "-o", folder / "out"]
        subprocess.run([ACQUIRE, *words], check=True)
        wall, after = perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
        found = json.loads((folder / "out" / "fit.json").read_text())["posterior"]
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    emulator, chain = found["emulator"], found["mcmc"]
    print(
        f"\n{wall:.0f} s wall, {processor:.0f} s of processors in all, {told.jobs} processes, load "
        f"{os.getloadavg()[0]:.1f} on {os.cpu_count()} cores\ntrusted: {found['trusted']}; {emulator['full_solves']} "
        f"full solves; log density off by {emulator['density_error']:.2f} r.m.s. at {emulator['held_out']} draws run "
        f"in full, no mean by more than {emulator['shift']:.2f} of its deviations; R-hat {chain['rhat']:.3f}, "
        f"{chain['effective_draws']:.0f} independent draws"
    )


if __name__ == "__main__":
    main()
