"""Every number of docs/validation/sheet.md: paper M's rows run forward, and what each assumption moves.

    python benchmarks/validate_sheet.py              # everything, a few minutes
    python benchmarks/validate_sheet.py rows solid   # parts by name

Forces are the largest of the third triangular cycle at 1.3 mm, along x, along y and along the normal.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from math import radians
from pathlib import Path

import numpy as np

from skinrig_solver import Experiment, SolverError, models

WAYS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
REACH = 1.3e-3


@dataclass(frozen=True)
class Row:
    """One row of the paper's tables: where, law, its parameters (SI), pre-stress [kPa], variance accounted for [%]."""

    region: str
    law: str
    values: tuple[float, ...]
    prestress: tuple[float, float]
    vaf: float

    @property
    def parameters(self) -> dict[str, float]:
        info = models()[f"sheet_{self.law}"].info
        loads = {"sx": 1e3 * self.prestress[0], "sy": 1e3 * self.prestress[1]}
        return {**dict(zip(info.symbols, self.values, strict=False)), **loads}


ROWS = (
    Row("forearm stiff", "ogden", (29.16e3, 1.71, 2.15, 40.09), (84, 61), 98),
    Row("forearm stiff", "tong_fung", (0.0107, 40.636, 21.837, 12.754e3, 6.057, 38.046e3), (92, 49), 99),
    Row("forearm medium", "ogden", (19.40e3, 1.00, 0.03, 54.02), (48, 39), 97),
    Row("forearm medium", "tong_fung", (0.0207, 34.167, 54.740, 19.676e3, 0.008, 53.306e3), (51, 31), 98),
    Row("forearm supple", "ogden", (10.06e3, 1.43, 0.001, 37.62), (39, 28), 98),
    Row("upper arm", "ogden", (27.04e3, 3.79, 2.77, 39.38), (22, 48), 98),
    Row("forehead", "bischoff", (6.632e20, 0.8529, 1.272, 1.386), (25, 23), 94),
    Row("forehead, n x 1000", "bischoff", (6.632e23, 0.8529, 1.272, 1.386), (25, 23), 94),
    Row("forehead", "fung", (0.3118e3, 0.9982e3, 1.005e3, 7.169e3, 7.142e3), (7, 3), 94),
    Row("forehead", "gasser", (14.08e3, 11.01e3, 0.09188, radians(30.82)), (26, 18), 79),
    Row("forehead", "ogden", (53.95e3, 1.868, 0.3012, 69.00), (34, 27), 94),
    Row("near lip", "ogden", (41.29e3, 1.658, 0.16, 54.964), (24, 16), 93),
    Row("central cheek", "bischoff", (1.246e21, 0.7880, 1.246, 1.446), (53, 46), 92),
    Row("central cheek, n x 1000", "bischoff", (1.246e24, 0.7880, 1.246, 1.446), (53, 46), 92),
    Row("central jaw", "fung", (0.5010e3, 1.000e3, 1.000e3, 3.322e3, 5.919e3), (20, 16), 95),
)
FOREARM, FOREHEAD = ROWS[0], ROWS[10]


def cycle(way: str, geometry: Mapping[str, object], cycles: int = 3, rate: float = 10.0) -> Experiment:
    """Triangular 0.1 Hz cycles along ``way``."""
    time = np.arange(round(10.0 * cycles * rate) + 1) / rate
    path = REACH * (1.0 - np.abs((time / 10.0 % 1.0) * 2.0 - 1.0))
    drive = {f"probe_{axis}": path * x for axis, x in zip("xyz", WAYS[way], strict=True)}
    return Experiment("microrobot", time, drive, geometry)


def run(row: Row, way: str, geometry: Mapping[str, object], **changes: float) -> tuple[float, float, dict[str, float]]:
    """Largest force [N] and share of energy lost in the last cycle, and the result's notes."""
    experiment = cycle(way, geometry)
    result = models()[f"sheet_{row.law}"].simulate(experiment, {**row.parameters, **changes})
    last = experiment.time >= experiment.time[-1] - 10.0
    force, path = -result.channels[f"force_{way}"][last], experiment.drive[f"probe_{way}"][last]
    half = force.size // 2 + 1
    lost = np.trapezoid(force, path) / np.trapezoid(force[:half], path[:half])
    return float(force.max()), float(lost), result.notes


