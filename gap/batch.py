"""Many cases at once: every folder of a set into one report."""

from __future__ import annotations

import json
import sys
from collections.abc import Collection, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from acquire.files import write_text
from acquire.recording import load
from gap.diagnosis import diagnose
from gap.report.document import as_json


def session_paths(folder: Path) -> list[Path]:
    """Recordings and bundles in a folder, by name."""
    bundles = sorted(p.parent for p in folder.rglob("recording.yaml"))
    return bundles + sorted(folder.rglob("*.h5"))


def diagnose_cases(cases: Path, output: Path, jobs: int = 1, only: Collection[str] | None = None) -> None:
    """Diagnose every case folder below ``cases``, or those named ``only``, into ``output/<case>.json``.

    A case whose data cannot be diagnosed gets a report that says so; one that has a report keeps it, so that a run
    can go on where it was broken off. Raises FileNotFoundError where there are no cases.
    """
    if not cases.is_dir():
        raise FileNotFoundError(f"{cases}: no such folder of cases")
    every = sorted(p for p in cases.iterdir() if p.is_dir())
    if not every:
        raise FileNotFoundError(f"{cases}: no case folder in it")
    every = [p for p in every if only is None or p.name in only]
    output.mkdir(parents=True, exist_ok=True)
    folders = [p for p in every if not (output / f"{p.name}.json").exists()]
    done = len(every) - len(folders)
    if done:
        print(f"{done} of {len(every)} have a report already", file=sys.stderr, flush=True)
    for k, (name, report) in enumerate(_reports(folders, jobs)):
        write_text(output / f"{name}.json", json.dumps(report) + "\n")
        print(f"{done + k + 1}/{len(every)} {name}: {report['verdict']}", file=sys.stderr, flush=True)


def _reports(folders: list[Path], jobs: int) -> Iterator[tuple[str, dict[str, Any]]]:
    if jobs <= 1:
        yield from map(diagnose_case, folders)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(diagnose_case, folders)


def diagnose_case(folder: Path) -> tuple[str, dict[str, Any]]:
    """Name and report of one case. Faults of the data become a report; those of the program are raised."""
    try:
        return folder.name, as_json(diagnose([load(p) for p in session_paths(folder)]))
    except (ValueError, LookupError, ArithmeticError, OSError) as error:
        reason = f"{type(error).__name__}: {error}"
        return folder.name, {
            "schema": "gap-report/1", "verdict": "unknown", "causes": [], "where": [], "remarks": [reason],
            "gap": {}, "indistinguishable": [], "next_experiment": {}, "cost": {},
        }  # fmt: skip
