"""A simulated instrument in a process of its own, a host on it, and how long this computer stood still meanwhile."""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from acquire.engine import Outcome, RunEngine, State
from acquire.session import Session
from acquire.station import load_station
from protocols import load
from sim_devices.servers.backdoor import Truth
from sim_devices.servers.remote import RemoteServer

WATCHDOG, STALE = 0.25, 0.5  # s of wall time, the defaults of a bench with people on it
AFTER_WATCHDOG, BY_HOST = 0.25, 1.0  # s: how soon a safe command must act
KINDS = ("cutometer", "aspiration", "microrobot")
PROTOCOLS = {
    "cutometer": "- {type: hold, suction: 200 mbar, duration: 1 s, repeat: 20}",
    "aspiration": "- {type: hold, suction: 100 mbar, duration: 1 s, repeat: 20}",
    "microrobot": "- {type: hold, position: {x: 1 mm}, speed: 10 mm/s, duration: 1 s, repeat: 20}",
}


def hold(kind: str) -> str:
    """A long hold: the instrument acts on the skin within a second and goes on."""
    return protocol(kind, PROTOCOLS[kind])


def protocol(kind: str, steps: str) -> str:
    """A protocol of these steps."""
    return f"schema: protocol/1\nname: hold\ninstrument: {kind}\nsteps:\n{steps}\n"


def acts(truth: Truth) -> bool:
    """Whether the instrument acts on the skin."""
    signals = truth.signals
    return signals.get("line_pressure", 0.0) < -8e3 or abs(signals.get("tip_x", 0.0)) > 0.4e-3


class Stillness:
    """Measures for how long this computer kept a thread waiting that wanted to run: the host's own unpunctuality."""

    TICK = 0.005

    def __init__(self) -> None:
        self._worst = 0.0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        before = time.monotonic()
        while not self._stop.wait(self.TICK):
            now = time.monotonic()
            self._worst = max(self._worst, now - before - self.TICK)
            before = now

    def close(self) -> float:
        """The longest wait in s."""
        self._stop.set()
        self._thread.join()
        return self._worst


class Rig:
    """One instrument's simulator in its own process and a session on it, over TCP. Use as a context manager.

    ``between`` puts something between the two (a proxy): given the addresses by link, it returns others. ``reference``
    is a second gauge; ``speed`` scales the instrument's time.
    """

    def __init__(
        self,
        kind: str,
        *,
        seed: int = 1,
        between: Callable[[Mapping[str, str]], Mapping[str, str]] | None = None,
        watchdog: float = WATCHDOG,
        reference: bool = False,
        speed: float = 1.0,
    ) -> None:
        self.kind = kind
        self.folder = tempfile.TemporaryDirectory(prefix="faults-")
        self.server = RemoteServer(
            kind, link="tcp", seed=seed, frame_size=(160, 120), reference=int(reference), speed=speed
        )
        addresses = {"address": self.server.entry.address, **dict(self.server.entry.sources)}
        self.addresses = dict(between(addresses) if between else addresses)
        self.station = Path(self.folder.name) / "station.yaml"
        self.station.write_text(station(kind, self.addresses, watchdog, reference))
        self.session = Session(load_station(self.station), out=Path(self.folder.name))
        self._count = 0

    def __enter__(self) -> Rig:
        return self

    def __exit__(self, *exc: object) -> None:
        self.session.close()
        self.server.close()
        self.folder.cleanup()

    def call(self, method: str, **args: Any) -> Any:
        """A method of the instrument's back door."""
        return self.server.back_door.call(method, **args)

    def truth(self) -> Truth:
        return self.server.back_door.truth()

    def stopped(self, timeout: float = 5.0) -> tuple[float, str]:
        """When the device ceased to act (monotonic s), and what is wrong if it did not, or was not vented then."""
        try:
            moment = float(self.call("wait_stopped", timeout=timeout))
            self.call("wait_vented", timeout=3.0)
        except TimeoutError as error:
            return time.monotonic(), str(error)
        return moment, ""

    def begin(self, steps: str = "", before: Callable[[], object] = lambda: None) -> RunEngine:
        """An engine in a run of ``steps`` (a long hold), its instrument acting; ``before`` is done when it is armed.

        Raises TimeoutError where that does not come about.
        """
        text = protocol(self.kind, steps) if steps else hold(self.kind)
        for _ in range(3):
            self._count += 1
            engine, plan = self.session.prepare(load(text), out=Path(self.folder.name) / f"{self._count}.h5")
            engine.arm(plan)
            before()
            engine.start()
            deadline = time.monotonic() + 10
            while engine.state is State.RUNNING and time.monotonic() < deadline:
                if acts(self.truth()):
                    return engine
                time.sleep(0.02)
            # A computer that is too busy to beat is vented by the watchdog, and rightly: begin once more.
            engine.abort("the instrument does not act")
            self.over(engine)
        raise TimeoutError(f"{self.kind} did not act in three runs: is this computer too busy?")

    def ended(self, engine: RunEngine) -> Outcome:
        """The end of a run; one that goes on although nothing acts any more is ended."""
        try:
            return engine.wait(5)
        except TimeoutError:
            engine.abort("the run went on")
            return engine.wait(20)

    def over(self, engine: RunEngine) -> Outcome:
        """The end of a run; the instrument is then ready for the next one."""
        outcome = self.ended(engine)
        self.call("heal")
        self.call("plug")
        if engine.state is State.TRIPPED:
            engine.reset()
        return outcome


def station(kind: str, addresses: Mapping[str, str], watchdog: float = WATCHDOG, reference: bool = False) -> str:
    """A station file for an instrument that is simulated in another process."""
    sources = ", ".join(f"{name}: '{where}'" for name, where in addresses.items() if name != "address")
    lines = [
        "schema: station/1",
        f"instruments:\n  {kind}:",
        f"    address: '{addresses['address']}'",
        "    simulated: true",
        f"    watchdog: {watchdog} s",
        f"    interlock: {{stale: {STALE} s}}",
    ]
    lines += [f"    sources: {{{sources}}}"] if sources else []
    lines += ["    options: {pressure_reference: true}"] if reference else []
    return "\n".join(lines) + "\n"
