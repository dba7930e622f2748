"""The host killed, stopped or told to end in every phase (connecting, arming, running, finalising), its clock set.

The host is ``acquire run`` in a process of its own (forked from one that has imported everything, so that a trial costs
its run and not Python's start); the instrument is another's.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator
from multiprocessing.context import ForkServerProcess
from pathlib import Path

import numpy as np

from acquire.engine import RunEngine, host_clock
from acquire.recording import load, open_recording, recover
from benchmarks.faults.rig import WATCHDOG, Rig, Stillness, acts, hold
from benchmarks.faults.table import Campaign, Part, Row

FULL = 100
VENT = 0.3  # s after the last beat: the watchdog's 0.25 s and what the device takes to notice
BEGINNING = 8192  # bytes of a journal's first record and its copy, at most
LOSS = 0.1  # s of data that a killed host may lose
DAY = 86400.0  # s
BRIEF = """schema: protocol/1
name: brief
instrument: cutometer
steps:
- {type: hold, suction: 200 mbar, duration: 1.2 s}
- {type: wait, duration: 0.2 s}
"""
STATUSES = {0, 4, 5}  # done, tripped, aborted: whichever the signal came before
_CONTEXT = multiprocessing.get_context("forkserver")


def host(arguments: list[str], said: str) -> None:
    """In the host's process: ``acquire`` with ``arguments``, its words into the file ``said``."""
    descriptor = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    for stream in (1, 2):
        os.dup2(descriptor, stream)
    os.setpgrp()
    from acquire.cli.app import run

    os._exit(run(arguments))


class Hosts:
    """Runs of ``acquire run`` on one instrument, each in a process of its own."""

    def __init__(self, rig: Rig) -> None:
        _CONTEXT.set_forkserver_preload(["acquire.cli.app", "acquire.cli.run", "acquire.session", "drivers.cutometer"])
        self.rig = rig
        self.folder = Path(rig.folder.name)
        self.said = self.folder / "said.txt"
        self.protocol = self.folder / "brief.yaml"
        self.protocol.write_text(BRIEF)
        self.long = self.folder / "long.yaml"
        self.long.write_text(hold("cutometer"))
        self.short = self.folder / "short.yaml"
        self.short.write_text(BRIEF.replace("1.2 s", "0.2 s"))
        self._number = 0
        self.out = self.folder
        self.length = self._tried()  # s that a whole run takes

    def _tried(self) -> float:
        """How long a run without a fault takes, in s. Raises RuntimeError where none of five completes."""
        sound = 0
        for _ in range(5):  # the first one imports; a computer that is too busy trips rightly
            began = time.monotonic()
            process = self.start()
            process.join(60)
            sound += process.exitcode == 0
            if sound == 2:
                return time.monotonic() - began
        raise RuntimeError(f"a run without a fault ends with {process.exitcode}: {self.said.read_text()}")

    def start(
        self, target: Callable[..., None] = host, *more: object, protocol: Path | None = None, out: Path | None = None
    ) -> ForkServerProcess:
        """A run (of the brief protocol, into a new folder), just begun; ``target`` is what its process does, with
        ``more`` arguments."""
        self._number += 1
        self.said.write_text("")
        self.out = out or self.folder / f"out-{self._number}"
        arguments = ["run", str(protocol or self.protocol), "--station", str(self.rig.station), "-o", str(self.out)]
        process = _CONTEXT.Process(target=target, args=(arguments, str(self.said), *more))
        process.start()
        return process

    def journal(self) -> Path | None:
        """The journal of the newest run, as soon as there is one; None if there is none within 20 s."""
        deadline = time.monotonic() + 20
        while not (journals := list(self.out.glob("*.journal"))) and time.monotonic() < deadline:
            time.sleep(0.01)
        return journals[0] if journals else None

    def left(self, *, may_be_empty: bool = False) -> str:
        """Faults in the files that the newest run left behind; its journals are recovered.

        ``may_be_empty``: a journal that the disk did not even take the beginning of is no fault.
        """
        problems = []
        for journal in self.out.glob("*.journal"):
            empty = may_be_empty and journal.stat().st_size < BEGINNING
            if not empty and not journal.with_suffix(".h5").exists():
                with _told(problems, journal):
                    recover(journal)
        for path in self.out.glob("*.h5"):
            with _told(problems, path):
                open_recording(path)
        return "; ".join(problems)

    def last_sample(self) -> float:
        """Device time of the newest sample that the newest run left; NaN without any."""
        times = [float(load(path).streams["pressure"].time[-1]) for path in self.out.glob("*.h5")]
        return max(times, default=float("nan"))


