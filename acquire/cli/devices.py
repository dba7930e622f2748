"""``acquire devices``: which instruments a station has, whether their drivers load, and who answers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer


def devices(
    station: Annotated[Path | None, typer.Option(help="Station file; without one: drivers and ports.")] = None,
    connect: Annotated[
        bool, typer.Option("--connect", help="Open each link and ask who is there, and how it is.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """List instruments: a station's, or the drivers and ports of this computer."""
    result = _drivers() if station is None else {"station": _station(station, connect)}
    if as_json:
        typer.echo(json.dumps(result, indent=2))
        return
    for group, rows in result.items():
        typer.echo(f"{group}:" if rows else f"{group}: none")
        for row in rows:
            typer.echo("  " + "  ".join(str(value) for value in row.values() if value not in ("", None)))


def _drivers() -> dict[str, list[dict[str, Any]]]:
    """Drivers, other plugins and serial ports of this computer."""
    from serial.tools import list_ports

    from acquire.plugins import GROUPS, plugins

    found: dict[str, list[dict[str, Any]]] = {}
    for group in GROUPS:
        found[group] = [
            {
                "name": name,
                "title": getattr(plugin.object, "title", ""),
                "links": ", ".join(getattr(plugin.object, "transports", ())),
                "error": plugin.error and f"BROKEN: {plugin.error}",
            }
            for name, plugin in plugins(group).items()
        ]
    found["serial ports"] = [{"port": port.device, "what": port.description} for port in list_ports.comports()]
    return found


def _station(path: Path, connect: bool) -> list[dict[str, Any]]:
    """Every instrument of a station, with who answers or why nobody does."""
    from acquire.session import Session
    from acquire.station import load_station
    from drivers.device import DeviceError

    rows = []
    with Session(load_station(path)) as session:
        for name, entry in session.station.instruments.items():
            row = {"name": name, "kind": session.kind(name), "address": entry.address or "simulated", "answer": ""}
            rows.append(row)
            try:
                row["limits"] = ", ".join(
                    f"{q} {low:g} … {high:g}" for q, (low, high) in session.limits(name).values().items()
                )
                if connect:
                    who, status = session.look(name)
                    row["answer"] = "; ".join(
                        f"{k}: {w.model} {w.serial} (firmware {w.firmware})" for k, w in who.items()
                    )
                    row["state"] = status.words if status is not None else ""
            except (DeviceError, ValueError) as error:
                row["answer"] = f"ERROR: {error}"
    return rows
