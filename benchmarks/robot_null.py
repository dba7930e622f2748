"""How near the noise the micro-robot's blocks come without any effect, for every case of a folder.

python benchmarks/robot_null.py CASES [LIMIT]: per case the fitted controller, the axes' gap, the penalty of the loop's
tolerances, what the sheet's law has, and the force's gap and log evidence under each law: simple ones, then the usual
or a further one beside each width of the discrepancy; a single one where a simple law clearly is the skin's.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from acquire.recording import load
from gap.batch import session_paths
from gap.inference.least_squares import fit
from gap.null.groups import GroupedSession
from gap.null.robot_axes import QUANTITIES, AxesBlock
from gap.null.robot_force import ForceBlock
from gap.null.robot_loop import CONTROLLERS
from gap.null.sheet_law import AMOUNTS


def report(case: Path) -> str:
    """One line on a case; empty for another instrument."""
    recordings = [load(p) for p in session_paths(case)]
    if recordings[0].info.instrument != "microrobot":
        return ""
    session = GroupedSession(recordings, QUANTITIES)
    axes = AxesBlock(session, {})
    force = ForceBlock(session, {}, axes)
    a, f = fit(axes), fit(force)
    evidence = f.evidences(1.0, force.prior_scales)
    law = " ".join(name for name in AMOUNTS if f.nuisance[force.TISSUE.index(name)]) or "any spectrum"
    return (
        f"{case.name} controller {CONTROLLERS.index(axes.controller)} axes {gap(a.residual):.3f} "
        f"penalty {a.penalty:.0f} "
        f"law {law} force {gap(f.residual):.3f} evidence {' '.join(f'{e:.0f}' for e in evidence)}"
    )


def gap(residual: np.ndarray) -> float:
    """rms of a whitened residual."""
    return float(np.sqrt(np.mean(np.square(residual))))


def main(folder: str, limit: str = "20") -> None:
    lines = (report(case) for case in sorted(Path(folder).iterdir()) if case.is_dir())
    for _, line in zip(range(int(limit)), filter(None, lines), strict=False):
        print(line, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
