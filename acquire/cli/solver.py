"""The solver plugin that ``acquire fit`` and ``acquire fit plan`` use."""

from __future__ import annotations

import sys
from typing import Any

import typer

from acquire import plugins
from acquire.cli.app import BAD_INPUT


def solver_for(model: str) -> Any:
    """The installed solver, by preference one that has ``model``; ends with status 2 where it is missing."""
    for plugin in plugins.plugins("acquire.solvers").values():
        if not plugin.working:
            print(
                f"acquire fit: the solver {plugin.name} ({plugin.value}) does not load: {plugin.error}", file=sys.stderr
            )
    try:
        return plugins.solver(model)
    except ValueError as error:
        print(f"acquire fit is not installed: {error}", file=sys.stderr)
        raise typer.Exit(BAD_INPUT) from None
