"""Each part of the campaign fails when a control is taken out: ``python -m benchmarks.faults.proofs [PART …]``.

The control is removed in all processes of a part (host, simulator, hosts that are killed): each Python that starts
there does so by a ``sitecustomize`` of our own. A part then has to end with failures; the exit status is 1 if one has
none. A few trials are enough for that.
"""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.faults.mutations import VALUES, WATCHDOG, Removal, remove

ROOT = Path(__file__).parents[2]
VARIABLE = "REMOVED_FOR_PART"
SITE = f"import sys; sys.path.insert(0, {str(ROOT)!r}); from benchmarks.faults import proofs; proofs.start()"
SHARE, OF_HOSTS = 0.03, 0.08  # of the campaign; a host is killed at any moment, and few of a few act


def _yes(*args: object, **kwargs: object) -> bool:
    return True


def _no(*args: object, **kwargs: object) -> bool:
    return False


def _none(*args: object, **kwargs: object) -> tuple[()]:
    return ()


def _text(*args: object, **kwargs: object) -> str:
    return ""


def _zero(*args: object, **kwargs: object) -> int:
    return 0


def _as_it_is(self: object, name: str, holds: Any) -> Any:
    return holds


def _small(queue: Callable[..., Any]) -> Callable[..., Any]:
    return lambda capacity=0: queue(1 << 10)


def _fragile(reads: Callable[..., Any]) -> Callable[..., Any]:
    """A reader that falls over every tenth input with an error of its own."""
    count = itertools.count(1)

    def read(*args: Any, **kwargs: Any) -> Any:
        if next(count) % 10 == 0:
            raise KeyError("no such thing")
        return reads(*args, **kwargs)

    return read


STALE = Removal("only new samples count", "", ("acquire.engine.freshness:Freshness.fault",))
VENTS = Removal("the instrument's watchdog", "", (WATCHDOG,), _no)
GAPS = Removal("gaps are told", "", ("acquire.recording.order:Arrangement.events",), _none)
KEPT = Removal(
    "a run without a recording has not completed",
    "",
    ("acquire.cli.run:_status", "acquire.engine.recorder:finalise", "acquire.cli.run:_tell"),
    _zero,
)


def _reader(place: str) -> Removal:
    return Removal("one kind of error", "", (place,), instead=_fragile)


def _check(name: str) -> Removal:
    return Removal(f"the check {name}", "", (f"acquire.engine.{name}.look",))


#: Part -> the control without which it has to fail.
PROOFS: dict[str, Removal] = {
    "links/pulled": VENTS,
    "links/stale": STALE,
    "links/starved": Removal("an empty queue vents", "", ("sim_devices.servers.firmware:Firmware._watch_queue",)),
    "wire/bytes": Removal("discarded bytes are told", "", ("acquire.engine.active:ActiveRun._tell_discarded",)),
    "wire/camera-stalls": STALE,
    "wire/camera-drops": GAPS,
    "host/killed": VENTS,
    "host/stopped": VENTS,
    "host/signalled": Removal("abort", "", ("acquire.session:Session.abort", "acquire.engine.engine:RunEngine.abort")),
    "host/clocks": Removal("time between two turns", "", ("acquire.engine.host_clock:HostClock.fault",), _text),
    "host/next": Removal("connecting makes safe", "", ("acquire.engine.link:LinkThread._settle",)),
    "disk/full": KEPT,
    "disk/mounted": KEPT,
    "disk/read-only": KEPT,
    "disk/slow": Removal("room in the recorder's queue", "", ("acquire.engine.recorder:RecordQueue",), instead=_small),
    "disk/unlinked": KEPT,
    "disk/doubles": Removal("journals are locked", "", ("acquire.recording.lock:_lock",)),
    "readings/no-number": Removal("trip on a value", "", (VALUES,)),
    "readings/beyond": Removal("trip on a value", "", (VALUES, "acquire.engine.plausibility:Jumps.look")),
    "readings/jumping": _check("plausibility:Jumps"),
    "readings/moving": _check("checks:Following"),
    "readings/drifting": Removal("trip on tracking", "", (VALUES, "acquire.engine.checks:Following.look")),
    "readings/frozen": _check("plausibility:Frozen"),
    "readings/reference": _check("plausibility:Agreement"),
    "readings/dead-height": _check("plausibility:Response"),
    "readings/stays-up": _check("plausibility:Response"),
    "readings/spikes": Removal("two samples, not one", "", ("acquire.engine.checks:Twice.__call__",), _as_it_is),
    "bounds/limits": Removal("limits are compared", "", ("protocols.limits:Limits.violations",), _none),
    "files/damaged": Removal("checksums", "", ("zlib:crc32",), _zero),
    "fuzz/cutometer": _reader("drivers.lines:LineCodec.decode"),
    "fuzz/pressure": _reader("drivers.lines:LineCodec.decode"),
    "fuzz/robot": _reader("drivers.microrobot.codec:MicrorobotCodec.decode"),
    "fuzz/frames": _reader("drivers.aspiration.framelink:FrameDecoder.feed"),
    "fuzz/journal": _reader("acquire.recording:read_journal"),
    **dict.fromkeys(("fuzz/YAML-protocol", "fuzz/YAML-station", "fuzz/YAML-bundle"), _reader("protocols.source:read")),
    "hostile/files": Removal("documented status", "", ("acquire.cli.app:exit_status",), lambda error: 1),
    "soak/hour": GAPS,
}


def start() -> None:
    """In every Python of a part: remove the control that the environment names."""
    if part := os.environ.get(VARIABLE):
        remove(PROOFS[part])


def failures(part: str) -> str:
    """The first failure of a part without its control, or '' when it has none."""
    with tempfile.TemporaryDirectory(prefix="proofs-") as name:
        (Path(name) / "sitecustomize.py").write_text(SITE)
        path = os.pathsep.join((name, str(ROOT), os.environ.get("PYTHONPATH", "")))
        command = [sys.executable, "-m", "benchmarks.faults", "--only", part]
        command += ["--share", str(OF_HOSTS if part.startswith("host/") else SHARE)]
        environment = os.environ | {VARIABLE: part, "PYTHONPATH": path}
        done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)
    told = [line.strip() for line in done.stdout.splitlines() if line.startswith("       ")]
    return told[0] if done.returncode == 1 and told else ""


def main(arguments: list[str]) -> int:
    """Print the table; exit status."""
    unproved = 0
    print("| part | control removed | its first failure |\n|---|---|---|")
    for part in arguments or PROOFS:
        began = time.monotonic()
        failure = failures(part)
        unproved += not failure
        seconds = time.monotonic() - began
        print(f"| {part} | {PROOFS[part].control} | {failure[:110] or 'NONE'} | {seconds:.0f} s", flush=True)
    return int(unproved > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
