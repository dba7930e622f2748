"""A person's signals (Ctrl-C, a polite kill, a closed terminal), acted on in a thread of their own.

A Python signal handler interrupts the main thread anywhere, also while it holds a lock that the handler would need, and
not before the main thread leaves the library it is in. So the handlers here do nothing: the interpreter writes the
signal's number to a socket at once, whatever the main thread does, and a thread reads it and acts.
"""

from __future__ import annotations

import contextlib
import logging
import signal
import socket
import threading
from collections.abc import Callable, Iterator

log = logging.getLogger(__name__)

PERSON = ("SIGINT", "SIGTERM", "SIGHUP")


@contextlib.contextmanager
def caught(act: Callable[[str], None]) -> Iterator[None]:
    """While inside, ``act`` is called with the name of each of a person's signals. Does nothing off the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [getattr(signal, name) for name in PERSON if hasattr(signal, name)]
    ours, theirs = socket.socketpair()
    theirs.setblocking(False)

    def listen() -> None:
        while data := ours.recv(1):
            if data[0] in numbers:
                try:
                    act(signal.Signals(data[0]).name)
                except Exception:  # the next signal must still be heard
                    log.exception("acting on a signal")

    listener = threading.Thread(target=listen, name="signals", daemon=True)
    listener.start()
    before = {number: signal.signal(number, lambda *_: None) for number in numbers}
    descriptor = signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(descriptor)
        for number, handler in before.items():
            signal.signal(number, handler)
        theirs.close()
        listener.join()
        ours.close()
