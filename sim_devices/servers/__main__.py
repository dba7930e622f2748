"""A simulated instrument in a process of its own: ``python -m sim_devices.servers cutometer --link tcp --speed 20``.

The first line on standard output says where it is (JSON); then each line of standard input is a call of the back door,
``{"call": "unplug", "args": {}}``, answered by a line with its ``result`` or ``error``. It ends with standard input.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from typing import Any

from drivers.signals import REFERENCE
from sim_devices.servers import LINKS, Server, Truth, serve
from sim_devices.servers.bench import BENCHES
from sim_devices.servers.usb import VirtualUsb


def main(arguments: list[str] | None = None) -> int:
    """Serve until standard input ends; exit status."""
    parser = argparse.ArgumentParser(prog="python -m sim_devices.servers", description="Serve a simulated instrument.")
    parser.add_argument("instrument", choices=list(BENCHES))
    parser.add_argument("--link", choices=LINKS, default="")
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--port", type=int, default=0, help="TCP port (0: any free one)")
    parser.add_argument("--frame-size", type=int, nargs=2, default=(640, 480), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--watchdog", type=float, default=None, help="s of wall time")
    parser.add_argument("--reference", type=int, choices=(0, 1), default=0, help="whether it has a second gauge")
    given = parser.parse_args(arguments)
    try:
        server = serve(
            given.instrument,
            given.link,
            speed=given.speed,
            seed=given.seed,
            port=given.port,
            frame_size=tuple(given.frame_size),
            watchdog=given.watchdog,
            options={f"pressure{REFERENCE}": True} if given.reference else None,
        )
    except (ValueError, OSError) as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    with server:
        _say(_whereabouts(server))
        for line in sys.stdin:
            _say(_answer(server, line))
    return 0


def _whereabouts(server: Server) -> dict[str, Any]:
    """The entry without its backend, and the ports that stand for USB cables."""
    entry = {f.name: getattr(server.entry, f.name) for f in dataclasses.fields(server.entry) if f.name != "usb_backend"}
    backend = server.entry.usb_backend
    cables = [dataclasses.astuple(d) for d in backend.devices] if isinstance(backend, VirtualUsb) else []
    return {"entry": entry, "usb": cables}


def _answer(server: Server, line: str) -> dict[str, Any]:
    try:
        request = json.loads(line)
        name = request["call"]
        if name.startswith("_"):
            raise AttributeError(name)
        result = getattr(server.back_door, name)(**request.get("args", {}))
    except Exception as error:  # whatever it is, the other process is told
        return {"error": str(error), "kind": type(error).__name__}
    return {"result": dataclasses.asdict(result) if isinstance(result, Truth) else result}


def _say(answer: dict[str, Any]) -> None:
    print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    sys.exit(main())
