"""Work that takes long, in processes of its own: reading recordings, and the command line's tools."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from typing import Any

from PySide6.QtCore import QObject, QProcess, Signal

from acquire.gui import reading


class Analyst:
    """One process that reads recordings. The window's timer calls `poll`."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None
        self._waiting: list[tuple[Future[Any], Callable[[Any], None], Callable[[str], None]]] = []

    def ask(
        self, function: Callable[..., Any], *arguments: Any, then: Callable[[Any], None], fault: Callable[[str], None]
    ) -> None:
        """Have ``function`` called there; ``then`` or ``fault`` is called here by `poll`."""
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(1, mp_context=context, initializer=reading.begin)
        self._waiting.append((self._pool.submit(function, *arguments), then, fault))

    @property
    def busy(self) -> bool:
        """Whether an answer is outstanding."""
        return bool(self._waiting)

    def poll(self) -> None:
        """Hand on the answers that are there."""
        done = [job for job in self._waiting if job[0].done()]
        self._waiting = [job for job in self._waiting if not job[0].done()]
        for future, then, fault in done:
            error = future.exception()
            if error is None:
                then(future.result())
            else:
                fault(str(error) or repr(error))

    def close(self) -> None:
        """End the process. Idempotent."""
        self._waiting.clear()
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None


class Tool(QObject):
    """One run of an ``acquire`` command. ``said`` are the lines it prints on the way, ``ended`` its exit status."""

    said = Signal(str)
    ended = Signal(int)

    def __init__(self, arguments: Sequence[str], parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._process = QProcess(self)
        self._process.setProcessChannelMode(QProcess.ProcessChannelMode.MergedChannels)
        self._process.readyReadStandardOutput.connect(self._read)
        self._process.finished.connect(lambda code, status: self.ended.emit(code))
        self._process.start(sys.executable, ["-c", "from acquire.cli import main; main()", *arguments])

    def answer(self, text: str) -> None:
        """A person's answer to it, as typed."""
        self._process.write(text.encode())

    def terminate(self) -> None:
        """Ask it to end as Ctrl-C would: an instrument that runs is vented first; ``ended`` follows."""
        self._process.terminate()

    def cancel(self) -> None:
        """End it now; ``ended`` follows."""
        self._process.kill()

    def close(self) -> None:
        """End it and wait for it."""
        self._process.blockSignals(True)
        self._process.kill()
        self._process.waitForFinished(3000)

    def _read(self) -> None:
        text = bytes(self._process.readAllStandardOutput().data()).decode(errors="replace")
        for line in text.splitlines():
            if line.strip():
                self.said.emit(line.rstrip())
