"""A process that records or finalises without end, until it is killed.

It tells its parent the number of each record (of each recording) just before it writes it, so that the parent knows
what must be found afterwards.
"""

from __future__ import annotations

import time
from itertools import count
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from acquire.recording import JournalWriter, RunInfo, finalise
from drivers.signals import Block, Channel, Frame

CHANNELS = (Channel("pressure", "Pa", "actuator"), Channel("apex_height", "m", "sensor"))
IMAGE = np.zeros((48, 64), np.uint8)
INFO = RunInfo("killed", "cutometer", "2026-01-01T00:00:00+00:00")


def append(writer: JournalWriter, number: int) -> None:
    """10 ms of two channels at 1 kHz, and now and then a frame."""
    seq = np.arange(10 * number, 10 * number + 10)
    writer.block(Block({"pressure": seq * 1.0, "apex_height": seq * 2.0}, seq, seq / 1000.0, seq / 1000.0))
    if number % 3 == 0:
        writer.frame(Frame(IMAGE + number % 256, number, number / 100.0, number / 100.0))


def record(path: Path, parent: Connection) -> None:
    """Append 10 ms every millisecond."""
    writer = JournalWriter(path, INFO, CHANNELS)
    for number in count():
        parent.send(number)
        append(writer, number)
        time.sleep(0.001)


def finalise_again_and_again(path: Path, parent: Connection) -> None:
    """Make one recording after the other from the same journal."""
    with JournalWriter(path, INFO, CHANNELS) as writer:
        for number in range(100):
            append(writer, number)
    for number in count():
        parent.send(number)
        finalise(path, path.with_suffix(f".{number}.h5"), keep=True)
