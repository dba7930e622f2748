"""Whether a run counts in means, bands, fits and diagnoses: by how it ended, unless a person decided otherwise.

A recording is evidence and is not written to again. Decisions stand in a file beside it, ``NAME.review.jsonl`` beside
``NAME.h5`` or the bundle's folder ``NAME``: one JSON object a line with the run's ``id``, ``include``, ``reason``,
``by`` and ``time``, appended, never changed. The last one holds; all of them are kept.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TypeVar

from acquire.files import PRIVATE, sync_folder, told
from acquire.recording.journal import iso_now
from acquire.recording.model import Decision, Recording, RecordingError
from protocols.files import contents

SUFFIX = ".review.jsonl"
MOST = 1 << 20  # bytes of a review file
LONGEST = 500  # characters of a reason
WHOLE = ("completed", "imported")  # states in which a run holds all that its protocol asked for
R = TypeVar("R", bound=Recording)


def left_out(recording: Recording) -> str:
    """Why a run does not count with others; '' where it does.

    The last decision of a person holds. Without one a run is left out that was stopped, tripped, failed or crashed, and
    one that was paused: its time course is not its protocol's.
    """
    if recording.decisions:
        last = recording.decisions[-1]
        return "" if last.include else f"left out{f' by {last.by}' if last.by else ''}: {last.reason}"
    info = recording.info
    if info.status not in WHOLE:
        return f"the run {info.status}" + (f": {info.trip_reason}" if info.trip_reason else "")
    if any(event.code == "pause" for event in recording.events):
        return "the run was paused: its time course is not its protocol's"
    return ""


def counted(recordings: Sequence[R]) -> tuple[list[R], list[str]]:
    """Those of ``recordings`` that count, and a line for each that is left out."""
    reasons = [(recording, left_out(recording)) for recording in recordings]
    return [r for r, why in reasons if not why], [f"{r.info.id} is left out: {why}" for r, why in reasons if why]


def beside(path: Path | str) -> Path:
    """The review file of a recording or bundle."""
    path = Path(path)
    return path.with_name(path.name.removesuffix(".h5") + SUFFIX)


def decisions(path: Path | str, run: str) -> tuple[Decision, ...]:
    """Decisions of persons about run ``run`` in the recording at ``path``, in that order; empty where nobody did.

    A line that cannot be read may have left the run out: it leaves it out. Raises RecordingError for a file that is
    none of ours.
    """
    file = beside(path)
    try:
        lines = contents(file, MOST).decode().splitlines()
    except FileNotFoundError:
        return ()
    except ValueError as error:
        raise RecordingError(str(error)) from error
    found = []
    for number, line in enumerate(lines, 1):
        try:
            said = json.loads(line)
            texts = {name: str(said[name]) for name in ("reason", "by", "time")}
            decision, about = Decision(include=said["include"] is True, **texts), said["id"]
        except (ValueError, LookupError, TypeError):
            decision, about = Decision(False, f"line {number} of {file.name} cannot be read"), run
        if about == run:
            found.append(decision)
    return tuple(found)


def decide(path: Path | str, *, include: bool, reason: str, by: str = "") -> Decision:
    """Let the run at ``path`` count, or leave it out, for ``reason``; earlier decisions stay in the file.

    Raises ValueError without a reason, RecordingError where there is no recording, CannotWrite.
    """
    from acquire.recording import load

    reason, by = " ".join(reason.split()), " ".join(by.split())
    if not reason or len(reason) > LONGEST:
        raise ValueError(f"a decision about a run needs a reason of at most {LONGEST} characters")
    run = load(path).info.id
    decision = Decision(include, reason, by, iso_now())
    line = json.dumps({"id": run, **asdict(decision)}, ensure_ascii=False).encode() + b"\n"
    file = beside(path)
    flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    with told(file):
        torn = file.is_file() and not (file.read_bytes() or b"\n").endswith(b"\n")
        descriptor = os.open(file, flags, PRIVATE)
        try:
            os.write(descriptor, b"\n" + line if torn else line)
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
        sync_folder(file.parent)
    return decision
