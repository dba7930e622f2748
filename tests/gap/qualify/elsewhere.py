"""A laboratory that never saw our code: its own suction rig, integrated and written with numpy, csv and yaml text.

The bundles follow docs/recordings.md alone. Every recording's clock begins at nought, columns are in mbar and mm with
suction negative, and the numbers have as many digits as such files have.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Corners = Sequence[tuple[float, float]]
"""Break points of a command: s, mbar of suction."""
RATE, FINE = 100.0, 2000.0

PULSES: Corners = [
    (0, 0), (1, 0), (1, 150), (4, 150), (4, 0), (7, 0), (7, 400), (11, 400), (11, 0), (14, 0),
    (18.3, 400), (22.6, 0), (26.9, 400), (31.2, 0), (33, 0),
]  # fmt: skip
LEVELS: Corners = [
    (0, 0), (1, 0), (1, 150), (4, 150), (4, 0), (6, 0), (6, 300), (9, 300), (9, 0), (11, 0), (11, 400), (14, 400),
    (14, 0), (16, 0), (20.3, 400), (24.6, 0), (26, 0),
]  # fmt: skip
REST: Corners = [(0, 0), (12, 0)]
ON_SKIN: Corners = [(0, 0), (1, 0), (1, 300), (6, 300), (6, 0), (10, 0)]
RAMPS: Corners = [(0, 0), (1, 0), (5, 300), (9, 0), (13, 300), (17, 0), (20, 0)]
STANDARD: Sequence[tuple[str, str, Corners, str]] = (
    ("block", "rigid block", LEVELS, ""),
    ("step-low", "gauge step", REST, "0.500±0.002 mm"),
    ("step-mid", "gauge step", REST, "1.000±0.002 mm"),
    ("step-high", "gauge step", REST, "1.500±0.002 mm"),
    ("membrane", "reference membrane", PULSES, ""),
    ("manometer", "manometer", LEVELS, ""),
)
SKIN: Sequence[tuple[str, str, Corners, str]] = (("hold", "skin", ON_SKIN, ""), ("ramps", "skin", RAMPS, ""))


@dataclass(frozen=True)
class Bench:
    """The rig: its regulator's time constant in s, and the faults it may have (nought: sound)."""

    tau: float = 0.04
    gauge_gain: float = 0.0
    late: float = 0.0
    """Time constant of the height's reading, s."""

    def measured(self, specimen: str, corners: Corners, step_mm: float, rng: np.random.Generator) -> dict[str, Array]:
        """Columns ``t`` (s), ``p``, ``second`` (mbar, suction negative) and ``h`` (mm), all (n,)."""
        fine = np.arange(0.0, corners[-1][0], 1.0 / FINE)
        asked = -np.interp(fine, [c[0] for c in corners], [c[1] for c in corners])
        # The gauge is in the loop: what it reads too much is regulated away.
        true = lag(lag(asked, self.tau), self.tau) / (1.0 + self.gauge_gain)
        suction = np.maximum(-true, 0.0)
        if specimen == "skin":
            elastic = 0.9 * (suction / 300.0) ** 0.6
            height = 0.75 * elastic + 0.12 * lag(elastic, 0.4) + 0.13 * lag(elastic, 3.0)
        elif specimen == "reference membrane":
            elastic = 1.4 * (1.0 - np.exp(-suction / 260.0))
            height = 0.997 * elastic + 0.003 * lag(elastic, 0.5)
        elif specimen == "gauge step":
            height = step_mm * np.clip((fine - 3.0) / 0.4, 0.0, 1.0)
        else:
            height = np.zeros_like(fine)
        if self.late:
            height = lag(height, self.late)
        at = np.arange(0.0, corners[-1][0] - 0.005, 1.0 / RATE)
        noise = rng.standard_normal((3, len(at)))
        return {
            "t": at,
            "p": np.interp(at, fine, true) * (1.0 + self.gauge_gain) + 0.25 * noise[0],
            "second": np.interp(at, fine, true) + 0.25 * noise[1],
            "h": np.interp(at, fine, height) + 0.002 * noise[2],
        }

    def write(self, folder: Path, runs: Sequence[tuple[str, str, Corners, str]], seed: int) -> list[Path]:
        """Bundles of some runs (name, specimen, command, height of a step), one folder each."""
        rng, out = np.random.default_rng(seed), []
        for name, specimen, corners, step in runs:
            columns = self.measured(specimen, corners, float(step.partition("±")[0] or 0), rng)
            place = folder / name
            place.mkdir(parents=True)
            _csv(place / "data.csv", columns)
            _csv(place / "command.csv", {"t": [c[0] for c in corners], "p": [-c[1] for c in corners]})
            (place / "recording.yaml").write_text(_header(specimen, step), encoding="utf-8")
            out.append(place)
        return out


def lag(x: Array, tau: float) -> Array:
    """A first-order lag of time constant ``tau`` s of samples at `FINE` Hz, exact for steps."""
    keep, out, state = np.exp(-1.0 / (FINE * tau)), np.empty_like(x), x[0]
    for k, value in enumerate(x):
        state = value + (state - value) * keep
        out[k] = state
    return out


def _csv(path: Path, columns: Mapping[str, Sequence[float] | Array]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(columns)
        rows.writerows([f"{v:.4f}" for v in row] for row in zip(*columns.values(), strict=True))


def _header(specimen: str, step: str) -> str:
    time = "time: {column: t, unit: s}"
    channels = [("pressure", "p", "mbar"), ("apex_height", "h", "mm")]
    channels += [("pressure_reference", "second", "mbar")] if specimen == "manometer" else []
    lines = ["schema: recording-bundle/1", "instrument: cutometer", f"specimen: {specimen}"]
    lines += [f"specimen_properties: {{height: {step}}}"] if step else []
    lines += ["subject: P07", "site: forearm"] if specimen == "skin" else []
    lines += ["channels:"]
    lines += [f"  {c}: {{file: data.csv, column: {column}, unit: {unit}, {time}}}" for c, column, unit in channels]
    lines += ["setpoints:", f"  pressure: {{file: command.csv, column: p, unit: mbar, {time}}}"]
    return "\n".join(lines) + "\n"
