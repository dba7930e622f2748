"""``acquire check``: compile a protocol and say what it does, or where it is wrong."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from protocols import Limits, Protocol

BAD_INPUT = 2


def check(
    protocol: Annotated[str, typer.Argument(help="A YAML file or a name of the library; none: list the library.")] = "",
    png: Annotated[Path | None, typer.Option(help="Draw the set-points into this file.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
    schema: Annotated[bool, typer.Option("--schema", help="Print the JSON schema of protocols, for editors.")] = False,
) -> None:
    """Check a protocol against its instrument's limits; print duration, steps and limits."""
    from protocols import ProtocolError, json_schema

    if schema:
        typer.echo(json.dumps(json_schema(), indent=2))
        return
    if not protocol:
        _list(as_json)
        return
    try:
        _check(protocol, png, as_json)
    except ProtocolError as error:
        if as_json:
            problems = [
                {"line": p.line, "column": p.column, "field": p.field, "message": p.message} for p in error.problems
            ]
            typer.echo(json.dumps({"ok": False, "file": error.file, "problems": problems}, indent=2))
        else:
            typer.echo(str(error), err=True)
        raise typer.Exit(BAD_INPUT) from None


def _check(name: str, png: Path | None, as_json: bool) -> None:
    from protocols import compile_protocol, effective_limits, find, load
    from protocols.summary import draw, in_words, summarise

    path = find(name)
    protocol = load(path)
    hardware = _hardware_limits(protocol)
    setpoints = compile_protocol(protocol, hardware)
    limits = effective_limits(protocol, hardware)
    summary = summarise(protocol, setpoints, limits)
    if png is not None:
        draw(protocol, setpoints, limits, png)
    if as_json:
        typer.echo(json.dumps({"ok": True, "file": str(path), "limits_of": limits.origin, **summary}, indent=2))
    else:
        typer.echo(in_words(summary))


def _hardware_limits(protocol: Protocol) -> Limits:
    """What the instrument's driver says its hardware stands."""
    import importlib

    limits: Limits = importlib.import_module(f"drivers.{protocol.instrument}").INSTRUMENT.limits
    return limits


def _list(as_json: bool) -> None:
    from protocols import library, load

    titles = {name: load(path).title for name, path in library().items()}
    if as_json:
        typer.echo(json.dumps(titles, indent=2))
    else:
        typer.echo("\n".join(f"{name:<30} {title}" for name, title in titles.items()))
