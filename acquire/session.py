"""A session: the instruments of a station, real or simulated, with their engines, in this process.

The command line and tests host one; so does the worker process behind the window.

>>> with Session(simulated_station(), speed=50) as session:            # doctest: +SKIP
...     outcome = session.run("demo-cutometer", subject="P07", site="forearm")
...     print(outcome.status, outcome.recording)
"""

from __future__ import annotations

import secrets
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from acquire import pseudonym
from acquire.attendant import Attendant
from acquire.bench import Bench
from acquire.engine import (
    Aborted,
    Outcome,
    Progress,
    Rest,
    RunEngine,
    RunPlan,
    State,
    WrongState,
    bring_to_rest,
)
from acquire.notify import Hook
from acquire.plugins import instrument as descriptor
from acquire.provenance import calibration, settled, versions
from acquire.qualifications import SERIAL
from acquire.recording import RunInfo
from acquire.recording.journal import iso_now
from acquire.sight import see, with_region
from acquire.simulation import Mounted
from acquire.station import Instrument, Station, simulated_station
from acquire.status import forget_the_dead
from acquire.supervisor import Supervisor
from drivers.device import Identity, Status
from drivers.signals import REFERENCE
from protocols import Limits, Protocol, Setpoints, compile_protocol, dump, effective_limits, find, load
from protocols import specimens as references

if TYPE_CHECKING:
    from drivers.device import Rig
    from protocols.specimens import Stated
    from sim_devices.servers import BackDoor

MAX_SPEED = 1e5


@dataclass(frozen=True)
class Request:
    """Subject and measurement of a run. ``repeat`` counts repeats of the same measurement, from 1.

    ``gvt`` is the grey-value threshold at which a camera's contours are read; None for the station's or a proposed one.
    ``specimen_properties`` are the numbers known of a reference specimen, as `protocols.specimens.stated` reads them.
    Raises ValueError for a ``subject`` that is no pseudonym (see `acquire.pseudonym`).
    """

    subject: str = ""
    site: str = ""
    operator: str = ""
    repeat: int = 1
    specimen: str = "skin"
    notes: str = ""
    consent: str = ""  # a reference to the subject's consent, never a name
    gvt: float | None = None
    specimen_properties: Mapping[str, Stated] = field(default_factory=dict)
    experiment: str = ""  # id of the experiment that it answers

    def __post_init__(self) -> None:
        pseudonym.check(self.subject)


