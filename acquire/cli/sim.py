"""``acquire sim``: one simulated instrument as a server of its own, for any program that speaks to instruments."""

from __future__ import annotations

import json
import secrets
import threading
from typing import Annotated

import typer

from acquire.cli.numbers import Speed, whole
from acquire.signals import caught


def sim(
    name: Annotated[str, typer.Argument(help="cutometer, aspiration or microrobot.")],
    link: Annotated[str, typer.Option(help="tcp or pty (a virtual USB device lives in its own process only).")] = "tcp",
    port: Annotated[int, typer.Option(parser=whole(0, 65535), help="TCP port; 0 takes a free one.")] = 0,
    speed: Speed = 1.0,
    tissue: Annotated[str, typer.Option(help="Simulated tissue, such as forearm.")] = "forearm",
    effect: Annotated[
        list[str] | None, typer.Option(help="Simulated non-ideality, such as regulator_lag:tau=0.3s; may be repeated.")
    ] = None,
    seed: Annotated[int, typer.Option(parser=whole(), help="Seed of noise and scatter.")] = 0,
    token: Annotated[
        bool, typer.Option("--token", help="Let in only who knows the word in the printed address.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the addresses as JSON.")] = False,
) -> None:
    """Serve a simulated instrument until Ctrl-C; prints the station file that reaches it."""
    import yaml

    from acquire.simulation import chain
    from acquire.station import Simulation
    from sim_devices.servers import serve

    if link not in ("tcp", "pty"):
        raise ValueError(f"a simulated instrument is served on tcp or pty, not on {link!r}")
    simulation = Simulation(tissue=tissue, effects=tuple(effect or ()), seed=seed)
    over = threading.Event()
    word = secrets.token_urlsafe(16) if token else ""
    with (
        caught(lambda _: over.set()),
        serve(name, link, chain=chain(name, simulation), speed=speed, seed=seed, port=port, token=word) as server,
    ):
        entry = {"address": server.entry.address, "simulated": True}
        if server.entry.sources:
            entry["sources"] = dict(server.entry.sources)
        station = {"schema": "station/1", "name": f"simulated {name}", "instruments": {name: entry}}
        typer.echo(json.dumps(station, indent=2) if as_json else yaml.safe_dump(station, sort_keys=False), nl=as_json)
        while not over.wait(0.5):
            server.back_door.truth()  # raises if the simulation itself has failed
