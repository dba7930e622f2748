"""Measuring the standard set: one recording for each step, a person in between; existing recordings are kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from acquire.engine import Aborted, Progress, State, Tripped
from acquire.recording import JournalBusy, Recording, RecordingError, open_recording, put_by, settle
from acquire.session import Request, Session
from gap.qualify.kept import in_words, kept, recording_of
from gap.qualify.steps import Step

Ask = Callable[[int, Step], None]
"""Tells a person the step with this number, and returns when it is mounted; raises Aborted where it is not to be."""


class NotMeasured(Tripped):
    """A step's run did not come to its end; the message says which and why."""


def measure(
    session: Session,
    name: str,
    steps: Sequence[Step],
    folder: Path,
    ask: Ask,
    watch: Callable[[Step, Progress], None] = lambda step, progress: None,
    operator: str = "",
    tell: Callable[[str], None] = lambda text: None,
) -> list[Recording]:
    """Recordings of ``steps`` on the station's instrument ``name``, in ``folder``; those that are there are not made
    again, and ``tell`` is told how many.

    Raises NotMeasured, Aborted, ValueError, DeviceError.
    """
    have = kept(session, name, steps, folder)
    if have:
        tell(in_words(have, steps))
    for number, step in enumerate(steps, start=1):
        if step.name in have:
            continue
        path = recording_of(step, folder)
        _put_aside(path)
        ask(number, step)
        notes = f"qualification: {step.name}"
        request = Request(operator=operator, specimen=step.specimen, specimen_properties=step.known, notes=notes)
        outcome = session.run(step.protocol, request, name=name, out=path, watch=partial(watch, step))
        if outcome.status is State.ABORTED:
            raise Aborted(outcome.reason or "aborted by a person")
        if outcome.status is not State.COMPLETED:
            raise NotMeasured(f"step {step.name}: {outcome.status}: {outcome.reason}")
    return [open_recording(recording_of(step, folder)) for step in steps]


def _put_aside(path: Path) -> None:
    """Keep a run that did not come to its end under another name, a crash's journal as the recording made of it.

    Raises JournalBusy where another program is recording into that journal.
    """
    if path.exists():
        path.rename(_unfinished(path))
    journal = path.with_suffix(".journal")
    if not journal.exists():
        return
    aside = _unfinished(journal)
    try:
        settle(journal, aside)
    except JournalBusy:
        raise
    except RecordingError:  # it has no readable beginning
        put_by(journal, aside.stem)


def _unfinished(path: Path) -> Path:
    return path.with_name(f"{path.stem}-unfinished-{path.stat().st_mtime_ns}.h5")
