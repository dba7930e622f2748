"""Many cases at once: every folder of a set into one report."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from acquire.recording import load
from gap.diagnose import diagnose
from gap.report import as_json


def session_paths(folder: Path) -> list[Path]:
    """Recordings and bundles in a folder, by name."""
    bundles = sorted(p.parent for p in folder.rglob("recording.yaml"))
    return bundles + sorted(folder.rglob("*.h5"))


def diagnose_cases(cases: Path, output: Path, jobs: int = 1) -> None:
    """Diagnose every case folder below ``cases`` into ``output/<case>.json``; a case that fails gets a report that
    says so."""
    output.mkdir(parents=True, exist_ok=True)
    folders = sorted(p for p in cases.iterdir() if p.is_dir())
    for k, (name, report) in enumerate(_reports(folders, jobs)):
        (output / f"{name}.json").write_text(json.dumps(report) + "\n")
        print(f"{k + 1}/{len(folders)} {name}: {report['verdict']}", file=sys.stderr, flush=True)


def _reports(folders: list[Path], jobs: int) -> Iterator[tuple[str, dict[str, Any]]]:
    if jobs <= 1:
        yield from map(diagnose_case, folders)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(diagnose_case, folders)


def diagnose_case(folder: Path) -> tuple[str, dict[str, Any]]:
    """Name and report of one case."""
    try:
        return folder.name, as_json(diagnose([load(p) for p in session_paths(folder)], advise=False))
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        return folder.name, {
            "schema": "gap-report/1", "verdict": "unknown", "causes": [], "where": [], "remarks": [reason],
            "gap": {}, "indistinguishable": [], "next_experiment": {}, "cost": {},
        }  # fmt: skip
