"""``acquire check``: compile a protocol and describe it, or tell where it is wrong."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from protocols import Limits

BAD_INPUT = 2


def check(
    protocol: Annotated[str, typer.Argument(help="A YAML file or a name of the library; none: list the library.")] = "",
    station: Annotated[Path | None, typer.Option(help="Check against this station's limits too.")] = None,
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
        _check(protocol, station, png, as_json)
    except ProtocolError as error:
        if as_json:
            problems = [
                {"line": p.line, "column": p.column, "field": p.field, "message": p.message} for p in error.problems
            ]
            typer.echo(json.dumps({"ok": False, "file": error.file, "problems": problems}, indent=2))
        else:
            typer.echo(str(error), err=True)
        raise typer.Exit(BAD_INPUT) from None


def _check(name: str, station: Path | None, png: Path | None, as_json: bool) -> None:
    from acquire.files import write_figure
    from protocols import compile_protocol, effective_limits, find, load
    from protocols.summary import draw, in_words, summarise

    path = find(name)
    protocol = load(path)
    given = limits_of(protocol.instrument, station)
    setpoints = compile_protocol(protocol, given)
    limits = effective_limits(protocol, given)
    summary = summarise(protocol, setpoints, limits)
    if png is not None:
        write_figure(draw(protocol, setpoints, limits), png, dpi=120)
    if as_json:
        typer.echo(json.dumps({"ok": True, "file": str(path), "limits_of": limits.origin, **summary}, indent=2))
    else:
        typer.echo(in_words(summary))


def limits_of(kind: str, station: Path | None) -> Limits:
    """Limits of an instrument's hardware and, if there is a station, of its first of the kind."""
    from acquire.plugins import instrument
    from acquire.station import load_station

    limits: Limits = instrument(kind).limits
    if station is None:
        return limits
    bench = load_station(station)
    return limits.intersect(bench.instruments[bench.find(kind)].station_limits)


def _list(as_json: bool) -> None:
    from protocols import library, load

    titles = {name: load(path).title for name, path in library().items()}
    if as_json:
        typer.echo(json.dumps(titles, indent=2))
    else:
        typer.echo("\n".join(f"{name:<30} {title}" for name, title in titles.items()))