def forces(row: Row, geometry: Mapping[str, object], **changes: float) -> str:
    """The three forces [N], or what failed."""
    shown = []
    for way in WAYS:
        try:
            shown.append(f"{run(row, way, geometry, **changes)[0]:.2f}")
        except SolverError:
            shown.append("locked")
    return " / ".join(shown)


def rows() -> None:
    """Every row, pre-stress as dead loads (with and without creep) and as an initial stress."""
    print("| region | law | pre-stretch x, y | dead loads | dead loads, 5 s ramp | initial stress | loss % |")
    print("|---|---|---|---|---|---|---|")
    for row in ROWS:
        _, lost, _ = run(row, "x", {"prestress_mode": "initial"})
        try:
            _, lost, notes = run(row, "x", {})
            stretch = f"{notes['prestretch_x']:.2f}, {notes['prestretch_y']:.2f}"
        except SolverError:
            stretch = "locked"
        cells = [forces(row, g) for g in ({}, {"prestress_ramp": 5.0}, {"prestress_mode": "initial"})]
        print(f"| {row.region} | {row.law} | {stretch} | {' | '.join(cells)} | {100 * lost:.0f} |")


def sites() -> None:
    """Rows of one site beside each other: they fitted the same data, so they should give the same forces."""
    print("| region | pre-stress | law | x / y / normal, N | over the row above | stiffest along |")
    print("|---|---|---|---|---|---|")
    every: dict[str, list[Row]] = {}
    for row in ROWS:
        every.setdefault(row.region.removesuffix(", n x 1000"), []).append(row)
    for region, own in every.items():
        for mode in ("load", "initial") if len(own) > 1 else ():
            before: list[float] = []
            for row in own:
                try:
                    found = [run(row, way, {"prestress_mode": mode})[0] for way in WAYS]
                    axis = f"{stiffest(row, mode):.0f}°"
                except SolverError:
                    continue  # a printed chain density that locks
                ratio = " / ".join(f"{f / b:.2f}" for f, b in zip(found, before, strict=True)) if before else ""
                law = row.law + row.region.removeprefix(region)
                print(f"| {region} | {mode} | {law} | {' / '.join(f'{f:.2f}' for f in found)} | {ratio} | {axis} |")
                before = found


def stiffest(row: Row, mode: str, step: float = 30.0) -> float:
    """The in-plane direction [degrees from x, below 180] in which the probe meets the largest force along its way."""
    time = np.linspace(0.0, 30.0, 151)
    path = REACH * (1.0 - np.abs((time / 10.0 % 1.0) * 2.0 - 1.0))
    angles, peaks = np.arange(0.0, 180.0, step), []
    for angle in np.radians(angles):
        way = np.array([np.cos(angle), np.sin(angle)])
        drive = {"probe_x": path * way[0], "probe_y": path * way[1], "probe_z": 0.0 * path}
        experiment = Experiment("microrobot", time, drive, {"prestress_mode": mode})
        channels = models()[f"sheet_{row.law}"].simulate(experiment, row.parameters).channels
        peaks.append(-(channels["force_x"] * way[0] + channels["force_y"] * way[1])[100:].min())
    return float(angles[int(np.argmax(peaks))])


def geometry() -> None:
    """Shifts by the missing geometry: hole, probe patch, thickness, frame."""
    print("| changed | forearm stiff, Ogden, dead loads | the same, initial stress | forehead, Ogden, dead loads |")
    print("|---|---|---|---|")
    changes: dict[str, dict[str, object]] = {"nothing": {}}
    changes |= {f"hole radius {1e3 * r:.0f} mm": {"hole_radius": r} for r in (10e-3, 15e-3, 25e-3)}
    changes |= {f"probe radius {1e3 * r:.1f} mm": {"probe_radius": r} for r in (1.5e-3, 2.5e-3)}
    changes |= {f"thickness {1e3 * h:.1f} mm": {"thickness": h} for h in (1.0e-3, 2.0e-3)}
    changes["hole and probe round on the stretched sheet"] = {"frame": "spatial"}
    for name, change in changes.items():
        initial = {**change, "prestress_mode": "initial"}
        print(f"| {name} | {forces(FOREARM, change)} | {forces(FOREARM, initial)} | {forces(FOREHEAD, change)} |")