@contextlib.contextmanager
def _told(problems: list[str], path: Path) -> Iterator[None]:
    try:
        yield
    except Exception as error:  # whatever it is, the recording is lost
        problems.append(f"{path.name}: {type(error).__name__}: {error}")


@contextlib.contextmanager
def hosts(campaign: Campaign) -> Iterator[Hosts]:
    """Hosts for one part."""
    with Rig("cutometer", seed=campaign.seed) as rig:
        yield Hosts(rig)


def _moments(campaign: Campaign, name: str, length: float) -> list[float]:
    """Moments over a whole run, evenly with some scatter: no phase is left out."""
    count = campaign.count(FULL)
    return [float(m) for m in (np.arange(count) + campaign.random(name).random(count)) / count * length]


def _killed(campaign: Campaign, hosts: Hosts) -> Row:
    row = Row(
        "host killed (kill -9) in every phase",
        f"vent ≤ {VENT:g} s, at most {LOSS * 1e3:g} ms lost, recovered whole, the next run starts",
        "s to the vent",
        VENT,
    )
    for moment in _moments(campaign, "killed", hosts.length):
        process = hosts.start()
        time.sleep(moment)
        early = f"the run before it was killed ends with {process.exitcode}" if process.exitcode else ""
        still = Stillness()
        truth, began = hosts.rig.truth(), time.monotonic()
        send(process, signal.SIGKILL)
        stopped, problem = hosts.rig.stopped()
        process.join()
        waited = still.close()
        problem = early or problem or hosts.left()
        if not problem and acts(truth):
            lost = truth.time - hosts.last_sample()
            if not lost <= LOSS + waited:
                problem = f"{lost:.3f} s lost"
        row.trial(max(0.0, stopped - began - waited), problem and f"after {moment:.2f} s: {problem}")
    return row


def _stopped(campaign: Campaign, hosts: Hosts) -> Row:
    row = Row(
        "host suspended (SIGSTOP) in every phase", "vent in time; the run trips when it goes on", "s to the vent", VENT
    )
    for moment in _moments(campaign, "stopped", hosts.length):
        process = hosts.start()
        time.sleep(moment)
        still = Stillness()
        truth, began = hosts.rig.truth(), time.monotonic()
        send(process, signal.SIGSTOP)
        stopped, problem = hosts.rig.stopped()
        waited = still.close()
        time.sleep(max(0.0, began + 2 * WATCHDOG - time.monotonic()))
        send(process, signal.SIGCONT)
        process.join(30)
        # Before anything acts, and after the end of the run, there is nothing to trip.
        expected = {4} if acts(truth) and truth.state == "running" else STATUSES | {3}
        if not problem and process.exitcode not in expected:
            problem = f"status {process.exitcode}: {hosts.said.read_text()[-200:]}"
        problem = problem or hosts.left()
        row.trial(max(0.0, stopped - began - waited), problem and f"after {moment:.2f} s: {problem}")
    return row


def _signalled(campaign: Campaign, hosts: Hosts) -> Row:
    must = "vent ≤ 1 s, status 5 (0 once all is done), no traceback, what was recorded is kept"
    row = Row("SIGINT, SIGTERM, SIGHUP in every phase", must, "s to the vent", 1.0)
    signals = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    for number, moment in enumerate(_moments(campaign, "signalled", hosts.length)):
        process, sent = hosts.start(), signals[number % len(signals)]
        time.sleep(moment)
        still = Stillness()
        began = time.monotonic()
        send(process, sent)
        stopped, problem = hosts.rig.stopped()
        waited = still.close()
        process.join(30)
        said = hosts.said.read_text()
        # A process that has not come to its first line yet simply ends, as any program does; by SIGINT with 1.
        ends = (-sent, 1) if sent == signal.SIGINT else (-sent,)
        early = process.exitcode in ends and not said and not list(hosts.out.glob("*"))
        if not problem and not early and (process.exitcode not in STATUSES or "Traceback" in said):
            problem = f"status {process.exitcode}: {said[-300:]}"
        problem = problem or hosts.left()
        row.trial(max(0.0, stopped - began - waited), problem and f"after {moment:.2f} s: {problem}")
    return row


