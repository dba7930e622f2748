"""``acquire fit --list``: the models of a solver, and the parameters of one."""

from __future__ import annotations

import json
import sys
from typing import Any

import typer

from acquire.words import multiple


def list_models(solver: Any, model: str, as_json: bool) -> None:
    """Print the models of a solver, or one with its parameters. Raises ValueError for a model that it has not."""
    models = solver.models()
    if model and model not in models:
        raise ValueError(f"no model {model!r}; there are {', '.join(models)}")
    chosen = {}
    for name in [model] if model else models:
        try:
            chosen[name] = models[name].info
        except ValueError as error:  # one that somebody brought: the others are listed all the same
            if model:
                raise
            print(f"acquire fit: {error}", file=sys.stderr)
    if as_json:
        rows = [
            {
                "name": info.name, "problem": info.problem, "description": info.description, "source": info.source,
                "channels": list(info.channels), "parameters": [p.__dict__ for p in info.parameters],
            }
            for info in chosen.values()
        ]  # fmt: skip
        typer.echo(json.dumps(rows, indent=1))
        return
    for info in chosen.values():
        typer.echo(f"{info.name}: {info.description}")
        if model:
            for line in _table([_row(p) for p in info.parameters]):
                typer.echo(line)


def _row(parameter: Any) -> tuple[str, ...]:
    """Symbol, default, bounds of a fit and meaning; the least of all where a fit stops above it."""
    unit = parameter.unit
    stops = getattr(parameter, "fit_lower", None)
    lowest = f"; down to {multiple(parameter.lower, unit)} if asked" if stops is not None else ""
    lower = multiple(parameter.lower if stops is None else stops, unit)
    bounds = f"{lower} … {multiple(parameter.upper, unit)}"
    return parameter.symbol, multiple(parameter.default, unit), bounds, f"{parameter.meaning}{lowest}"


def _table(rows: list[tuple[str, ...]]) -> list[str]:
    """Rows in columns: the second to the right, the last as it is."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]) - 1)]
    return [
        f"  {symbol:<{widths[0]}}  {default:>{widths[1]}}  {bounds:<{widths[2]}}  {meaning}".rstrip()
        for symbol, default, bounds, meaning in rows
    ]
