"""Stand-ins for the public data sets: files of the same names and columns, generated here from a known truth."""

from __future__ import annotations

import csv
import importlib.util
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
from scipy.io import savemat

from sim_devices.stages.scene import Scene

ROOT = Path(__file__).parents[1]
BUBBLE_HEIGHT = 4e-3  # m in the scene's own scale, above `Scene.initial_height`


def example(name: str, script: str = "make_bundle") -> ModuleType:
    """The script examples/<name>/<script>.py as a module."""
    spec = importlib.util.spec_from_file_location(f"{name}_{script}", ROOT / "examples" / name / f"{script}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _emps(folder: Path) -> None:
    """A carriage under proportional control with viscous and dry friction, of the values published for the EMPS."""
    mass, drag, friction, offset = 95.11, 203.50, 20.39, -3.16
    gain, kp, kv, dt = 35.15, 160.18, 243.45, 1e-3
    time = dt * np.arange(10_001)
    corners = [0.2, 1.5, 2.6, 4.0, 4.9, 6.2, 7.3, 8.4, 10.0]  # it never rests for long
    places = [0.0, 0.12, 0.03, 0.1, 0.05, 0.12, 0.01, 0.1, 0.02]
    window = np.hanning(601)
    reference = np.convolve(np.pad(np.interp(time, corners, places), 300, "edge"), window / window.sum(), "valid")
    for name, size in (("DATA_EMPS.mat", 0.0), ("DATA_EMPS_PULSES.mat", 5.0)):
        rng = np.random.default_rng(int(size))
        pulses = np.where(time % 3.0 < 0.1, size, 0.0)
        position, velocity = 0.0, 0.0
        scatter = 0.04 * rng.standard_normal(time.size)
        positions, voltages = np.empty(time.size), np.empty(time.size)
        for k in range(time.size):
            volts = kv * (kp * (reference[k] - position) - velocity) + pulses[k] + scatter[k]
            positions[k], voltages[k] = position, volts
            free = velocity + dt / mass * (gain * volts - drag * velocity - offset)
            velocity = float(np.sign(free) * max(abs(free) - dt / mass * friction, 0.0))
            position += dt * velocity
        noise = 2e-7 * rng.standard_normal(time.size)
        values = {"t": time, "qg": reference, "qm": positions + noise, "vir": voltages}
        added = {"pulses_N": pulses} if size else {}
        savemat(folder / name, {**values, **added, "gtau": gain, "kp": kp, "kv": kv})


def _cascaded_tanks(folder: Path) -> None:
    """Torricelli's law in two tanks, and a level sensor that ends at 10 V; a sample every 4 s."""
    columns: dict[str, np.ndarray] = {}
    for part, seed in (("Est", 1), ("Val", 2)):
        rng = np.random.default_rng(seed)
        pump = 3.2 + 2.0 * np.interp(np.arange(1024), np.arange(0, 1064, 40), rng.uniform(-1, 1, 27))
        upper, lower, level = 5.0, 5.0, np.empty(1024)
        for k in range(1024):
            level[k] = lower
            for _ in range(8):
                out, off = 0.05 * np.sqrt(max(upper, 0.0)), 0.05 * np.sqrt(max(lower, 0.0))
                upper, lower = upper + 0.5 * (0.04 * pump[k] - out), lower + 0.5 * (out - off)
        columns[f"u{part}"] = pump
        columns[f"y{part}"] = np.minimum(level + 0.02 * rng.standard_normal(1024), 10.0)
    with (folder / "dataBenchmark.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


def _bubbles(folder: Path) -> None:
    """One rendered dome under three names; each pixel is as large as the example makes it smaller."""
    for seed, (image, every) in enumerate(
        (("gttab_20_70.tiff", 3), ("gwater20_70.tiff", 3), ("uEye_Image_000827.png", 4))
    ):
        small = Scene(seed=seed)(BUBBLE_HEIGHT)
        cv2.imwrite(str(folder / image), np.kron(small, np.ones((every, every), np.uint8)))


STANDINS: Mapping[str, Callable[[Path], None]] = {
    "emps": _emps,
    "cascaded_tanks": _cascaded_tanks,
    "bubble_on_needle_cc0": _bubbles,
}


def write(name: str, folder: Path) -> Path:
    """Write the stand-in of a data set into ``folder`` (made if missing) and return it."""
    folder.mkdir(parents=True, exist_ok=True)
    STANDINS[name](folder)
    return folder
