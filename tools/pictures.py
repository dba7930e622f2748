"""The README's pictures, drawn from the output of `make demo`: ``python tools/pictures.py out/demo docs/pictures``."""

from __future__ import annotations

import argparse
from pathlib import Path

from acquire.cli.inputs import load_all
from acquire.recording import open_recording
from acquire.report.figures import overview
from gap.diagnosis import Diagnosis, diagnose
from gap.report.document import sentences

INSTRUMENTS = ("cutometer", "aspiration", "microrobot")
MEASURED, NOMINAL, WITH_EFFECT = "#1d2733", "#d0781c", "#0b6e99"
LEVEL, TRIANGLE = 2, 4  # recordings of the demo's session that are shown


def diagnosis_picture(d: Diagnosis, path: Path) -> None:
    """Measured pressure of two recordings beside the simulation without and with the effect found."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    problem = d.problems["pressure"]
    figure, axes = plt.subplots(2, 2, figsize=(9, 4.6), height_ratios=(3, 2), sharex="col", layout="constrained")
    for (top, low), run in zip(axes.T, (LEVEL, TRIANGLE), strict=True):
        at = problem.rows.recording == run
        time = problem.rows.time[at] - problem.rows.time[at][0]
        measured, sigma = problem.measured[at], problem.sigma[at]
        for fit, colour, label in (
            (d.comparison.null, NOMINAL, "nominal, refitted"),
            (d.best, WITH_EFFECT, "with the effect"),
        ):
            residual = fit.fits["pressure"].residual[at]
            top.plot(time, (measured - residual * sigma) / 100, color=colour, lw=1.6, label=label)
            low.plot(time, residual, color=colour, lw=1.2)
        top.plot(time, measured / 100, ".", color=MEASURED, ms=2.5, label="measured")
        low.set_xlabel("time (s)")
        for ax in (top, low):
            ax.spines[["top", "right"]].set_visible(False)
    axes[0, 0].set_ylabel("pressure (mbar)")
    axes[1, 0].set_ylabel("residual / noise")
    axes[0, 0].legend(frameon=False, loc="center", markerscale=4)
    figure.suptitle("\n".join(sentences(d)), fontsize=10, x=0.02, ha="left")
    figure.savefig(path, dpi=90)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("demo", type=Path, help="folder that the demo wrote")
    parser.add_argument("pictures", type=Path, help="folder for the pictures")
    arguments = parser.parse_args()
    arguments.pictures.mkdir(parents=True, exist_ok=True)
    for name in INSTRUMENTS:
        figure = overview(open_recording(arguments.demo / f"{name}.h5"))
        figure.savefig(arguments.pictures / f"{name}.png", dpi=62)
    diagnosis_picture(diagnose(load_all([arguments.demo / "session"])), arguments.pictures / "diagnosis.png")


if __name__ == "__main__":
    main()
