"""Hostile files: mutated inputs of every kind that the commands read.

Each gives one clear message that names the file, status 0 or 2, writes nothing but its result, and costs at most 200 MB
and 5 s of processor time. Inputs are made from their number, so that a failure can be repeated:
``python -m benchmarks.faults.hostile KIND NUMBER [SEED]``.
"""

from __future__ import annotations

import contextlib
import faulthandler
import io
import json
import os
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.faults.inputs import Kind, Samples, kinds
from benchmarks.faults.table import Campaign, Part, Row

WEIGHTS = {
    **{
        "protocol": 2.0,
        "station": 2.0,
        "bundle": 3.0,
        "bundle's protocol": 1.0,
        "CSV": 2.0,
        "XLSX": 2.0,
        "picture": 1.0,
    },
    **{"column map": 1.0, "HDF5": 4.0, "journal": 4.0, "fit specification": 1.0, "model file": 1.0, "argument": 2.0},
}
FULL = 1200  # mutated inputs of all kinds together
MEMORY, SECONDS, HANG = 200.0, 5.0, 30  # MB above the idle program, s of processor time, s until it is given up
BATCH = 60  # inputs that one process reads; a crash costs the rest of a batch, and it goes on in another


# One input ------------------------------------------------------------------------------------------------------------


class Writes:
    """Files that this process opens for writing, renames or removes, as Python tells it, while ``folder`` is set."""

    def __init__(self) -> None:
        self.folder = ""
        self.elsewhere: list[str] = []
        sys.addaudithook(self._heard)

    def _heard(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self.folder:
            return
        if event == "open":
            path, _, flags = arguments
            writes = isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
            if writes and isinstance(path, str | bytes | os.PathLike):
                self._check(path)
        elif event in ("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.truncate"):
            for path in arguments[:2]:
                if isinstance(path, str | bytes | os.PathLike):
                    self._check(path)
        elif event in ("os.system", "subprocess.Popen", "socket.connect"):
            self.elsewhere.append(f"{event} {arguments[:1]}")

    def _check(self, path: Any) -> None:
        text = os.path.abspath(os.fsdecode(path))
        allowed = (
            self.folder,
            "/dev/null",
            "/tmp/matplotlib",
            os.path.expanduser("~/.cache"),
            os.path.expanduser("~/.config"),
        )
        if not text.startswith(allowed) and "__pycache__" not in text:
            self.elsewhere.append(text)


def _peak(reset: bool = False) -> float:
    """The most memory of this process in MB since the last reset."""
    if reset:
        Path("/proc/self/clear_refs").write_text("5")
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


def attempt(kind: Kind, number: int, seed: int, writes: Writes) -> dict[str, Any]:
    """Spoil one input, have it read, and say how that went."""
    random = np.random.default_rng([seed, number, *kind.name.encode()])
    with tempfile.TemporaryDirectory(prefix="hostile-") as name:
        folder = Path(name)
        arguments = kind.make(folder, random)
        before = {path: path.lstat().st_mtime_ns for path in folder.rglob("*")}
        start, began = _peak(reset=True), time.process_time()
        out, err = io.TextIOWrapper(io.BytesIO(), "utf-8", "strict"), io.StringIO()
        writes.folder, writes.elsewhere = str(folder / "out"), []
        problem = ""
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                status = _run(arguments)
                out.flush()
        except BaseException:
            status, problem = -1, "an exception: " + traceback.format_exc(limit=-3)
        finally:
            writes.folder = ""
        seconds, memory = time.process_time() - began, _peak() - start
        outside = {p: stamp for p, stamp in before.items() if not p.is_relative_to(folder / "out")}
        touched = [p for p, stamp in outside.items() if not os.path.lexists(p) or p.lstat().st_mtime_ns != stamp]
        new = [p for p in folder.rglob("*") if p not in before and not str(p).startswith(str(folder / "out"))]
    # A command line that is wrong names the option instead.
    names = [] if kind.name == "argument" else [path.name for path in before]
    problem = problem or _judged(status, err.getvalue(), names, [*touched, *new, *writes.elsewhere])
    return {"status": status, "seconds": seconds, "memory": memory, "problem": problem}


def _run(arguments: list[str]) -> int:
    from acquire.cli.app import run

    if arguments[0] != "<spec>":
        return run(arguments)
    from skinrig_solver.fit.spec import load_spec

    try:
        load_spec(arguments[1])
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _judged(status: int, said: str, names: list[str], touched: list[Any]) -> str:
    if "Traceback" in said:
        return "a traceback: " + said.strip()[-300:]
    if status not in (0, 2):
        return f"status {status}: {said.strip()[-300:]}"
    if status == 2 and not said.strip():
        return "refused without a word"
    if status == 2 and names and not any(name in said for name in names):
        return f"names no file: {said.strip()[-300:]}"
    if len(said) > 30_000:
        return f"a message of {len(said)} characters"
    if touched:
        return f"wrote or changed {touched[:3]}"
    return ""


def main(arguments: list[str]) -> int:
    """A worker: reads ``kind, number`` lines, answers each in one line; or one input by hand, with its traceback."""
    faulthandler.enable()
    writes = Writes()
    with tempfile.TemporaryDirectory(prefix="hostile-samples-") as name:
        known = kinds(Samples(Path(name)))
        if arguments[:1] != ["--worker"]:
            kind, number, seed = arguments[0], int(arguments[1]), int(arguments[2]) if len(arguments) > 2 else 1
            os.environ["ACQUIRE_DEBUG"] = "1"
            print(json.dumps(attempt(known[kind], number, seed, writes), indent=1))
            return 0
        answer = sys.stdout
        print("ready", file=answer, flush=True)
        for line in sys.stdin:
            kind, number, seed = json.loads(line)
            faulthandler.dump_traceback_later(HANG, exit=True)
            result = attempt(known[kind], number, seed, writes)
            faulthandler.cancel_dump_traceback_later()
            print(json.dumps(result), file=answer, flush=True)
    return 0


# The row --------------------------------------------------------------------------------------------------------------


class Worker:
    """A process that reads inputs, replaced when one of them kills it."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None
        self._left = 0

    def ask(self, kind: str, number: int, seed: int) -> dict[str, Any]:
        """How the input went; ``problem`` says so if the process died of it."""
        if self._process is None or not self._left:
            self.close()
            command = [sys.executable, "-m", "benchmarks.faults.hostile", "--worker"]
            pipe = subprocess.PIPE
            self._errors = tempfile.TemporaryFile("w+")  # noqa: SIM115 - closed with the worker
            self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=self._errors, text=True)
            self._left = BATCH
            assert self._process.stdout is not None
            if self._process.stdout.readline().strip() != "ready":
                self._errors.seek(0)
                raise RuntimeError(f"the reader of hostile files did not start: {self._errors.read()[-2000:]}")
        self._left -= 1
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with contextlib.suppress(OSError):
            self._process.stdin.write(json.dumps([kind, number, seed]) + "\n")
            self._process.stdin.flush()
        line = self._process.stdout.readline()
        if line:
            return dict(json.loads(line))
        status = self._process.wait()
        self._errors.seek(0)
        why = self._errors.read()[-400:]
        self._process = None
        word = "hung" if "Timeout" in why else "crashed"
        return {"status": status, "seconds": HANG, "memory": 0.0, "problem": f"the process {word} ({status}): {why}"}

    def close(self) -> None:
        if self._process is not None:
            self._process.communicate()
            self._process = None


def rows(campaign: Campaign) -> Iterator[Row]:
    """One row per kind of input, and what they cost."""
    count = campaign.count(FULL, 60)
    worker = Worker()
    try:
        for name, weight in WEIGHTS.items():
            row = Row(
                f"hostile files: {name}",
                "one message, status 0 or 2, nothing written elsewhere, ≤ 200 MB",
                "s of processor time",
                SECONDS,
            )
            most = 0.0
            for number in range(max(2, round(count * weight / sum(WEIGHTS.values())))):
                result = worker.ask(name, number, campaign.seed)
                problem, most = result["problem"], max(most, result["memory"])
                if not problem and result["memory"] > MEMORY:
                    problem = f"{result['memory']:.0f} MB"
                row.trial(result["seconds"], problem and f"{name} {number}: {problem}")
            row.must += f" (worst {most:.0f} MB)"
            yield row
    finally:
        worker.close()


CLOCKED = False
PARTS: dict[str, Part] = {"files": rows}

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
