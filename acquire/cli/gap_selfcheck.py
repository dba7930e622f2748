"""``acquire gap selfcheck``: the effects that a session like this one could have shown."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from acquire.cli.inputs import load_all
from acquire.cli.numbers import MOST_JOBS, whole
from acquire.cli.review import ALL, counting

SCHEMA = "gap-selfcheck/1"
MORE_OFTEN = 0.5
"""Share of sessions from which on an effect is found more often than missed."""


def selfcheck(
    runs: Annotated[list[Path], typer.Argument(help="Recordings, bundles, or folders of them (one session).")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="JSON file, for `diagnose --selfcheck`.")
    ] = None,
    full: Annotated[int, typer.Option(parser=whole(), help="Whole diagnoses, of as many effects drawn.")] = 0,
    effects: Annotated[list[Path] | None, typer.Option(help="Python file(s) with further effects.")] = None,
    seed: Annotated[int, typer.Option(parser=whole(), help="Seed of noise and strengths.")] = 1,
    jobs: Annotated[int, typer.Option(parser=whole(1, MOST_JOBS), help="Processes that share the fits.")] = 1,
    everything: Annotated[bool, typer.Option("--all", help=ALL)] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
) -> None:
    """Put each effect at its just-visible size into sessions like this one, and say how often it would be found."""
    from acquire.files import write_text
    from gap.design import selfcheck as linear
    from gap.effects import library
    from gap.loop.fully import tried

    recordings = counting(load_all(runs), everything=everything)
    known = library(recordings[0].info.instrument, effects or ())
    checked = linear.selfcheck(recordings, known, seed)
    whole_ones = tried(recordings, checked, known, full, seed, jobs, lambda text: print(text, file=sys.stderr))
    said = {
        "schema": SCHEMA,
        "instrument": recordings[0].info.instrument,
        "recordings": [r.info.id for r in recordings],
        "visible_at": linear.VISIBLE,
        "effects": [c.as_dict() for c in checked],
        "full": [t.as_dict() for t in whole_ones],
    }
    if output:
        write_text(output, json.dumps(said, indent=1) + "\n")
    if as_json:
        print(json.dumps(said, indent=1))
        return
    print(linear.as_text(checked))
    if whole_ones:
        right = sum(t.right for t in whole_ones)
        print(f"\nwhole diagnoses: {right} of {len(whole_ones)} named the effect")
    if output:
        print(f"\n{output}")


def cited(path: Path, recordings: Sequence[str], causes: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """A self-check as a report cites it: effects the session could not have shown, and the recovery of the first cause.

    Raises ValueError for a file that is no self-check, or one of another session.
    """
    try:
        said = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: is no self-check: {error}") from None
    if not isinstance(said, dict) or said.get("schema") != SCHEMA:
        raise ValueError(f"{path}: is not of schema {SCHEMA}")
    if missing := [r for r in said["recordings"] if r not in recordings]:
        raise ValueError(f"{path}: is of another session: recording {missing[0]} is not among these")
    weak = [e for e in said["effects"] if e["minimum_visible"] is None and e["parameter"]]
    unseen = [e["effect"] for e in weak if e["recovery"] < MORE_OFTEN]
    named = causes[0]["effects"] if causes else []
    first = [e for e in said["effects"] if e["effect"] in named]
    total = len(said["effects"])
    text = f"By its self-check this session could not have shown {len(unseen)} of {total} effects at any strength."
    if faint := len(weak) - len(unseen):
        text += f" {faint} more would show at their greatest strength alone, and not surely."
    for e in first:
        name, share = e["effect"].replace("_", " ").capitalize(), 100 * e["recovery"]
        strength = "at its greatest strength" if e in weak else "just visible"
        text += f" {name}, {strength}, would be named in {share:.0f} % of such sessions."
    return {"text": text, "unseen": unseen, "first": first}
