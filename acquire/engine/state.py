"""The states of a run and the only ways between them."""

from __future__ import annotations

import enum
import threading
from collections.abc import Callable


class State(enum.StrEnum):
    """Where an instrument's run stands."""

    IDLE = "idle"
    CONNECTING = "connecting"
    READY = "ready"
    ARMED = "armed"
    RUNNING = "running"
    PAUSED = "paused"
    COMPLETED = "completed"
    ABORTED = "aborted"
    TRIPPED = "tripped"
    FAILED = "failed"

    @property
    def live(self) -> bool:
        """Whether the device may act on a person: the heartbeat beats in these states and in no other."""
        return self in _LIVE

    @property
    def final(self) -> bool:
        """Whether a run has ended in this state."""
        return self in _FINAL


_LIVE = frozenset({State.ARMED, State.RUNNING, State.PAUSED})
_FINAL = frozenset({State.COMPLETED, State.ABORTED, State.TRIPPED, State.FAILED})

#: event -> {state: next state}. An event that is missing here is ignored.
TRANSITIONS: dict[str, dict[State, State]] = {
    "connect": {State.IDLE: State.CONNECTING},
    "connected": {State.CONNECTING: State.READY},
    "arm": {State.READY: State.ARMED, State.COMPLETED: State.ARMED, State.ABORTED: State.ARMED},
    "start": {State.ARMED: State.RUNNING},
    "pause": {State.RUNNING: State.PAUSED},
    "resume": {State.PAUSED: State.RUNNING},
    "complete": {State.RUNNING: State.COMPLETED},
    "abort": {State.CONNECTING: State.IDLE, **dict.fromkeys((State.ARMED, State.RUNNING, State.PAUSED), State.ABORTED)},
    "trip": {s: State.TRIPPED for s in State if s not in (State.TRIPPED, State.FAILED)},
    "fail": {s: State.FAILED for s in State if s not in (State.TRIPPED, State.FAILED)},
    # A trip or a failure is left by a person only; the links are opened anew after it.
    "reset": {State.TRIPPED: State.IDLE, State.FAILED: State.IDLE},
    # A link went away where no person is attached: the engine opens it anew by itself.
    "lose": {s: State.IDLE for s in (State.READY, State.COMPLETED, State.ABORTED)},
    "disconnect": {s: State.IDLE for s in (State.READY, State.COMPLETED, State.ABORTED)},
}


class WrongState(RuntimeError):
    """An event that the present state does not take, such as ``start`` while idle."""


class Tripped(WrongState):
    """A request is void because the interlock has tripped; the message says why."""


class Aborted(WrongState):
    """A request is void because a person ended it first; the message says how."""


class StateMachine:
    """The present state, changed by events only; thread-safe.

    ::

        idle --connect--> connecting --connected--> ready --arm--> armed --start--> running --complete--> completed
         ^ ^                   |                      ^                             |     ^
         | +------abort--------+                      |                       pause v     | resume
         |                                            |                            paused
         |
         +--disconnect-- ready, completed, aborted
         +--lose-------- ready, completed, aborted
         +--reset------- tripped, failed

        armed, running, paused             --abort--> aborted
        all but tripped and failed         --trip---> tripped
        all but tripped and failed         --fail---> failed
        ready, completed, aborted          --arm----> armed

    ``completed`` and ``aborted`` can be armed again; ``tripped`` and ``failed`` need ``reset``, which is a person's.
    """

    def __init__(self, listener: Callable[[State, str], None] | None = None) -> None:
        """``listener(state, event)`` is called after each change, in the thread that made it."""
        self._state = State.IDLE
        self._lock = threading.Lock()
        self._listener = listener

    @property
    def state(self) -> State:
        """The present state."""
        return self._state

    def can(self, event: str) -> bool:
        """Whether the present state takes ``event``."""
        return self._state in TRANSITIONS[event]

    def fire(self, event: str) -> State:
        """Take ``event`` and return the new state. Raises WrongState."""
        with self._lock:
            try:
                self._state = TRANSITIONS[event][self._state]
            except KeyError:
                raise WrongState(f"cannot {event} while {self._state}") from None
            state = self._state
        if self._listener is not None:
            self._listener(state, event)
        return state
