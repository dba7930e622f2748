"""``acquire status``: sessions that run on this computer, seen from another terminal."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from acquire.status import Report


def status(as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False) -> None:
    """Show the sessions of this user on this computer: their instruments, runs, progress and trips."""
    from acquire.status import reports

    found = reports()
    if as_json:
        rows = [{**r.content, "alive": r.alive, "silent": round(r.silent, 2)} for r in found]
        typer.echo(json.dumps({"sessions": rows}, indent=2))
        return
    for report in found:
        for line in lines(report):
            typer.echo(line)
    if not found:
        typer.echo("nothing runs")


def lines(report: Report) -> list[str]:
    """A session in words, with the remedy where its program is gone."""
    content = report.content
    head = f"{content['program']} (process {content['pid']}, since {content['since']}) on {content['station'] or '?'}"
    told = [f"{head}: {report.words}"]
    for row in content["instruments"]:
        told.append(f"  {row['name']}: {_course(row)}")
        if not report.alive:
            told.append(f"    see that it is safe: acquire safe --instrument {row['name']} (with its --station)")
            if row.get("journal") and row["state"] in ("armed", "running", "paused"):
                told.append(f"    its recording: acquire recover {row['journal']}")
    return told


def _course(row: dict[str, Any]) -> str:
    where = f"segment {row['segment'] + 1}/{row['segments']} {row['phase']}".strip() if row.get("segments") else ""
    clock = f"{row['elapsed']:.1f} of {row['duration']:.1f} s" if row.get("segments") else ""
    parts = (row["state"], row.get("protocol", ""), where, clock, row["trip"], row["away"], row.get("recording") or "")
    return ", ".join(str(part) for part in parts if part)
