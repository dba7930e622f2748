"""A fit while a run goes on, in a process of its own: the window sends samples and shows what comes back.

The process is trained for a protocol beforehand, runs at low priority and knows neither engine nor recording. The
window never waits for it: a thread sends, the timer takes answers, and samples go out only once the last are answered.
"""

from __future__ import annotations

import multiprocessing
import os
import queue
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from typing import Any

from PySide6.QtCore import QObject, Signal

from drivers.signals import FloatArray

PERIOD = 1.0  # s between two fits
NICE = 10  # added to the process's niceness: an engine goes first
Streams = Mapping[str, tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class Train:
    """Train for a protocol: set-points (SI) at break points ``time`` (s), and its text."""

    model: str
    instrument: str
    time: FloatArray
    values: Mapping[str, FloatArray]
    protocol: str


@dataclass(frozen=True)
class Begin:
    """A run of that protocol begins: what came before is forgotten."""


@dataclass(frozen=True)
class Samples:
    """New samples by channel: time (s) from the protocol's beginning and value (SI)."""

    streams: Streams


@dataclass(frozen=True)
class Models:
    """Names of the models of each kind of instrument."""

    names: Mapping[str, tuple[str, ...]]


@dataclass(frozen=True)
class Training:
    """Runs of the model that are done, and how many there are; then the channels that a fit takes."""

    done: int
    of: int
    streams: tuple[str, ...] = ()


@dataclass(frozen=True)
class Failed:
    """Why there is no fit, in plain words."""

    fault: str


@dataclass(frozen=True)
class Fitted:
    """The fit to the samples so far, ``rows`` empty while they are too few.

    ``rows``: symbol, value, standard error, remark. ``curves`` and ``data`` (n,) are in SI over ``time`` (n,) s, data
    nan where nothing is compared. ``explained`` is the share of the data's sum of squares, ``off`` the emulator's
    error at the last full run near the estimate, as a share of the largest value (nan: none yet).
    """

    rows: tuple[tuple[str, str, str, str], ...] = ()
    time: FloatArray | None = None
    curves: Mapping[str, FloatArray] = field(default_factory=dict)
    data: Mapping[str, FloatArray] = field(default_factory=dict)
    samples: int = 0
    explained: float = float("nan")
    off: float = float("nan")
    solves: int = 0


Answer = Models | Training | Failed | Fitted


def serve(connection: Connection, kinds: tuple[str, ...]) -> None:
    """The process: list the models of ``kinds``, then train, fit and refine until the window closes its end."""
    from acquire import plugins

    os.nice(NICE)
    try:
        try:
            solver = plugins.solver()
            connection.send(Models({kind: tuple(solver.models_of(kind)) for kind in kinds}))
        except (ValueError, AttributeError) as error:
            connection.send(Failed(f"no live fit: {error}"))
            return
        _Fitter(connection, solver).serve()
    except (EOFError, OSError, KeyboardInterrupt):
        return


class _Fitter:
    def __init__(self, connection: Connection, solver: Any) -> None:
        self._connection, self._solver = connection, solver
        self._fit: Any = None
        self._refining, self._next = False, 0.0

    def serve(self) -> None:
        while True:
            if self._refining and time.monotonic() >= self._next and not self._connection.poll():
                self._refine()
                continue
            message = self._connection.recv()
            try:
                self._take(message)
            except Exception as error:  # a model may be anybody's: whatever it does is told, and another may be tried
                self._fit, self._refining = None, False
                self._connection.send(Failed(str(error) or repr(error)))

    def _refine(self) -> None:
        """One full run of the model, then messages again. The fit that was sent last stays right without it."""
        began = time.monotonic()
        try:
            self._refining = self._fit.refine()
        except ValueError:
            self._refining = False
        took = time.monotonic() - began  # of a protocol of many minutes seconds: samples come first then
        self._next = began + (took if took < PERIOD else 3.0 * took)

    def _take(self, message: Train | Begin | Samples) -> None:
        if isinstance(message, Train):
            self._train(message)
        elif self._fit is None:
            self._connection.send(Fitted())
        elif isinstance(message, Begin):
            self._fit.begin()
        else:
            self._fit.take(message.streams)
            self._connection.send(_fitted(self._fit.update()))
            self._refining = True

    def _train(self, order: Train) -> None:
        self._refining, self._fit = False, None
        fit = self._solver.live(order.model, order.instrument, order.time, order.values, protocol=order.protocol)
        given_up = False

        def told(done: int, of: int) -> bool:
            nonlocal given_up
            self._connection.send(Training(done, of))
            given_up = self._connection.poll()  # another order: this one is not wanted any more
            return not given_up

        fit.train(told)
        if not given_up:
            self._fit = fit
            self._connection.send(Training(1, 1, fit.streams))


def _fitted(estimate: Any) -> Fitted:
    if estimate is None:
        return Fitted()
    e = estimate
    rows = tuple(e.rows())
    return Fitted(rows, e.time, dict(e.curves), dict(e.data), e.samples, e.explained, e.off, e.solves)


class LiveFitter(QObject):
    """The window's end. `poll` is called by its timer; nothing here waits, save `close`, at most a second."""

    answered = Signal(object)  # Answer
    lost = Signal()  # the process has ended

    def __init__(self, kinds: tuple[str, ...], parent: QObject | None = None) -> None:
        super().__init__(parent)
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self.process = context.Process(target=serve, args=(theirs, kinds), name="skinrig-live-fit", daemon=True)
        self.process.start()
        theirs.close()
        self._outbox: queue.SimpleQueue[Train | Begin | Samples | None] = queue.SimpleQueue()
        self._sender = threading.Thread(target=self._send, name="live-fit", daemon=True)
        self._sender.start()
        self._asked = -PERIOD
        self._waiting = False  # for the answer to samples
        self._open = True

    @property
    def idle(self) -> bool:
        """Whether samples may be sent: the last are answered, and a second has passed."""
        return self._open and not self._waiting and time.monotonic() - self._asked >= PERIOD

    def train(self, order: Train) -> None:
        """Train for a protocol; `Training` answers tell how far it is."""
        self._waiting = False
        self._outbox.put(order)

    def begin(self) -> None:
        """A run begins."""
        self._outbox.put(Begin())

    def send(self, streams: Streams) -> None:
        """Samples since the last call; answered by `Fitted`."""
        self._waiting, self._asked = True, time.monotonic()
        self._outbox.put(Samples(streams))

    def poll(self) -> None:
        """Hand on what came."""
        try:
            while self._open and self._connection.poll():
                answer: Answer = self._connection.recv()
                if isinstance(answer, Fitted | Failed):
                    self._waiting = False
                self.answered.emit(answer)
        except (EOFError, OSError):
            self.close()
            self.lost.emit()

    def close(self) -> None:
        """End the process. Idempotent."""
        if self._open:
            self._open = False
            self._outbox.put(None)
            self.process.kill()  # it holds nothing that could be lost
            self.process.join(1.0)
            self._sender.join(1.0)
            self._connection.close()

    def _send(self) -> None:
        try:
            while (message := self._outbox.get()) is not None:
                self._connection.send(message)
        except (OSError, ValueError):
            return  # the process is gone: `poll` tells
