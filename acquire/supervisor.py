"""The heartbeat's keeper: a small process of its own that permits beats only while those who must be alive say so.

The control loop (and the window, where there is one) sends its name down a pipe at every turn. While every one of
them was heard within the last ``patience`` seconds, the keeper sends one byte back every ``period``: a permission to
beat once. The thread that owns the instrument's link passes it on. So no beat outlives the control loop, the window,
the link's thread or the keeper itself, and an instrument without beats makes itself safe by its own watchdog.

The process imports the standard library only, and runs this file by its path.
"""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from typing import Protocol

PERIOD = 0.05  # s between permissions; a device's watchdog (0.25 s by default) outlasts a few lost ones
PATIENCE = 0.15  # s of silence of one that must be alive after which permissions stop


class Heartbeat(Protocol):
    """The part of a `Supervisor` that the engine needs."""

    @property
    def alive(self) -> bool:
        """Whether beats can still be permitted."""

    def permissions(self) -> int:
        """Beats permitted so far."""

    def tick(self, name: str = "engine") -> None:
        """The control loop is alive."""


class Supervisor:
    """The application's side of the keeper's process. ``watched`` are the names that must be heard."""

    def __init__(self, watched: Sequence[str] = ("engine",), patience: float = PATIENCE) -> None:
        for name in watched:
            if not name.isidentifier():
                raise ValueError(f"{name!r} cannot be watched: not an identifier")
        self.watched = tuple(watched)
        # -I -S: no site packages, no environment: it starts in milliseconds and nothing can be slipped into it.
        command = [sys.executable, "-I", "-S", __file__, str(patience), *watched]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)
        self._permissions = 0
        self._lock = threading.Lock()
        self._reader = threading.Thread(target=self._read, name="supervisor-permissions", daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """Process id of the keeper."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether the keeper runs."""
        return self._process.poll() is None

    def permissions(self) -> int:
        """How many beats have been permitted so far."""
        return self._permissions

    def tick(self, name: str = "engine") -> None:
        """Say that ``name`` is alive. Never raises: a keeper that is gone permits nothing more, and that counts."""
        assert self._process.stdin is not None
        with self._lock, contextlib.suppress(OSError, ValueError):
            self._process.stdin.write(f"{name}\n".encode())

    def close(self) -> None:
        """End the keeper. Idempotent."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with self._lock, contextlib.suppress(OSError):
            self._process.stdin.close()
        try:
            self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()
        self._process.stdout.close()

    def _read(self) -> None:
        assert self._process.stdout is not None
        while permitted := self._process.stdout.read(64):
            self._permissions += len(permitted)


def _keep(patience: float, watched: Sequence[str]) -> None:
    """The keeper's loop: ends when its standard input does."""
    heard = dict.fromkeys(watched, float("-inf"))
    over = threading.Event()

    def listen() -> None:
        for line in sys.stdin:
            name = line.strip()
            if name in heard:
                heard[name] = time.monotonic()
        over.set()

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole terminal: the application decides
    threading.Thread(target=listen, daemon=True).start()
    while not over.wait(PERIOD):
        if time.monotonic() - min(heard.values()) <= patience:
            sys.stdout.buffer.write(b".")
            sys.stdout.buffer.flush()


if __name__ == "__main__":
    with contextlib.suppress(BrokenPipeError):
        _keep(float(sys.argv[1]), sys.argv[2:])
