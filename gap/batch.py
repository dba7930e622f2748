"""Many cases at once: every folder of a set into one report."""

from __future__ import annotations

import json
import sys
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from acquire.files import write_text
from acquire.qualifications import dump
from acquire.recording import load
from acquire.recording.model import Recording
from gap.data.session import SKIN
from gap.diagnosis import diagnose
from gap.qualify.judge import qualify
from gap.report.document import as_json

QUALIFICATIONS = ("with", "without")
"""Of cases with references, skin alone can be diagnosed: with a qualification by their references, or without."""


def session_paths(folder: Path) -> list[Path]:
    """Recordings and bundles in a folder, by name."""
    bundles = sorted(p.parent for p in folder.rglob("recording.yaml"))
    return bundles + sorted(folder.rglob("*.h5"))


def of_skin(recordings: Sequence[Recording]) -> list[Recording]:
    """The recordings of skin among those of a session."""
    return [r for r in recordings if r.info.specimen == SKIN]


def qualified_by(recordings: Sequence[Recording], file: Path) -> Path:
    """The ``file`` of a qualification by a session's references; made, unless it is there.

    Raises DiagnosisError where the session has none.
    """
    if not file.exists():
        write_text(file, dump(qualify(recordings).qualification))
    return file


def diagnose_cases(
    cases: Path, output: Path, jobs: int = 1, only: Collection[str] | None = None, qualification: str = ""
) -> None:
    """Diagnose every case folder below ``cases``, or those named ``only``, into ``output/<case>.json``; of
    `QUALIFICATIONS`, skin alone, without recordings of references.

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
    for k, (name, report) in enumerate(_reports(folders, jobs, qualification)):
        write_text(output / f"{name}.json", json.dumps(report) + "\n")
        print(f"{done + k + 1}/{len(every)} {name}: {report['verdict']}", file=sys.stderr, flush=True)


def _reports(folders: list[Path], jobs: int, qualification: str) -> Iterator[tuple[str, dict[str, Any]]]:
    one = partial(diagnose_case, qualification=qualification)
    if jobs <= 1:
        yield from map(one, folders)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(one, folders)


def diagnose_case(folder: Path, qualification: str = "") -> tuple[str, dict[str, Any]]:
    """Name and report of one case. Faults of the data become a report; those of the program are raised."""
    try:
        recordings = [load(p) for p in session_paths(folder)]
        if not qualification:
            return folder.name, as_json(diagnose(recordings))
        with TemporaryDirectory() as place:
            q = qualified_by(recordings, Path(place) / "qualification.yaml") if qualification == "with" else None
            return folder.name, as_json(diagnose(of_skin(recordings), qualification=q))
    except (ValueError, LookupError, ArithmeticError, OSError) as error:
        reason = f"{type(error).__name__}: {error}"
        return folder.name, {
            "schema": "gap-report/1", "verdict": "unknown", "causes": [], "where": [], "remarks": [reason],
            "gap": {}, "indistinguishable": [], "next_experiment": {}, "cost": {},
        }  # fmt: skip
