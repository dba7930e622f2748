"""Work of the analyst's process on recordings: lists, summaries and pictures as plain data."""

from __future__ import annotations

import io
import multiprocessing
import os
import signal
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from acquire.gui.messages import Measurement

COMPARED = 8  # earlier runs in one picture


@dataclass(frozen=True)
class Row:
    """A recording in the browser; ``instrument`` is the station's name for it."""

    path: Path
    start: str
    instrument: str
    protocol: str
    subject: str
    site: str
    repeat: int
    status: str
    problem: str = ""
    left_out: str = ""  # why it does not count with others

    @property
    def what(self) -> Measurement:
        """The measurement that it is a repeat of."""
        return Measurement(self.subject, self.site, self.protocol)


@dataclass(frozen=True)
class Result:
    """A recording for the result panel: `acquire.report.summary.summarise`, and pictures as PNG.

    ``compared`` is empty where the subject has no earlier run of the protocol at the site; ``others`` are those runs.
    """

    path: Path
    summary: dict[str, Any]
    picture: bytes
    compared: bytes
    others: tuple[str, ...]


def begin() -> None:
    """Prepare the process: it ends with the window, however that ends, and leaves Ctrl-C to the instruments."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    window = multiprocessing.parent_process()
    assert window is not None

    def follow() -> None:
        window.join()
        os._exit(0)

    threading.Thread(target=follow, name="follow-window", daemon=True).start()


def listing(folder: Path) -> tuple[Row, ...]:
    """Recordings and abandoned journals in ``folder``, the newest first; nothing if there is no such folder."""
    from acquire.catalogue import catalogue

    if not folder.is_dir():
        return ()
    rows = []
    for entry in catalogue(folder):
        info = entry.info
        if info is not None:
            rows.append(
                Row(
                    entry.path, info.start_time, info.device or info.instrument, info.protocol_name, info.subject,
                    info.site, info.repeat, info.status, left_out=entry.left_out,
                )
            )  # fmt: skip
        elif entry.path.suffix != ".journal":
            rows.append(Row(entry.path, "", "", entry.path.stem, "", "", 0, "unreadable", entry.problem))
        elif not entry.live:
            rows.append(Row(entry.path, "", "", entry.path.stem, "", "", 0, "not finished", entry.problem))
    return tuple(reversed(rows))


def result(path: Path) -> Result:
    """Everything the result panel shows of a recording. Raises RecordingError, FileNotFoundError."""
    from acquire.recording import load
    from acquire.report import figures
    from acquire.report.summary import summarise

    recording = load(path)
    earlier = _earlier(path, recording.info)
    compared = b""
    if earlier:
        compared = _png(figures.comparison([*(load(p) for p in earlier), recording]))
    return Result(
        path,
        summarise(recording),
        _png(figures.overview(recording)),
        compared,
        tuple(p.stem for p in earlier),
    )


def recovered(journal: Path) -> Path:
    """Make a recording of the journal a crash left, as `acquire recover` does."""
    from acquire.recording import settle

    return settle(journal)


def reviewed(paths: Sequence[Path], include: bool, reason: str, by: str) -> None:
    """Let runs count, or leave them out, beside their recordings. Raises ValueError, CannotWrite."""
    from acquire.recording import decide

    for path in paths:
        decide(path, include=include, reason=reason, by=by)


def _earlier(path: Path, info: Any) -> list[Path]:
    """Runs of the same protocol on the same subject and site that began before and count."""
    from acquire.catalogue import catalogue

    same = [
        entry.path
        for entry in catalogue(path.parent)
        if entry.info is not None
        and not entry.left_out
        and entry.info.start_time < info.start_time
        and (entry.info.subject, entry.info.site, entry.info.protocol_name)
        == (info.subject, info.site, info.protocol_name)
    ]
    return same[-COMPARED:]


def _png(figure: Any) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=90)
    return buffer.getvalue()