def parameters() -> None:
    """Shifts by the bulk modulus, the relaxation and the pre-stress."""
    print("| changed | forearm stiff, Ogden, dead loads | loss along x % |")
    print("|---|---|---|")
    changes: dict[str, dict[str, float]] = {
        "nothing": {},
        "B = 0.3 MPa": {"bulk": 0.3e6},
        "B = 10 MPa": {"bulk": 10e6},
        "no relaxation": {"gbar": 0.0},
        "pre-stress halved": {"sx": 42e3, "sy": 30.5e3},
        "pre-stress 20 kPa each": {"sx": 20e3, "sy": 20e3},
    }
    for name, change in changes.items():
        print(f"| {name} | {forces(FOREARM, {}, **change)} | {100 * run(FOREARM, 'x', {}, **change)[1]:.0f} |")


def solid() -> None:
    """Errors of the membrane: against a solid with bending, edges clamped."""
    print("| row | along | membrane N | solid N | membrane low by |")
    print("|---|---|---|---|---|")
    for row, mode in ((FOREARM, "load"), (FOREARM, "initial"), (FOREHEAD, "load")):
        for way in WAYS:
            base = {"prestress_mode": mode, "points": 5}
            thin, thick = (run(row, way, {**base, "element": kind})[0] for kind in ("membrane", "solid"))
            print(f"| {row.region}, {mode} | {way} | {thin:.4f} | {thick:.4f} | {100 * (1 - thin / thick):.1f} % |")


def accuracy() -> None:
    """Mesh and points against a fine reference, and the convolution against every point's stress history."""
    print("| discretisation | error along x | along z |")
    print("|---|---|---|")
    fine = {way: _trace(way, {"radial": 14, "around": 40, "points": 14}) for way in "xz"}
    coarser: dict[str, dict[str, object]] = {
        "default: 6 x 16, 7 points": {},
        "4 x 12": {"radial": 4, "around": 12},
        "10 x 24": {"radial": 10, "around": 24},
        "5 points": {"points": 5},
        "10 points": {"points": 10},
    }
    for name, change in coarser.items():
        errors = [np.abs(_trace(w, change) - fine[w]).max() / np.abs(fine[w]).max() for w in "xz"]
        print(f"| {name} | {100 * errors[0]:.3f} % | {100 * errors[1]:.3f} % |")
    print("\n| pre-stress | along | largest difference of convolution and history, of the peak |")
    print("|---|---|---|")
    for mode in ("load", "initial"):
        for way in "xz":
            short, full = (
                _trace(way, {"prestress_mode": mode, "relaxation": r}, 1) for r in ("convolution", "history")
            )
            print(f"| {mode} | {way} | {100 * np.abs(short - full).max() / np.abs(full).max():.1f} % |")


def _trace(way: str, geometry: Mapping[str, object], cycles: int = 3) -> np.ndarray:
    result = models()["sheet_ogden"].simulate(cycle(way, geometry, cycles), FOREARM.parameters)
    return result.channels[f"force_{way}"]


def chains() -> None:
    """The Bischoff rows against the chain density."""
    print("| n / printed | n k theta | forehead, dead loads | forehead, initial stress |")
    print("|---|---|---|---|")
    row = ROWS[6]
    for factor in (1.0, 1e1, 1e2, 1e3, 1e4):
        n = factor * row.values[0]
        cells = [forces(row, g, n=n) for g in ({}, {"prestress_mode": "initial"})]
        print(f"| {factor:g} | {n * 1.38e-23 * 298:.3g} Pa | {' | '.join(cells)} |")