class Session:
    """Opens a station's instruments and runs protocols on them, several at once if asked to.

    ``speed`` scales the time of simulated instruments, ``out`` is the folder for recordings. ``watched`` are further
    names that must keep calling `tick` or the instruments make themselves safe (a window, for example). ``notify`` are
    the hooks called when a run ends, trips or stalls; those of the station are used where they are among them only.
    """

    def __init__(
        self,
        station: Station | None = None,
        *,
        speed: float = 1.0,
        out: Path | str = "runs",
        watched: Iterable[str] = (),
        frame_size: tuple[int, int] = (640, 480),
        listener: Callable[[str, State, str], None] | None = None,
        notify: Sequence[Hook] = (),
    ) -> None:
        if not 0 < speed <= MAX_SPEED:
            raise ValueError(f"the speed must be positive and at most {MAX_SPEED:g}, not {speed:g}")
        self.station = settled(station or simulated_station())
        self.out = Path(out)
        self._speed = speed
        self._watched = tuple(watched)
        self._frame_size = frame_size
        self._listener = listener
        self._benches: dict[str, Bench] = {}
        self._mounted: Counter[str] = Counter()
        self._aborted = ""
        self._notify = tuple(notify)
        self._attendant: Attendant | None = None
        self._lock = threading.Lock()

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    # Instruments ------------------------------------------------------------------------------------------------------

    def kind(self, name: str) -> str:
        """The kind of the station's instrument ``name``. Raises ValueError."""
        return self._entry(name).instrument or name

    def open(self, name: str, mounted: Mounted = Mounted(), *, acknowledged: bool = False) -> RunEngine:
        """The engine of an instrument, connected; a simulated one is switched on, with the ``mounted`` specimen.

        ``acknowledged``: a person has looked at whatever fault the instrument latched. Raises ValueError (station,
        plugin), DeviceError, Aborted.
        """
        bench = self._bench(name, mounted)
        if bench.engine.state is State.IDLE:
            self._go_on()
            bench.connect(acknowledged=acknowledged)
        return bench.engine

    def look(self, name: str) -> tuple[dict[str, Identity], Status | None]:
        """The identity on each link of an instrument and its device's description; changes nothing.

        Raises ValueError (station, plugin), DeviceError.
        """
        engine = self._bench(name).engine
        if engine.state is not State.IDLE:
            return engine.identities, engine.status
        sources = (engine.rig.device, *engine.rig.sources)
        try:
            return {source.name: source.connect() for source in sources}, engine.rig.device.status
        finally:
            for source in sources:
                source.close()

    def make_safe(self, name: str) -> Rest:
        """Connect to an instrument, acknowledge whatever fault it latched, make it safe and see that it is.

        For a person who has looked. Raises ValueError (station, plugin), DeviceError, WrongState (a run is on).
        """
        engine = self._bench(name).engine
        if engine.state in (State.TRIPPED, State.FAILED):
            engine.reset()
        return bring_to_rest(self.open(name, acknowledged=True))

    def engine(self, name: str) -> RunEngine:
        """The engine of an open instrument. Raises KeyError."""
        return self._benches[name].engine

    @property
    def engines(self) -> dict[str, RunEngine]:
        """The engines of all open instruments."""
        return {name: bench.engine for name, bench in list(self._benches.items())}  # another thread may open one

    def back_door(self, name: str) -> BackDoor:
        """The true state of an open simulated instrument, for tests. Raises ValueError for a real one."""
        server = self._benches[name].server
        if server is None:
            raise ValueError(f"{name} is not simulated here")
        return server.back_door

    def supervisor(self, name: str) -> Supervisor:
        """The heartbeat's keeper of an open instrument."""
        return self._benches[name].supervisor

    # Runs -------------------------------------------------------------------------------------------------------------

    def limits(self, name: str, subject: str = "") -> Limits:
        """Hardware, station and subject limits of an instrument, intersected. Raises ValueError if nothing is left."""
        entry = self._entry(name)
        hardware: Limits = descriptor(self.kind(name)).limits
        return hardware.intersect(entry.station_limits).intersect(self.station.subject_limits(subject))

    def compile(self, name: str, protocol: Protocol, subject: str = "") -> tuple[Setpoints, Limits]:
        """Set-points of a protocol within all limits, and those limits.

        Raises ProtocolError with the lines; ValueError when the limits exclude each other or the instrument is another.
        """
        if protocol.instrument != self.kind(name):
            raise ValueError(f"protocol {protocol.name} is for a {protocol.instrument}; {name} is a {self.kind(name)}")
        limits = self.limits(name, subject)
        return compile_protocol(protocol, limits), effective_limits(protocol, limits)

    def plan(self, name: str, protocol: Protocol, request: Request | None = None, out: Path | None = None) -> RunPlan:
        """Everything the engine needs for a run. ``out`` is a folder, or a file name that ends in ``.h5``."""
        request = request or Request()
        references.check_complete(request.specimen, protocol.instrument, request.specimen_properties)
        setpoints, limits = self.compile(name, protocol, request.subject)
        entry = self._entry(name)
        start = iso_now()
        identity = f"{time.strftime('%Y%m%d-%H%M%S')}-{protocol.name}-{secrets.token_hex(2)}"
        folder = out or self.out
        if folder.suffix != ".h5" and folder.exists() and not folder.is_dir():
            raise ValueError(f"{folder} is a file: name a folder for recordings, or a new file that ends in .h5")
        path = folder if folder.suffix == ".h5" else folder / f"{identity}.h5"
        info = RunInfo(
            id=identity,
            instrument=protocol.instrument,
            device=name,
            start_time=start,
            protocol=protocol.origin.text or dump(protocol),
            protocol_name=protocol.name,
            subject=request.subject,
            site=request.site,
            operator=request.operator,
            repeat=request.repeat,
            specimen=request.specimen,
            specimen_properties=request.specimen_properties,
            notes=request.notes,
            consent=request.consent,
            experiment=request.experiment,
            versions=versions(),
            station=self.station.text(),
            limits=limits.values(),
            calibration=calibration(entry, protocol),
        )
        return RunPlan(setpoints, limits, info, path, frame_scale=entry.calibrated("frame_scale"))

    def prepare(
        self,
        protocol: Protocol | str | Path,
        request: Request | None = None,
        *,
        name: str = "",
        out: Path | None = None,
    ) -> tuple[RunEngine, RunPlan]:
        """The connected engine and the plan for a protocol (a file, or a name of the library); not armed yet.

        ``name`` is the station's instrument; the first of the protocol's kind by default.
        """
        if not isinstance(protocol, Protocol):
            protocol = load(find(protocol))
        name = name or self.station.find(protocol.instrument)
        request = request or Request()
        plan = self.plan(name, protocol, request, out)
        known = tuple(request.specimen_properties.items())
        engine = self.open(name, Mounted(protocol.setup.opening, request.specimen, known))
        if request.specimen == references.MANOMETER and not _compares(engine.rig):
            raise ValueError(f"specimen: {name} has no second gauge; with one its options are pressure_reference: true")
        plan = see(plan, engine.rig, request.gvt)
        whole = (protocol.setup.frames or self._entry(name).frames) == "full"
        plan = _with_serial(plan, engine)
        return engine, plan if whole else with_region(plan, engine.rig)

    def run(
        self,
        protocol: Protocol | str | Path,
        request: Request | None = None,
        *,
        name: str = "",
        out: Path | None = None,
        watch: Callable[[Progress], None] | None = None,
    ) -> Outcome:
        """Run a protocol to its end. ``watch`` is called with the progress ten times per second.

        An exception, KeyboardInterrupt included, aborts the run before it goes on.
        """
        return self.carry_out(*self.prepare(protocol, request, name=name, out=out), watch)

    def carry_out(self, engine: RunEngine, plan: RunPlan, watch: Callable[[Progress], None] | None = None) -> Outcome:
        """Arm, start and wait for the end of a prepared run; see `run`.

        Raises Aborted or Tripped where the end came before there was a run; afterwards it is told by the outcome.
        """
        try:
            self._go_on()
            engine.arm(plan)
            self._go_on()
            engine.start()
            return _wait(engine, watch)
        except WrongState as error:
            if engine.plan is not plan:
                raise
            engine.abort(str(error))  # the run has begun: it ends with an outcome (where it has ended, this is void)
            return _wait(engine, watch)
        except BaseException as error:
            engine.abort("aborted by a person" if isinstance(error, KeyboardInterrupt) else f"{error!r}")
            raise
        finally:
            self._aborted = ""

    def abort(self, reason: str = "aborted by a person") -> None:
        """End the run of every instrument, at whatever point: opening, arming, running. Returns at once."""
        self._aborted = reason
        for engine in self.engines.values():
            engine.abort(reason)

    def stop(self, reason: str = "emergency stop") -> None:
        """Emergency stop of every open instrument; latches until each engine is reset."""
        for engine in self.engines.values():
            engine.stop(reason)

    def tick(self, name: str) -> None:
        """``name``, one of the watched, is alive."""
        for bench in list(self._benches.values()):
            bench.supervisor.tick(name)

    def close(self) -> None:
        """Abort the runs, make everything safe, switch simulated instruments off. Idempotent."""
        with ExitStack() as everything:  # whatever fails, the others are closed all the same
            for name in list(self._benches):
                everything.callback(self._close, name)
            if self._attendant is not None:
                everything.callback(self._attendant.close)
                self._attendant = None
            for engine in self.engines.values():
                everything.callback(engine.close)
            for engine in self.engines.values():
                engine.abort("the session ended")

    # Inside -----------------------------------------------------------------------------------------------------------

    def _go_on(self) -> None:
        """Raises Aborted if `abort` came since the last run: where no engine was live it had nothing to end."""
        if self._aborted:
            reason, self._aborted = self._aborted, ""
            raise Aborted(reason)

    def _entry(self, name: str) -> Instrument:
        if name not in self.station.instruments:
            raise ValueError(f"no instrument {name!r} in the station; it has {', '.join(self.station.instruments)}")
        return self.station.instruments[name]

    def _bench(self, name: str, set_up: Mounted | None = None) -> Bench:
        """The open instrument ``name``; a simulated one is made anew where it is set up otherwise than asked."""
        entry, kind = self._entry(name), self.kind(name)
        if name in self._benches and entry.here and set_up not in (None, self._benches[name].set_up):
            self._close(name)  # another probe, another specimen
        if name not in self._benches:
            self._benches[name] = Bench(
                name,
                kind,
                entry,
                replace(set_up or Mounted(), times=self._mounted[name]),
                speed=self._speed,
                frame_size=self._frame_size,
                watched=self._watched,
                listener=self._listener,
            )
            self._mounted[name] += 1
            self._attend()
        return self._benches[name]

    def _close(self, name: str) -> None:
        self._benches.pop(name).close()

    def _attend(self) -> None:
        with self._lock:  # instruments may be opened at once, each by a thread of its own
            if self._attendant is None:
                addresses = {name: entry.address for name, entry in self.station.instruments.items()}
                forget_the_dead(addresses)
                self._attendant = Attendant(self.station.name, lambda: self.engines, addresses, self._notify)
                self._attendant.start()


def _with_serial(plan: RunPlan, engine: RunEngine) -> RunPlan:
    """The plan of a run that tells which instrument answered."""
    identity = engine.identities.get(engine.rig.device.name)
    if identity is None or not identity.serial:
        return plan
    told = {"value": identity.serial, "unit": "", "provenance": "documented", "note": "said by the instrument"}
    return replace(plan, info=replace(plan.info, calibration={**plan.info.calibration, SERIAL: told}))


def _compares(rig: Rig) -> bool:
    return any(channel.name == f"pressure{REFERENCE}" for channel in rig.device.channels)


def _wait(engine: RunEngine, watch: Callable[[Progress], None] | None) -> Outcome:
    while True:
        try:
            return engine.wait(0.1)
        except TimeoutError:
            if watch is not None:
                watch(engine.progress)
