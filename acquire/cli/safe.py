"""``acquire safe``: make instruments safe, whatever an earlier run left behind, and read back that they are."""

from __future__ import annotations

import json
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from acquire.cli.app import DEVICE

if TYPE_CHECKING:
    from acquire.session import Session


def safe(
    station: Annotated[Path | None, typer.Option(help="Station file.")] = None,
    sim: Annotated[bool, typer.Option("--sim", help="On simulated instruments.")] = False,
    instrument: Annotated[str, typer.Option(help="Only this one of the station's instruments.")] = "",
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Vent, stop motion and acknowledge latched faults; status 3 if one instrument cannot be seen to be safe.

    Look at the person and at the instrument first: this command tells the software that somebody has.
    """
    from acquire.cli.run import bench_of
    from acquire.session import Session

    with Session(bench_of(station, sim, "", (), None)) as session:
        names = [instrument] if instrument else list(session.station.instruments)
        for name in names:
            session.kind(name)  # a name that the station does not have is told before anything is touched
        with ThreadPoolExecutor(len(names)) as hands:  # one that does not answer must not keep the others waiting
            rows = list(hands.map(lambda name: _row(session, name), names))
    if as_json:
        typer.echo(json.dumps({"instruments": rows}, indent=2))
    for row in () if as_json else rows:
        typer.echo(f"{row['name']}: {row['state']}")
    unsafe = [row["name"] for row in rows if not row["safe"]]
    if unsafe:
        print(f"acquire: NOT SEEN TO BE SAFE: {', '.join(unsafe)}: vent by hand or pull the plug", file=sys.stderr)
        raise typer.Exit(DEVICE)


def _row(session: Session, name: str) -> dict[str, Any]:
    """The state of one instrument after it was made safe."""
    from acquire.engine import WrongState
    from drivers.device import DeviceError

    try:
        rest = session.make_safe(name)
    except (DeviceError, WrongState, ValueError) as error:
        return {"name": name, "safe": False, "state": f"ERROR: {error}", "found": "", "readings": {}}
    found = f" ({rest.found})" if rest.found else ""
    return {
        "name": name,
        "safe": rest.reached,
        "state": rest.words + found,
        "found": rest.found,
        "readings": dict(rest.readings),
    }
