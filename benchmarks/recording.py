"""The cost of recording, and how much faster than real time a simulated run goes.

    python benchmarks/recording.py [SECONDS]

1. Three recorders at once, each fed 1 kHz x 8 channels in blocks of 10 ms, one of them with 60 frames/s of 640x480, as
   the links' threads feed them; the processor time is that of the recorders' own threads. Target: no sample lost, at
   most 30 % of one core while running. Writing the finished HDF5 files at the end is told apart.
2. ``acquire run fingertip-levels --sim``, the whole command in a process of its own. Target: 100 times real time.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from acquire.engine.recorder import Recorder
from acquire.recording import RunInfo, open_recording
from drivers.signals import Block, Channel, Frame
from protocols import Limits, Range, compile_protocol, library, load

RATE, CHANNELS, BLOCK = 1000, 8, 0.010
FRAME_RATE, FRAME_SHAPE = 60, (480, 640)


def cpu(thread: threading.Thread) -> float:
    """Processor time of a thread in s."""
    assert thread.ident is not None
    return time.clock_gettime(time.pthread_getcpuclockid(thread.ident))


def feed(recorder: Recorder, seconds: float, start: float, frames: bool) -> None:
    """Put blocks (and frames) into a recorder at the pace of real time."""
    random = np.random.default_rng(0)
    n = int(RATE * BLOCK)
    values = {f"c{k}": random.standard_normal(n) for k in range(CHANNELS)}
    images = random.integers(0, 255, (8, *FRAME_SHAPE), dtype=np.uint8)
    pictures = 0
    for number in range(int(seconds / BLOCK)):
        moment = number * BLOCK
        time.sleep(max(0.0, start + moment + BLOCK - time.monotonic()))
        stamps = moment + np.arange(n) / RATE
        recorder.put(Block(values, number * n + np.arange(n), stamps, np.full(n, time.monotonic())))
        while frames and pictures / FRAME_RATE <= moment:
            recorder.put(Frame(images[pictures % 8], pictures, pictures / FRAME_RATE, time.monotonic()))
            pictures += 1


def recorders(seconds: float, folder: Path) -> None:
    """Benchmark 1."""
    failures: list[str] = []
    channels = tuple(Channel(f"c{k}", "V", "sensor") for k in range(CHANNELS))
    made = [
        Recorder(folder / f"r{k}.h5", RunInfo(f"r{k}", "any", "now"), channels, failures.append, 2e-5) for k in range(3)
    ]
    start = time.monotonic() + 0.1
    feeders = [threading.Thread(target=feed, args=(r, seconds, start, k == 0)) for k, r in enumerate(made)]
    for thread in (*made, *feeders):
        thread.start()
    for thread in feeders:
        thread.join()
    running = sum(cpu(r) for r in made)
    began, worked = time.monotonic(), time.process_time()
    paths = [r.finish("completed", "").result() for r in made]
    for r in made:
        r.join()
    finishing, working = time.monotonic() - began, time.process_time() - worked
    found = [open_recording(path) for path in paths]
    expected = int(seconds / BLOCK) * int(RATE * BLOCK)
    missing = sum(expected - len(r.streams["c0"].value) for r in found) + sum(r.lost for r in made)
    pictures = len(found[0].frames.data) if found[0].frames is not None else 0
    print(f"three recorders for {seconds:.0f} s: {3 * CHANNELS} channels at {RATE} Hz, {pictures} frames of 640x480")
    print(f"  samples lost             {missing}   (target 0)   failures {failures or 'none'}")
    print(f"  recorders' threads       {100 * running / seconds:.1f} % of one core   (target 30 %)")
    size = sum(path.stat().st_size for path in paths) / 1e6
    print(f"  finished HDF5 files      {finishing:.2f} s ({working:.2f} s of processor time) for {size:.0f} MB")


def fingertip(folder: Path) -> None:
    """Benchmark 2."""
    name = "fingertip-levels"
    duration = compile_protocol(load(library()[name]), Limits({"pressure": Range(-50e3, 0.0)})).duration
    command = [sys.executable, "-c", "from acquire.cli import main; main()", "run", name, "--sim", "--speed", "2000"]
    for what in ("first (may compile)", "second"):
        began, used = time.monotonic(), _children()
        subprocess.run([*command, "-o", str(folder)], check=True, capture_output=True)
        wall, processor = time.monotonic() - began, _children() - used
        print(f"{name}, {what}: {duration:.0f} s simulated in {wall:.2f} s: {duration / wall:.0f} times   (target 100)")
        print(f"  processor time           {processor:.2f} s, the start of Python and its imports included")


def _children() -> float:
    """Processor time of finished child processes in s."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        recorders(float(sys.argv[1]) if len(sys.argv) > 1 else 20.0, Path(scratch))
        fingertip(Path(scratch))
