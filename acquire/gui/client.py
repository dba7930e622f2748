"""The window's end of the worker process: commands out, updates in, and the safety pipe."""

from __future__ import annotations

import contextlib
import itertools
import multiprocessing
import time
from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QObject, Signal

from acquire.gui import worker
from acquire.gui.messages import ALIVE, STOP, BenchSettings, Command, Finished, Ready, Refused, Reply, View

SILENT = 3.0  # s without a view after which the worker is said not to answer
FAREWELL = 15.0  # s that the worker may take to finish recordings


class Client(QObject):
    """One worker process. The window's timer calls `poll`; nothing here ever waits, save `close`."""

    ready = Signal(object)  # Ready
    refused = Signal(str)  # the station cannot be used, with file and line; the worker has ended
    views = Signal(object)  # tuple[View, ...]
    finished = Signal(object)  # Finished
    lost = Signal(str)  # the worker ended or does not answer, in plain words

    def __init__(self, bench: BenchSettings, parent: QObject | None = None) -> None:
        super().__init__(parent)
        context = multiprocessing.get_context("spawn")
        theirs, self._commands = context.Pipe(duplex=False)
        self._updates, their_updates = context.Pipe(duplex=False)
        their_safety, self._safety = context.Pipe(duplex=False)
        ends = (theirs, their_updates, their_safety)
        self.process = context.Process(target=worker.main, args=(bench, *ends), name="skinrig-worker", daemon=True)
        self.process.start()
        for end in ends:
            end.close()  # so that each side sees the other's end close
        self._numbers = itertools.count(1)
        self._answers: dict[int, Callable[[Reply], None]] = {}
        self._heard = time.monotonic()
        self._open = True
        self._greeted = False

    @property
    def alive(self) -> bool:
        """Whether the worker is there and answers."""
        return self._open and (not self._greeted or time.monotonic() - self._heard <= SILENT)

    def ask(
        self, action: str, instrument: str = "", answer: Callable[[Reply], None] | None = None, **arguments: Any
    ) -> None:
        """Send a command; ``answer`` is called with the reply."""
        number = next(self._numbers)
        if answer is not None:
            self._answers[number] = answer
        try:
            self._commands.send(Command(number, action, instrument, arguments))
        except (OSError, ValueError):
            self._answers.pop(number, None)
            self._gone()

    def stop(self) -> None:
        """Emergency stop, by a pipe of its own."""
        with contextlib.suppress(OSError, ValueError):
            self._safety.send_bytes(STOP)

    def poll(self) -> None:
        """Say that the window is alive and take the messages that arrived."""
        if not self._open:
            return
        if time.monotonic() - self._heard < SILENT or not self._greeted:
            with contextlib.suppress(OSError, ValueError):
                self._safety.send_bytes(ALIVE)
        try:
            views: list[View] = []
            while self._updates.poll():
                update = self._updates.recv()
                self._heard = time.monotonic()
                if isinstance(update, tuple):
                    views += update
                    continue
                # In the order of sending: a view from before a reset, shown after the reset's reply, would latch anew.
                self._show(views)
                self._dispatch(update)
            self._show(views)
        except (EOFError, OSError):
            self._gone()
            return
        if self._greeted and time.monotonic() - self._heard > SILENT:
            self.lost.emit("the worker process does not answer; instruments vent by their own watchdog")

    def close(self) -> None:
        """End the worker: it aborts the runs, vents and finishes recordings first. Idempotent."""
        if self._open:
            self._open = False
            with contextlib.suppress(OSError, ValueError):
                self._commands.send(Command(0, "quit"))
            self._safety.close()
            deadline = time.monotonic() + FAREWELL
            while self.process.is_alive() and time.monotonic() < deadline:
                with contextlib.suppress(EOFError, OSError):
                    while self._updates.poll(0.02):
                        self._updates.recv()  # the worker's last words must not block it
                self.process.join(0.02)
            if self.process.is_alive():
                self.process.kill()
            self.process.join()
            self._commands.close()
            self._updates.close()

    def _show(self, views: list[View]) -> None:
        if views:
            self.views.emit(tuple(views))
            views.clear()

    def _dispatch(self, update: Ready | Refused | Reply | Finished) -> None:
        if isinstance(update, Ready):
            self._greeted = True
            self.ready.emit(update)
        elif isinstance(update, Refused):
            self.close()
            self.refused.emit(update.fault)
        elif isinstance(update, Finished):
            self.finished.emit(update)
        elif (answer := self._answers.pop(update.number, None)) is not None:
            answer(update)

    def _gone(self) -> None:
        if self._open:
            self.close()
            self.lost.emit("the worker process has ended; instruments vent by their own watchdog")
