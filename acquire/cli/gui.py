"""``acquire gui``: the operator's window."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from acquire.cli.numbers import Speed


def gui(
    station: Annotated[
        Path | None, typer.Option(help="Station file; none: the last one, or the simulated bench.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for recordings.")] = Path("runs"),
    speed: Speed = 1.0,
    tissue: Annotated[str, typer.Option(help="Simulated tissue, such as forearm.")] = "forearm",
    notify: Annotated[
        list[str] | None,
        typer.Option(help="On end, trip and stall: a command line, a URL, or 'station' for its own; may be repeated."),
    ] = None,
    dark: Annotated[bool | None, typer.Option("--dark/--light", help="Colours; remembered.")] = None,
) -> None:
    """Open the window. Ctrl-C in this terminal is an emergency stop; at rest it closes the window."""
    try:
        from acquire.gui.app import run
    except ImportError as error:
        raise ValueError(f"the window needs the extra 'gui' (pip install 'skinrig[gui]'): {error}") from error
    from acquire.gui.messages import BenchSettings
    from acquire.notify import hooks
    from acquire.station import load_station

    # A fault in a given file is told here, with its line: no other bench is opened in its place.
    hooks(notify or (), load_station(station).notify if station is not None else ())
    bench = BenchSettings(station=station, out=out, speed=speed, tissue=tissue, notify=tuple(notify or ()))
    raise typer.Exit(run(bench, dark=dark))
