"""How much faster than real time simulated instruments can be driven and read through their real bytes.

One process, server and host in two threads: ``python benchmarks/instruments.py``. Prints, for each instrument and link,
seconds of the instrument's time per second of wall time, samples and megabytes of values delivered per second, samples
lost, and seconds of processor time (both threads) per second of the instrument's time.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from drivers.signals import Block, FloatArray, Frame
from protocols.setpoints import Segment
from sim_devices.servers import Server, serve

CASES = [
    ("cutometer", "pty"),
    ("cutometer", "tcp"),
    ("aspiration", "pty"),
    ("aspiration", "tcp"),
    ("microrobot", "usb"),
    ("microrobot", "tcp"),
    ("microrobot", "pty"),
]


def drive(server: Server, wall: float) -> tuple[float, int, int, int, float]:
    """Load and unload for ``wall`` s: device s, samples, lost samples, bytes of values, processor s."""
    device = server.open_rig().device
    device.connect()
    device.start_stream()
    device.arm(server.bench.instrument.limits.ranges)
    seqs: list[FloatArray] = []
    size = 0
    start, processor = time.monotonic(), time.process_time()
    first = None
    running = False
    while time.monotonic() < start + wall:
        device.beat()
        if device.status.queued < 8:
            device.enqueue(_triangle(device.quantities) * 8)
            if not running:
                device.start()
                running = True
        for block in device.read(0.02):
            if isinstance(block, Block):
                first = block.time[0] if first is None else first
                seqs.append(block.seq)
                size += sum(v.nbytes for v in block.values.values())
    elapsed = device.status.time - (first or 0.0)
    spent = time.process_time() - processor
    device.make_safe()
    device.close()
    seq = np.concatenate(seqs)
    return elapsed, len(seq), int((np.diff(seq) - 1).sum()), size, spent


def camera(server: Server, wall: float) -> float:
    """Frames per s from a camera alone, with the apex measured in each."""
    (source,) = server.open_rig().sources
    source.connect()
    source.start_stream()
    source.read(1.0)
    start, count = time.monotonic(), 0
    while time.monotonic() < start + wall:
        count += sum(isinstance(item, Frame) for item in source.read(0.05))
    source.close()
    return count / wall


def _triangle(quantities: tuple[str, ...]) -> list[Segment]:
    far = {q: (-3e4 if q == "pressure" else 0.5e-3) for q in quantities}
    rest = dict.fromkeys(quantities, 0.0)
    return [Segment(5.0, rest, far), Segment(5.0, far, rest)]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=4.0, help="wall time per case")
    wall = parser.parse_args().seconds
    print(f"{'instrument':12}{'link':6}{'x real time':>12}{'samples/s':>12}{'MB/s':>8}{'lost':>6}{'CPU s / s':>12}")
    for instrument, link in CASES:
        with serve(instrument, link, speed=1e5, camera=False, watchdog=1.0) as server:
            elapsed, samples, lost, size, spent = drive(server, wall)
        rates = f"{elapsed / wall:12.0f}{samples / wall:12.0f}{size / wall / 1e6:8.2f}"
        print(f"{instrument:12}{link:6}{rates}{lost:6d}{spent / elapsed:12.5f}", flush=True)
    for width, height in ((640, 480), (320, 240)):
        with serve("aspiration", speed=1e5, frame_size=(width, height)) as server:
            rate = camera(server, wall)
        print(f"camera {width}x{height}, rendered, sent, measured: {rate:.0f} frames/s, {rate / 25:.0f} x real time")


if __name__ == "__main__":
    main()