def whole() -> None:
    """Paper M's two steps on the whole square sheet (NGSolve), elastic, against the ring and its pre-stretch."""
    import sheet_peers as peers

    from skinrig_solver.laws import LAWS

    print("| law | F at the centre of the whole sheet | stretches here | force there N | force here N |")
    print("|---|---|---|---|---|")
    for law, loads in (("ogden", (84e3, 61e3)), ("gasser", (26e3, 18e3))):
        force, F = peers.whole_sheet(law, loads)
        p = np.array([q.default for q in LAWS[law].parameters])
        state = peers.stretch(LAWS[law], p, np.array(loads))
        body = peers.Sheet(LAWS[law], p, peers.ring(2e-3, 20e-3, 6, 16), 1.5e-3, state)
        for k in range(1, 7):
            body.move(np.array([REACH * k / 6, 0.0, 0.0]))
        there, here = (", ".join(f"{x:.3f}" for x in np.abs(f[:2])) for f in (force, body.force))
        matrix = np.array2string(F.round(3), separator=", ").replace("\n", "")
        print(f"| {law} | {matrix} | {state.stretches.round(3)} | {there} | {here} |")


def figure() -> None:
    """docs/validation/sheet.png: the moved sheet, its loops, and the force in every direction for four rows."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.collections import PolyCollection

    figure = plt.figure(figsize=(13.0, 4.2), layout="constrained")
    mesh, loops = figure.add_subplot(1, 3, 1), figure.add_subplot(1, 3, 2)
    rose = figure.add_subplot(1, 3, 3, projection="polar")

    model = models()["sheet_ogden"]
    field = model.simulate(cycle("x", {}), FOREARM.parameters).fields[0]
    enlarged = 1e3 * (field.nodes + 3.0 * field.displacement)[:, :2]
    corners = field.cells[:, :4]
    shift = np.linalg.norm(1e3 * field.displacement, axis=1)[corners].mean(axis=1)
    cells = PolyCollection(enlarged[corners], array=shift, cmap="viridis", edgecolors="white", linewidths=0.4)
    mesh.add_collection(cells)
    mesh.set(xlim=(-21, 21), ylim=(-21, 21), aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    mesh.set_title("probe 1.3 mm along x (drawn 3 times)")
    figure.colorbar(cells, ax=mesh, label="displacement [mm]", shrink=0.8)

    for way in WAYS:
        experiment = cycle(way, {}, rate=50.0)
        force = model.simulate(experiment, FOREARM.parameters).channels[f"force_{way}"]
        label = "normal (x 10)" if way == "z" else f"along {way}"
        loops.plot(1e3 * experiment.drive[f"probe_{way}"], -force * (10.0 if way == "z" else 1.0), label=label, lw=1.2)
    loops.set(
        xlabel="probe [mm]", ylabel="force of the probe on the skin [N]", title="forearm stiff, Ogden, three cycles"
    )
    loops.legend(frameon=False)

    angle = np.radians(np.arange(0, 361, 15))
    time = np.linspace(0.0, 30.0, 151)
    path = REACH * (1.0 - np.abs((time / 10.0 % 1.0) * 2.0 - 1.0))
    for row in (FOREHEAD, ROWS[7], ROWS[8], ROWS[9]):
        peak = []
        for a in angle:
            way = np.array([np.cos(a), np.sin(a)])
            experiment = Experiment("microrobot", time, {"probe_x": path * way[0], "probe_y": path * way[1]})
            channels = models()[f"sheet_{row.law}"].simulate(experiment, row.parameters).channels
            peak.append(-(channels["force_x"] * way[0] + channels["force_y"] * way[1])[100:].min())
        rose.plot(angle, peak, label=f"{row.law}{row.region.removeprefix('forehead')}", lw=1.2)
    rose.set_title("forehead rows: force along the probe's way [N]", pad=16)
    rose.set_rlabel_position(250)
    rose.legend(frameon=False, loc="lower left", bbox_to_anchor=(0.95, 0.75))
    target = Path(__file__).parents[2] / "docs" / "validation" / "sheet.png"
    figure.savefig(target, dpi=110)
    print(f"wrote {target.name}")


PARTS = {
    "rows": rows,
    "sites": sites,
    "geometry": geometry,
    "parameters": parameters,
    "solid": solid,
    "accuracy": accuracy,
    "chains": chains,
    "whole": whole,
    "figure": figure,
}

if __name__ == "__main__":
    for part in sys.argv[1:] or PARTS:
        print(f"\n== {part}\n")
        PARTS[part]()
