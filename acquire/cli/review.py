"""``acquire review``: whether a run counts with others, by a person's decision with a reason."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from acquire.recording import Recording

ALL = "Also runs that are left out (stopped, tripped, paused, or by a person's decision)."


def review(
    run: Annotated[Path, typer.Argument(help="A recording (.h5) or a bundle's folder.")],
    verdict: Annotated[
        bool | None, typer.Option("--include/--exclude", help="Let it count, or leave it out; neither: only show.")
    ] = None,
    reason: Annotated[str, typer.Option(help="Why; needed for a decision.")] = "",
    by: Annotated[str, typer.Option(help="Who decides.")] = "",
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Say or decide whether a run counts in means, bands, fits and diagnoses. The recording itself is not changed."""
    from acquire.recording import decide, left_out, load

    if verdict is None and (reason or by):
        raise ValueError("say --include or --exclude with a reason")
    if verdict is not None:
        decide(run, include=verdict, reason=reason, by=by)
    recording = load(run)
    why = left_out(recording)
    if as_json:
        found = {"id": recording.info.id, "left_out": why, "decisions": [asdict(d) for d in recording.decisions]}
        typer.echo(json.dumps(found, indent=2, ensure_ascii=False))
        return
    typer.echo(f"{recording.info.id}: {why or 'counts'}")
    for said in recording.decisions:
        what = "included" if said.include else "left out"
        typer.echo(f"  {said.time}  {what}{f' by {said.by}' if said.by else ''}: {said.reason}")


def counting(recordings: Sequence[Recording], *, everything: bool) -> list[Recording]:
    """Those that count; the others are named on stderr. Raises ValueError where none is left."""
    from acquire.recording import counted

    if everything:
        return list(recordings)
    kept, out = counted(recordings)
    for line in out:
        print(line, file=sys.stderr)
    if not kept:
        raise ValueError("every run is left out; --all uses all, and 'acquire review RUN --include' lets one count")
    return kept
