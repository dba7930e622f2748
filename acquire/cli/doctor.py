"""``acquire doctor``: faults of this installation, and their remedies."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Annotated

import typer

from acquire.cli.app import BAD_INPUT


def doctor(as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False) -> None:
    """Look for faults of this installation; status 2 where something is broken."""
    from acquire.doctor import examine, home

    checks = examine()
    if as_json:
        typer.echo(json.dumps({"home": str(home()), "checks": [asdict(c) for c in checks]}, indent=2))
    else:
        typer.echo(f"skinrig in {home()}")
        for c in checks:
            typer.echo(f"{c.level:8} {c.name}: {c.found}" + (f"\n         {c.remedy}" if c.remedy else ""))
    if any(c.level == "fault" for c in checks):
        raise typer.Exit(BAD_INPUT)
