"""The engine's own thread: carries out requests, and never forgets to beat while it waits for something."""

from __future__ import annotations

import abc
import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from concurrent.futures import TimeoutError as FutureTimeout
from typing import TypeVar

from acquire.engine.interlock import Interlock
from acquire.engine.requests import Requests
from acquire.engine.rules import Rules, Trip
from acquire.engine.state import Aborted, StateMachine, Tripped, WrongState
from acquire.supervisor import Heartbeat
from drivers.device import DeviceError, LinkLost

log = logging.getLogger(__name__)
T = TypeVar("T")

TICK = 0.02  # s of wall time between two turns when nothing wakes it earlier
ANSWER = 5.0  # s of wall time within which a device or its link's thread has to answer


class ControlLoop(abc.ABC):
    """One thread that takes turns; a trip or an abort voids whatever it waits for.

    ``name`` is the instrument's.
    """

    def __init__(self, name: str, machine: StateMachine, rules: Rules, heartbeat: Heartbeat | None) -> None:
        self._name = name
        self._machine = machine
        self._heartbeat = heartbeat
        self._interlock = Interlock(rules, self._tripped)
        self._wake = threading.Event()
        self._requests = Requests(self._wake)
        self._aborts: deque[str] = deque()
        self._ticked = 0.0
        self._closing: bool = False
        self._thread = threading.Thread(target=self._serve, name=f"engine-{name}", daemon=True)

    # Added by the engine ----------------------------------------------------------------------------------------------

    @abc.abstractmethod
    def _turn(self) -> None:
        """One turn."""

    @abc.abstractmethod
    def _broken(self, error: Exception) -> None:
        """A turn raised ``error`` and no trip explains it."""

    @abc.abstractmethod
    def _tripped(self, trip: Trip) -> None:
        """The interlock tripped, in whatever thread."""

    # For other threads ------------------------------------------------------------------------------------------------

    def _do(self, action: Callable[[], T]) -> T:
        """Have ``action`` carried out by the loop and wait for it. Raises WrongState where a stop came first."""
        if self._closing:
            raise WrongState("the engine is closed")
        future = self._requests.ask(action)
        while self._thread.is_alive():
            try:
                return future.result(1.0)
            except FutureTimeout:
                if future.done():
                    raise
            except CancelledError:
                raise Aborted("a person ended it first") from None
            except BaseException:
                future.cancel()  # nobody waits any more (Ctrl-C): a request that has not begun must not begin
                raise
        raise WrongState("the engine is closed")

    # In the loop's thread ---------------------------------------------------------------------------------------------

    def _serve(self) -> None:
        while not (self._closing and not self._machine.state.live):
            self._wake.wait(TICK)
            self._wake.clear()
            try:
                self._turn()
            except CancelledError:
                pass  # a stop overtook the request to a link; the next turn acts on it
            except Exception as error:
                if self._interlock.trip is not None:
                    continue  # a lost link has tripped already, in its own words
                log.exception("%s: the engine failed", self._name)
                self._broken(error)
        self._ended()
        self._requests.refuse(WrongState("the engine is closed"))

    @abc.abstractmethod
    def _ended(self) -> None:
        """The loop has ended."""

    def _answer_requests(self) -> None:
        for action, future in self._requests.take():
            try:
                future.set_result(action())
            except (CancelledError, WrongState) as error:
                future.set_exception(self._overtaken() or error)
            except Exception as error:
                future.set_exception(error)

    def _overtaken(self) -> WrongState | None:
        """Why requests are void: a trip or an abort; None if there is none."""
        if (trip := self._interlock.trip) is not None:
            return Tripped(f"{trip.code}: {trip.message}")
        return Aborted(self._aborts[0]) if self._aborts else None

    def _tick(self) -> None:
        """Tell the supervisor that the control loop is alive; only while it is in charge of a live device."""
        if self._heartbeat is None or not self._machine.state.live:
            return
        now = time.monotonic()
        if now - self._ticked >= TICK / 2:
            self._ticked = now
            self._heartbeat.tick()
            if not self._heartbeat.alive:
                self._interlock.fire(Trip("supervisor", "the supervisor process is gone: no heartbeat any more"))

    def _check_stop(self) -> None:
        """Raises CancelledError where a trip or an abort waits to be acted on."""
        if self._aborts or self._interlock.trip is not None:
            raise CancelledError

    def _await(self, future: Future[T], timeout: float = ANSWER) -> T:
        """The result of ``future``, beating meanwhile. Raises LinkLost after ``timeout`` s of wall time."""
        deadline = time.monotonic() + timeout
        while True:
            try:
                return future.result(TICK)
            except FutureTimeout:
                self._tick()
                if future.done():
                    continue  # the action itself raised a TimeoutError
                self._check_stop()
                if time.monotonic() > deadline:
                    raise LinkLost(f"{self._name}: the link's thread does not answer") from None

    def _wait_until(self, condition: Callable[[], bool], what: str) -> None:
        """Wait, beating, until ``condition`` holds. Raises DeviceError that the device does not do ``what``."""
        deadline = time.monotonic() + ANSWER
        while not condition():
            self._check_stop()
            if time.monotonic() > deadline:
                raise DeviceError(f"{self._name} does not {what} within {ANSWER:g} s")
            self._tick()
            time.sleep(TICK / 4)
