"""Lossless ways to store camera frames: size, processor time to write and to read; and a run as it is recorded.

    python benchmarks/frames.py [RECORDING.h5]

Without a recording, a simulated aspiration run is made. LZ4 and bitshuffle are measured where `hdf5plugin` is installed
(`pip install hdf5plugin`); their files need it, or its filters, in every reader. The last line is the least size that
any lossless way can reach on whole frames: the entropy of the noise between two frames of a still scene. Then four
minutes of such frames are recorded, whole and by region, with the contour that is read in each: bytes of the file, and
seconds from the end of the run until it is there.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np

from acquire.recording import JournalWriter, RunInfo, finalise, open_recording
from acquire.recording.draft import Drafting
from acquire.recording.region import Keeper
from drivers.aspiration.live import LiveApex
from drivers.signals import Frame, Region

COUNT = 60  # frames that are measured
RATE = 25.0
RUN = 6000  # frames of four minutes
SCALE = 2e-5  # m/px
OLD = 30  # s after which the system itself puts onto the disk what was written


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(sys.argv[1]) if len(sys.argv) > 1 else simulated(Path(name))
        data = open_recording(path).frames.data  # type: ignore[union-attr]
        frames = data[:: max(1, len(data) // COUNT)][:COUNT]
        print(f"{len(frames)} frames of {frames.shape[2]}x{frames.shape[1]}; GB for {RUN} such frames")
        print(f"{'way':<24}{'ratio':>7}{'GB':>7}{'write':>10}{'read':>10}  readers")
        for label, options, readers in filters():
            tell(label, *hdf5(frames, Path(name) / "x.h5", options), frames, readers)
        tell("PNG, Huffman only", *png(frames), frames, "any, one file a frame")
        tell("FFV1 in AVI", *ffv1(frames, Path(name) / "x.avi"), frames, "video players, no HDF5 reader")
        bits = noise_bits(data)
        print(
            f"noise of a still scene: {bits:.2f} bits/px, so {8 / bits:.2f} x and {gigabytes(frames, 8 / bits):.2f} GB"
        )
        read, region = looked(frames)
        for label, kept in (("whole frames", None), (f"rows {region.top} to {region.top + region.height - 1}", region)):
            size, wait, work = recorded(read, Path(name), kept)
            print(f"recorded as {label}: {size / 1e9:.2f} GB", end="", flush=True)
            print(f", the file {wait:.1f} s after the end ({work:.1f} s of processor time)")


def filters() -> list[tuple[str, dict[str, Any], str]]:
    """Filters of HDF5: name, options of a dataset, who can read them."""
    every = "every HDF5 reader"
    found = [("HDF5 as it is", {}, every)]
    found += [(f"HDF5 deflate {n}", {"compression": "gzip", "compression_opts": n}, every) for n in (1, 4)]
    try:
        import hdf5plugin
    except ImportError:
        print("hdf5plugin is not installed: LZ4 and bitshuffle are left out")
        return found
    plugin = "with hdf5plugin"
    return [
        *found,
        ("HDF5 LZ4", dict(hdf5plugin.LZ4()), plugin),
        ("HDF5 bitshuffle LZ4", dict(hdf5plugin.Bitshuffle(cname="lz4")), plugin),
        ("HDF5 bitshuffle zstd 3", dict(hdf5plugin.Bitshuffle(cname="zstd", clevel=3)), plugin),
    ]


def hdf5(frames: np.ndarray, path: Path, options: dict[str, Any]) -> tuple[int, float, float]:
    """Bytes, and seconds of processor time to write and to read, one chunk a frame."""

    def write() -> None:
        with h5py.File(path, "w") as file:
            data = file.create_dataset("data", frames.shape, np.uint8, chunks=(1, *frames.shape[1:]), **options)
            for index, frame in enumerate(frames):
                data[index] = frame

    def read() -> None:
        with h5py.File(path) as file:
            for index in range(len(frames)):
                file["data"][index]

    writing, reading = seconds(write), seconds(read)
    return path.stat().st_size, writing, reading


def png(frames: np.ndarray) -> tuple[int, float, float]:
    """As `hdf5`."""
    how = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
    files: list[Any] = []
    writing = seconds(lambda: files.extend(cv2.imencode(".png", frame, how)[1] for frame in frames))
    return sum(map(len, files)), writing, seconds(lambda: [cv2.imdecode(f, cv2.IMREAD_GRAYSCALE) for f in files])


def ffv1(frames: np.ndarray, path: Path) -> tuple[int, float, float]:
    """As `hdf5`; nothing where the video library has no FFV1."""

    def write() -> None:
        size = frames.shape[2], frames.shape[1]
        video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, size, isColor=False)
        for frame in frames:
            video.write(frame)
        video.release()

    def read() -> None:
        video = cv2.VideoCapture(str(path))
        while video.read()[0]:
            pass

    writing = seconds(write)
    return (path.stat().st_size, writing, seconds(read)) if path.exists() else (0, 0.0, 0.0)


def looked(frames: np.ndarray) -> tuple[list[Frame], Region]:
    """The frames with the contour that is read in each as it comes, and the region for an opening of 8 mm."""
    live = LiveApex(SCALE)
    live(frames[0])
    region = live.region(4e-3)
    assert region is not None, "no sure contour in the first frame"
    read = []
    for image in frames:
        live(image)
        read.append(Frame(image, 0, 0.0, 0.0, live.latest))
    return read, region


def recorded(frames: list[Frame], folder: Path, region: Region | None) -> tuple[int, float, float]:
    """Bytes of the file of four minutes, and s of wall and processor time until it is there."""
    contour = frames[0].contour
    assert contour is not None
    info = RunInfo("ready", "aspiration", "", calibration={"gvt": {"value": contour.gvt, "unit": "1"}})
    journal = JournalWriter(folder / "ready.journal", info, frame_scale=SCALE, region=region)
    keeper, drafting = Keeper(region), Drafting(folder)
    for index in range(RUN):
        frame = replace(frames[index % len(frames)], seq=index, time=index / RATE)
        drafting.add(frame.image.shape, journal.frame(frame, whole=keeper.whole(frame)))
        if index == RUN - OLD * RATE and drafting.draft is not None:
            os.fsync(drafting.draft.raw.fileno())
    began, worked = time.monotonic(), time.process_time()
    path = finalise(journal, folder / "ready.h5", draft=drafting.draft)
    drafting.close()
    wait, work = time.monotonic() - began, time.process_time() - worked
    size = path.stat().st_size
    path.unlink()
    return size, wait, work


def noise_bits(data: Any) -> float:
    """Entropy (bits/px) of the difference of the first two frames, less half a bit: two noises are in it."""
    difference = data[1].astype(int) - data[0].astype(int)
    share = np.bincount((difference - difference.min()).ravel()) / difference.size
    share = share[share > 0]
    return float(-(share * np.log2(share)).sum()) - 0.5


def tell(label: str, size: int, writing: float, reading: float, frames: np.ndarray, readers: str) -> None:
    """One line of the table."""
    if not size:
        print(f"{label:<24} is not available")
        return
    ratio, each = frames.nbytes / size, 1e3 / len(frames)
    times = f"{writing * each:>7.2f} ms{reading * each:>7.2f} ms"
    print(f"{label:<24}{ratio:>6.2f}x{gigabytes(frames, ratio):>7.2f}{times}  {readers}", flush=True)


def gigabytes(frames: np.ndarray, ratio: float) -> float:
    """Size of a run in GB."""
    return RUN * frames[0].nbytes / ratio / 1e9


def seconds(action: Callable[[], object]) -> float:
    """Processor time that ``action`` takes."""
    began = time.process_time()
    action()
    return time.process_time() - began


def simulated(folder: Path) -> Path:
    """A recording of the simulated aspiration device."""
    from acquire.session import Session
    from acquire.station import simulated_station

    station = simulated_station("forearm", (), 0)
    entry = station.instruments["aspiration"].model_copy(update={"frames": "full"})
    station = station.model_copy(update={"instruments": {"aspiration": entry}})
    with Session(station, speed=8, out=folder) as session:
        outcome = session.run("demo-aspiration")
    assert outcome.recording is not None, outcome.reason
    return outcome.recording


if __name__ == "__main__":
    os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")
    main()
