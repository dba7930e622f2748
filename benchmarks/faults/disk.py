"""Disks that are full, journals that are unlinked or moved, and two programs on one instrument or journal."""

from __future__ import annotations

import contextlib
import resource
import signal
import time
from collections.abc import Iterator
from multiprocessing.context import ForkServerProcess
from pathlib import Path

from acquire.recording import RecordingError, open_recording, recover
from benchmarks.faults.host import Hosts, host, send
from benchmarks.faults.rig import Rig
from benchmarks.faults.table import Campaign, Row

FULL = 100
VENTED = 2.0  # s after the disk refused: the check once a second, and the vent


def rows(campaign: Campaign) -> Iterator[Row]:
    """Disks, then doubles."""
    with Rig("cutometer", seed=campaign.seed) as rig:
        hosts = Hosts(rig)
        yield _full(campaign, hosts)
        yield _unlinked(campaign, hosts)
        yield _doubles(campaign, hosts)


def limited(arguments: list[str], said: str, size: int) -> None:
    """In the host's process: no file may grow beyond ``size`` bytes, as on a disk that is full."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
    host(arguments, said)


def _full(campaign: Campaign, hosts: Hosts) -> Row:
    must = "vented, status not 0 unless all is recorded, the journal is intact, no half file under a final name"
    row = Row("disk full (files end at a random size)", must, "s to the end of the run")
    random = campaign.random("full")
    whole = max(path.stat().st_size for path in hosts.out.glob("*.h5"))
    for _ in range(campaign.count(FULL)):
        size = int(10 ** random.uniform(2.5, 5.3))
        process = hosts.start(limited, size)
        began = time.monotonic()
        problem = _ended(hosts, process, {0} if size > 4 * whole else set())
        row.trial(time.monotonic() - began, problem and f"{size} bytes: {problem}")
    return row


def _unlinked(campaign: Campaign, hosts: Hosts) -> Row:
    must = "vented, status not 0 unless a whole recording is there"
    row = Row("journal unlinked or its folder moved away during a run", must, "s to the end of the run")
    for number in range(campaign.count(FULL)):
        process = hosts.start()
        deadline = time.monotonic() + 20
        while not (journals := list(hosts.out.glob("*.journal"))) and time.monotonic() < deadline:
            time.sleep(0.01)
        time.sleep(0.1 + 0.01 * (number % 50))
        began = time.monotonic()
        with contextlib.suppress(FileNotFoundError):
            if number % 2:
                hosts.out.rename(hosts.out.with_name(f"moved-{number}"))
            else:
                journals[0].unlink()
        problem = _ended(hosts, process, set())
        row.trial(time.monotonic() - began, problem)
    return row


def _ended(hosts: Hosts, process: ForkServerProcess, statuses: set[int]) -> str:
    """What is wrong with how a run ended; status 0 needs a whole recording, else it is one of ``statuses``' others."""
    _, problem = hosts.rig.stopped(20.0)
    process.join(30)
    said = hosts.said.read_text() if hosts.said.exists() else ""
    if problem:
        return problem
    if process.exitcode not in {0, 2, 3, 4} or "Traceback" in said:
        return f"status {process.exitcode}: {said[-200:]}"
    recordings = [path for path in hosts.out.glob("*.h5") if _sound(path)]
    if process.exitcode == 0 and not recordings:
        return "status 0 without a recording"
    if statuses and process.exitcode not in statuses:
        return f"status {process.exitcode}: {said[-200:]}"
    return hosts.left(may_be_empty=True)


def _sound(path: Path) -> bool:
    try:
        return bool(open_recording(path).info.status)
    except (RecordingError, OSError):
        return False


def _doubles(campaign: Campaign, hosts: Hosts) -> Row:
    row = Row("two programs on one instrument, one journal", "the second is refused and says whose it is")
    for number in range(campaign.count(FULL)):
        first = hosts.start(protocol=hosts.long)
        out = hosts.out
        deadline = time.monotonic() + 20
        while not (journals := list(out.glob("*.journal"))) and time.monotonic() < deadline:
            time.sleep(0.01)
        problem = "" if journals else "the first run did not begin"
        if number % 2 == 0:
            second = hosts.start()
            second.join(20)
            said = hosts.said.read_text()
            if second.exitcode != 3 or "drives this instrument" not in said:
                problem = problem or f"a second run ends with {second.exitcode}: {said[-200:]}"
        elif journals:
            problem = _recovered(journals[0])
        send(first, signal.SIGINT)
        first.join(30)
        if not problem and (first.exitcode != 5 or not [path for path in out.glob("*.h5") if _sound(path)]):
            problem = f"the first run ends with {first.exitcode}"
        row.trial(problem=problem)
    return row


def _recovered(journal: Path) -> str:
    try:
        recover(journal)
    except RecordingError as error:
        return "" if journal.name in str(error) else f"the journal is not named: {error}"
    return "the journal of a run that goes on was recovered"
