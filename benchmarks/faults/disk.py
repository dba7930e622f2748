"""Disks that are full, slow, read-only or taken away, journals that are unlinked, two programs on one instrument."""

from __future__ import annotations

import contextlib
import errno
import os
import resource
import signal
import subprocess
import time
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from random import Random

import numpy as np

from acquire.recording import RecordingError, load, open_recording, recover
from acquire.recording.journal import MAGIC
from benchmarks.faults.host import Hosts, host, part, send
from benchmarks.faults.table import Campaign, Part, Row

FULL = 100
MOUNT = ("mount", "-t", "tmpfs", "-o", "size=260m,mode=700", "skinrig-campaign")


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
        journal = hosts.journal()
        time.sleep(0.1 + 0.01 * (number % 50))
        began = time.monotonic()
        with contextlib.suppress(FileNotFoundError):
            if number % 2:
                hosts.out.rename(hosts.out.with_name(f"moved-{number}"))
            elif journal is not None:
                journal.unlink()
        problem = _ended(hosts, process, set())
        row.trial(time.monotonic() - began, problem)
    return row


def _mounted(campaign: Campaign, hosts: Hosts) -> Row:
    """A disk of its own for each run: full before, or filled to the last byte, or taken away, in the midst of it."""
    must = "full before: refused (2); else vented, status not 0, all that was journalled recovered or on another disk"
    row = Row("a mounted disk full before a run, filled up, or taken away during it", must, "s to the end of the run")
    for number in range(campaign.count(FULL)):
        disk, shelter = hosts.folder / "disk", hosts.folder / f"home-{number}"
        disk.mkdir(exist_ok=True)
        if subprocess.run([*MOUNT, str(disk)], capture_output=True, check=False).returncode:
            row.exception = "not tried: this computer lets nobody but its owner mount disks"
            return row
        try:
            began = time.monotonic()
            problem = KINDS[number % len(KINDS)](hosts, disk, shelter, 0.2 + 0.01 * (number % 50))
            row.trial(time.monotonic() - began, problem and f"{KINDS[number % len(KINDS)].__name__}: {problem}")
        finally:
            subprocess.run(["umount", "-l", str(disk)], capture_output=True, check=False)
    return row


def full_before(hosts: Hosts, disk: Path, shelter: Path, delay: float) -> str:
    _fill(disk / "filler")
    process = hosts.start(elsewhere, str(shelter), out=disk / "out")
    process.join(30)
    said = hosts.said.read_text()
    return "" if process.exitcode == 2 and " MB free" in said else f"status {process.exitcode}: {said[-200:]}"


def filled(hosts: Hosts, disk: Path, shelter: Path, delay: float) -> str:
    process = hosts.start(elsewhere, str(shelter), out=disk / "out")
    problem = "" if hosts.journal() else "no journal"
    time.sleep(delay)
    _fill(disk / "filler")
    problem = problem or _stopped(hosts, process)
    (disk / "filler").unlink()
    return problem or hosts.left()


def taken_away(hosts: Hosts, disk: Path, shelter: Path, delay: float) -> str:
    process = hosts.start(elsewhere, str(shelter), out=disk / "out")
    problem = "" if hosts.journal() else "no journal"
    time.sleep(delay)
    subprocess.run(["umount", "-l", str(disk)], check=True)
    return problem or _ended(hosts, process, {4}) or _saved(shelter)


KINDS = (full_before, filled, taken_away)


def _fill(path: Path) -> None:
    """Take all the space there is."""
    with contextlib.suppress(OSError), path.open("wb", buffering=0) as file:
        while True:
            file.write(bytes(1 << 20))
    with contextlib.suppress(OSError), path.open("ab", buffering=0) as file:
        while True:
            file.write(b"x")


def elsewhere(arguments: list[str], said: str, home: str) -> None:
    """In the host's process: a person's own data are at ``home``."""
    os.environ["XDG_DATA_HOME"] = home
    host(arguments, said)


def _saved(shelter: Path) -> str:
    found = list(shelter.rglob("*.h5"))
    return "" if len(found) == 1 and _sound(found[0]) else f"{len(found)} recordings were saved on the other disk"


def refusing(arguments: list[str], said: str, after: float) -> None:
    """In the host's process: ``after`` s from now the disk is read-only (nothing more can be written to a journal)."""
    write, due = os.write, time.monotonic() + after

    def refuse(file: int, data: bytes) -> int:
        if bytes(data[:4]) == MAGIC and time.monotonic() > due:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))
        return write(file, data)

    os.write = refuse
    host(arguments, said)