def clocks(arguments: list[str], said: str, name: str, after: float) -> None:
    """In the host's process: ``after`` s from now its clock is set, or from the run's start on the computer seems to
    have been suspended."""
    now, boot, start, due = time.time, host_clock.boot_time, RunEngine.start, time.monotonic() + after
    if name == "suspended":

        def started(engine: RunEngine) -> None:
            due = time.monotonic() + 0.1
            host_clock.boot_time = lambda: boot() + (30.0 if time.monotonic() > due else 0.0)
            start(engine)

        RunEngine.start = started  # type: ignore[method-assign]
    else:
        step = DAY if name == "forward" else -DAY
        time.time = lambda: now() + (step if time.monotonic() > due else 0.0)
    host(arguments, said)


def _clocked(campaign: Campaign, hosts: Hosts) -> Row:
    must = "a clock that is set changes nothing (0, its end after its start, times rise); a suspension trips (4)"
    row = Row("wall clock set by a day, either way; computer suspended for 30 s (told so by its clock)", must)
    names = ("forward", "back", "suspended")
    for number, moment in enumerate(_moments(campaign, "clocks", hosts.length)):
        name = names[number % len(names)]
        process = hosts.start(clocks, name, float(moment))
        _, problem = hosts.rig.stopped(20.0)
        process.join(30)
        recordings = list(hosts.out.glob("*.h5"))
        if not problem and process.exitcode != (4 if name == "suspended" else 0):
            problem = f"status {process.exitcode}: {hosts.said.read_text()[-200:]}"
        elif not problem and len(recordings) != 1:
            problem = f"{len(recordings)} recordings"
        problem = problem or _times(recordings[0])
        row.trial(problem=problem and f"{name} after {moment:.2f} s: {problem}")
    return row


def _times(path: Path) -> str:
    """Faults in the times of a recording."""
    recording = load(path)
    host = recording.streams["pressure"].time_host
    if not recording.info.end_time > recording.info.start_time:
        return f"it ends at {recording.info.end_time}, having begun at {recording.info.start_time}"
    return "" if host is not None and (np.diff(host) >= 0).all() else "host times go back"


def send(process: ForkServerProcess, number: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(process.pid or 0, number)


def _next(campaign: Campaign, hosts: Hosts) -> Row:
    """After a kill, a stop and a signal while suction acts."""
    row = Row("the next run after a kill, SIGSTOP, SIGTERM under suction", "starts and completes")
    for number in range(campaign.count(FULL)):
        process = hosts.start()
        deadline = time.monotonic() + 20
        while not acts(hosts.rig.truth()) and time.monotonic() < deadline:
            time.sleep(0.01)
        send(process, (signal.SIGKILL, signal.SIGSTOP, signal.SIGTERM)[number % 3])
        if number % 3 == 1:
            time.sleep(2 * WATCHDOG)
            send(process, signal.SIGCONT)
        process.join(30)
        following = hosts.start(protocol=hosts.short)
        following.join(60)
        said = hosts.said.read_text()[-200:]
        row.trial(problem=f"status {following.exitcode}: {said}" if following.exitcode else "")
    return row


def part(row: Callable[[Campaign, Hosts], Row]) -> Part:
    """A part of one row that is made with hosts."""

    def rows(campaign: Campaign) -> Iterator[Row]:
        with hosts(campaign) as them:
            yield row(campaign, them)

    return rows


CLOCKED = True
PARTS: dict[str, Part] = {
    "killed": part(_killed),
    "stopped": part(_stopped),
    "signalled": part(_signalled),
    "clocks": part(_clocked),
    "next": part(_next),
}
