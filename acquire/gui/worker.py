"""The process behind the window: it hosts the session, so that a window that hangs cannot hold pressure on skin.

Four kinds of thread, and none waits for the window:

- the guard reads the safety pipe and does nothing else: the window is alive, or emergency stop, or (closed) gone;
- the main thread takes commands; abort and stop are done at once, slow commands go to
- one thread per instrument, which answers;
- the publisher sends views and answers. If the window does not read, it blocks, and only it does.

Ctrl-C in the terminal reaches this process too, whatever the window is doing: emergency stop.
"""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

from acquire.gui import answers
from acquire.gui.feed import Feed
from acquire.gui.messages import (
    STOP,
    WINDOW,
    BenchSettings,
    Command,
    Fault,
    Finished,
    Measurement,
    Ready,
    Refused,
    Reply,
    Update,
)
from acquire.signals import caught

if TYPE_CHECKING:
    from acquire.engine import RunEngine
    from acquire.recording import RunInfo
    from acquire.station import Station

log = logging.getLogger(__name__)
PERIOD = 1 / 30  # s between two views
TELLING = ("connect", "reset", "run")  # commands that answer with a sentence for the person, '' for nothing
QUESTIONS = ("preview", "threshold")  # commands whose refusal is no fault of the instrument


def main(bench: BenchSettings, commands: Connection, updates: Connection, safety: Connection) -> None:
    """Run until the window closes its end of the pipes. The target of the worker process."""
    try:
        station = answers.station(bench)
    except (ValueError, OSError) as error:
        updates.send(Refused(str(error)))  # and never another bench in its place
        return
    worker = Worker(station, bench, commands, updates, safety)
    with caught(lambda name: worker.stop("emergency stop by Ctrl-C") if name == "SIGINT" else worker.end()):
        worker.run()