def _read_only(campaign: Campaign, hosts: Hosts) -> Row:
    """A folder of a disk that is read-only is refused before; journals that can no longer be written end the run."""
    must = "before: refused, named, nothing moves (2); in a run: vented, status not 0, what was written is recovered"
    row = Row("disk read-only before a run (/sys), and from some moment of it on (writes refused)", must)
    for number in range(campaign.count(FULL)):
        if number % 4 == 0:
            process = hosts.start(out=Path("/sys/nowhere"))
            process.join(30)
            said = hosts.said.read_text()
            problem = "" if process.exitcode == 2 and "/sys/nowhere" in said else f"status {process.exitcode}: {said}"
        else:
            after = (0.4 + 0.5 * (7 * number % 50) / 50) * hosts.length
            problem = _stopped(hosts, hosts.start(refusing, after)) or hosts.left(may_be_empty=True)
        row.trial(problem=problem)
    return row


def _stopped(hosts: Hosts, process: ForkServerProcess) -> str:
    """Faults in the end of a run whose disk was full."""
    _, problem = hosts.rig.stopped(20.0)
    process.join(30)
    said = hosts.said.read_text()
    ended = process.exitcode in {2, 3, 4} or (process.exitcode == 0 and any(map(_sound, hosts.out.glob("*.h5"))))
    return problem or ("" if ended and "Traceback" not in said else f"status {process.exitcode}: {said[-200:]}")


def stalling(arguments: list[str], said: str, seed: int) -> None:
    """In the host's process: one of twenty times that data go onto the disk takes a second."""
    sync, random = os.fdatasync, Random(seed)

    def stall(file: int) -> None:
        time.sleep(1.0 if random.random() < 0.05 else 0.0)
        sync(file)

    os.fdatasync = stall
    host(arguments, said)


def _slow(campaign: Campaign, hosts: Hosts) -> Row:
    row = Row(
        "disk stalls for a second, one write of twenty", "completes, and no sample is missing", "s to the recording"
    )
    for number in range(campaign.count(FULL)):
        began = time.monotonic()
        process = hosts.start(stalling, campaign.seed + number)
        process.join(60)
        problem = f"status {process.exitcode}: {hosts.said.read_text()[-200:]}" if process.exitcode else ""
        for path in hosts.out.glob("*.h5"):
            seq = load(path).streams["pressure"].seq
            if seq is None or (np.diff(seq) != 1).any():
                problem = problem or "samples are missing"
        row.trial(time.monotonic() - began, problem or hosts.left())
    return row


def _ended(hosts: Hosts, process: ForkServerProcess, statuses: set[int]) -> str:
    """Faults in how a run ended; status 0 needs a whole recording, else it is one of ``statuses``' others."""
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
    row = Row("two programs on one instrument, one journal, one target", "the second is refused and says whose it is")
    for number in range(campaign.count(FULL)):
        first, out = hosts.start(protocol=hosts.long), hosts.out
        journal = hosts.journal()
        if journal is None:
            problem = "the first run did not begin"
        elif number % 3 == 0:
            problem = _refused(hosts, hosts.start(), 3, "drives this instrument")
        elif number % 3 == 1:
            problem = _recovered(journal)
        else:  # another instrument, so that only the target is the same
            second = hosts.start(simulated, out=journal.with_suffix(".h5"))
            problem = _refused(hosts, second, 2, journal.name)
        send(first, signal.SIGINT)
        first.join(30)
        if not problem and (first.exitcode != 5 or not [path for path in out.glob("*.h5") if _sound(path)]):
            problem = f"the first run ends with {first.exitcode}"
        row.trial(problem=problem)
    return row


def simulated(arguments: list[str], said: str) -> None:
    """In the host's process: on an instrument of its own."""
    where = arguments.index("--station")
    host([*arguments[:where], "--sim", *arguments[where + 2 :]], said)


def _refused(hosts: Hosts, second: ForkServerProcess, status: int, words: str) -> str:
    second.join(30)
    said = hosts.said.read_text()
    if second.exitcode == status and words in said:
        return ""
    return f"a second run ends with {second.exitcode}: {said[-200:]}"


def _recovered(journal: Path) -> str:
    try:
        recover(journal)
    except RecordingError as error:
        return "" if journal.name in str(error) else f"the journal is not named: {error}"
    return "the journal of a run that goes on was recovered"


CLOCKED = True
PARTS: dict[str, Part] = {
    "full": part(_full),
    "mounted": part(_mounted),
    "read-only": part(_read_only),
    "slow": part(_slow),
    "unlinked": part(_unlinked),
    "doubles": part(_doubles),
}