class Worker:
    """The session's host. `run` returns when the window is gone or says ``quit``."""

    def __init__(
        self, station: Station, bench: BenchSettings, commands: Connection, updates: Connection, safety: Connection
    ) -> None:
        from acquire.notify import hooks
        from acquire.session import Session

        self._commands, self._updates, self._safety = commands, updates, safety
        self._outbox: queue.SimpleQueue[Update] = queue.SimpleQueue()
        self._over = threading.Event()
        self._feeds: dict[str, Feed] = {}
        self._hands: dict[str, ThreadPoolExecutor] = {}
        self._aborts: dict[str, int] = {}  # how often each instrument was told to stop
        self.session = Session(
            station,
            speed=bench.speed,
            out=bench.out,
            watched=(WINDOW,),
            frame_size=bench.frame_size,
            notify=hooks(bench.notify, station.notify),
        )

    def run(self) -> None:
        """Serve the window."""
        guard = threading.Thread(target=self._guard, name="guard", daemon=True)
        publisher = threading.Thread(target=self._publish, name="publisher", daemon=True)
        guard.start()
        self._outbox.put(Ready(self.session.station.name or "station", answers.instruments(self.session)))
        publisher.start()
        try:
            self._serve()
        finally:
            self.end()
            self.session.close()
            for hand in self._hands.values():
                hand.shutdown(wait=True)
            publisher.join(1.0)  # a window that hangs does not read: its pipe is closed by the process's end

    def stop(self, reason: str) -> None:
        """Emergency stop of every instrument. From any thread, at once."""
        self.session.stop(reason)

    def end(self) -> None:
        """Abort the runs and leave."""
        self._over.set()
        for engine in self.session.engines.values():
            engine.abort("the window was closed")

    # The safety pipe --------------------------------------------------------------------------------------------------

    def _guard(self) -> None:
        try:
            while not self._over.is_set():
                word = self._safety.recv_bytes()
                if word == STOP:
                    self.stop("emergency stop by a person")
                else:
                    self.session.tick(WINDOW)
        except (EOFError, OSError):
            log.info("the window is gone")
        finally:
            self.end()

    # Views and answers ------------------------------------------------------------------------------------------------

    def _publish(self) -> None:
        try:
            while not self._over.wait(PERIOD):
                self._send_replies()
                engines, names = self.session.engines, self.session.station.instruments
                self._updates.send(tuple(self._feed(n).view(engines.get(n), self.session.out) for n in names))
            self._send_replies()
        except (OSError, ValueError):
            self.end()

    def _send_replies(self) -> None:
        with contextlib.suppress(queue.Empty):
            while True:
                self._updates.send(self._outbox.get_nowait())

    def _feed(self, name: str) -> Feed:
        if name not in self._feeds:
            self._feeds[name] = Feed(name)
        return self._feeds[name]

    # Commands ---------------------------------------------------------------------------------------------------------

    def _serve(self) -> None:
        try:
            while not self._over.is_set():
                if self._commands.poll(0.1):
                    self._take(self._commands.recv())
        except (EOFError, OSError):
            return

    def _take(self, command: Command) -> None:
        """Do urgent commands at once; have the rest done in the instrument's own thread."""
        name = command.instrument
        if command.action == "quit":
            self._over.set()
        elif command.action == "abort":
            self._aborts[name] = self._aborts.get(name, 0) + 1
            if name in self.session.engines:
                self.session.engine(name).abort()
        else:
            hand = self._hands.setdefault(name, ThreadPoolExecutor(1, thread_name_prefix=f"hand-{name}"))
            if command.action == "run":
                command = replace(command, arguments={**command.arguments, "aborts": self._aborts.get(name, 0)})
            hand.submit(self._answer, command)

    def _answer(self, command: Command) -> None:
        actions: dict[str, Callable[..., Any]] = {
            "connect": self._connect,
            "disconnect": lambda name: self.session.engine(name).disconnect(),
            "run": self._run,
            "pause": lambda name: self.session.engine(name).pause(),
            "resume": lambda name: self.session.engine(name).resume(),
            "reset": self._reset,
            "threshold": self._use_threshold,
            "protocols": lambda name, **more: answers.protocols(**more),
            "preview": lambda name, **more: answers.preview(self.session, name, **more),
        }
        name = command.instrument
        try:
            value = actions[command.action](name, **command.arguments)
        except Exception as error:
            log.info("%s: %s: %r", name, command.action, error)
            if name and command.action not in QUESTIONS:
                self._feed(name).error = str(error) or repr(error)
            self._outbox.put(Reply(command.number, error=str(error) or repr(error), faults=_faults(error)))
            return
        if name and command.action not in QUESTIONS:
            self._feed(name).error = value if command.action in TELLING else ""
        self._outbox.put(Reply(command.number, value))

    def _connect(self, name: str, *, acknowledged: bool = False) -> str:
        """Open an instrument; the result tells which state of an earlier host was made safe.

        One that cannot be reached latches nothing, as nothing was driven: it may be retried. One that says itself that
        it is in a fault waits for a person's reset, who has then ``acknowledged`` it.
        """
        from acquire.engine import State
        from drivers.device import Faulted

        feed = self._feed(name)
        feed.opening = True
        try:
            return self.session.open(name, acknowledged=acknowledged).found
        except Exception as error:
            engine = self.session.engines.get(name)
            if engine is not None and engine.state is State.FAILED and not isinstance(error, Faulted):
                engine.reset()
            raise
        finally:
            feed.opening = False

    def _reset(self, name: str) -> str:
        """Acknowledge an instrument's trip or failure, a person's, and open its links anew."""
        from acquire.engine import State

        engine = self.session.engine(name)
        if engine.state in (State.TRIPPED, State.FAILED):
            engine.reset()
        return self._connect(name, acknowledged=True)

    def _use_threshold(self, name: str, gvt: float | None) -> None:
        """Read the camera's pictures at another threshold. During a run it is the plan's, and stays."""
        from drivers.aspiration.camera import Camera

        engine = self.session.engines.get(name)
        if engine is None:
            return
        if engine.state.live:
            raise ValueError("the threshold belongs to the run's plan: it can be changed when the run is over")
        for source in engine.rig.sources:
            if isinstance(source, Camera) and source.measure is not None:
                source.measure.use(gvt)

    def _run(self, name: str, protocol: str, aborts: int, **request: Any) -> str:
        """Arm and start; a warning where the instrument's last qualification does not hold. The run's end is told by
        `Finished`.

        ``aborts`` is how often the instrument had been told to stop when START was pressed: a stop that came before
        there was anything to stop holds as well.
        """
        from acquire.qualifications import due, serial_of
        from acquire.session import Request

        engine, plan = self.session.prepare(protocol, Request(**request), name=name)
        feed = self._feed(name)
        engine.arm(plan)
        feed.begin(plan.setpoints)
        threading.Thread(target=self._await, args=(name, engine, plan.info), name=f"await-{name}", daemon=True).start()
        if self._aborts.get(name, 0) != aborts:
            engine.abort()
            return ""
        engine.start()
        return due(plan.info.instrument, serial_of(plan.info))

    def _await(self, name: str, engine: RunEngine, info: RunInfo) -> None:
        outcome = engine.wait()
        if outcome.reason:
            self._feed(name).error = outcome.reason
        what = Measurement(info.subject, info.site, info.protocol_name)
        status, reason = str(outcome.status), outcome.reason
        left = (outcome.recording, outcome.journal, outcome.lost)
        self._outbox.put(Finished(name, what, info.repeat, status, reason, *left))


def _faults(error: Exception) -> tuple[Fault, ...]:
    problems = getattr(error, "problems", ())
    return tuple(Fault(p.message, p.field, p.line) for p in problems)
