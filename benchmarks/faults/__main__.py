"""The fault campaign.

    python -m benchmarks.faults [--share 0.1] [--seed 1] [--jobs 3] [--only links,host/killed] [-o RESULT.json]

Faults of every kind, seeded, on simulated instruments in processes of their own; what happened to a person's skin is
asked of the instrument, never of the host. A table of trials, failures and the worst figure is printed row by row; the
exit status is 1 if a row has a failure. ``--share 1`` makes at least 100 trials a row, 0.1 is what continuous
integration runs.

The campaign is made of parts (``--list``), each in a process of its own, ``--jobs`` side by side. What a result file
holds already is not run again (``--again`` does), so that a campaign can be interrupted, or run in pieces: each row
says its revision and load. A part that fails beside others, and is judged by the clock, is tried once more with the
computer to itself, and the output says so: a starved host trips rightly."""

from __future__ import annotations

import argparse
import importlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from pathlib import Path

from benchmarks.faults.table import Campaign, Part, Row, about, load, markdown, save, timed, told

#: In this order; each is a module here with ``PARTS``, and ``CLOCKED`` where the clock judges.
FAMILIES = ("links", "wire", "host", "disk", "readings", "bounds", "files", "fuzz", "hostile", "soak")
BUDGET = 60.0  # s of processor time that fuzzing a target slower than a codec may take in the full campaign


def parts() -> dict[str, Part]:
    """All parts by name, ``family/part``."""
    modules = {family: importlib.import_module(f"benchmarks.faults.{family}") for family in FAMILIES}
    return {f"{family}/{name}": part for family, module in modules.items() for name, part in module.PARTS.items()}


def clocked(part: str) -> bool:
    """Whether the clock judges a part."""
    return bool(importlib.import_module(f"benchmarks.faults.{part.partition('/')[0]}").CLOCKED)


def main() -> int:
    """Run the campaign; exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.faults", description="The fault campaign.")
    parser.add_argument("--share", type=float, default=1.0, help="share of the full number of trials")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="parts side by side that the clock judges")
    parser.add_argument("--only", default="", help="families and parts, separated by commas; see --list")
    parser.add_argument("--again", action="store_true", help="run what the result file holds already")
    parser.add_argument("--list", action="store_true", help="name the parts")
    parser.add_argument("-o", "--output", type=Path, default=None, help="results as JSON; merged with what is there")
    parser.add_argument("--docs", type=Path, default=None, help="the table as Markdown")
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)  # one part, in this process
    given = parser.parse_args()
    known = parts()
    chosen = [part for part in known if not given.only or {part, part.partition("/")[0]} & set(given.only.split(","))]
    if given.list or not chosen:
        print("\n".join(known))
        return int(not chosen)
    campaign = Campaign(given.seed, given.share, BUDGET * given.share**2)
    if given.here:
        (part,) = chosen
        with tempfile.TemporaryDirectory() as folder:
            os.environ["XDG_RUNTIME_DIR"] = folder  # what programs that are killed here leave per user is nobody's
            save({part: list(timed(known[part](campaign), part))}, campaign, given.output)
        return 0
    return _run(chosen, list(known), campaign, given)


def _run(chosen: Sequence[str], order: Sequence[str], campaign: Campaign, given: argparse.Namespace) -> int:
    began = time.monotonic()
    done = load(given.output, campaign) if given.output else {}
    due = [part for part in chosen if given.again or part not in done]
    failed = 0
    for part, rows in _measured(_longest_first(due, done), campaign, given.jobs):
        for row in rows:
            print(told(row), flush=True)
        failed += sum(len(row.failures) for row in rows)
        done[part] = rows
        done = {name: done[name] for name in order if name in done}
        if given.output:
            save(done, campaign, given.output)
    print(f"{len(due)} parts of {len(order)}, {failed} failures, {time.monotonic() - began:.0f} s")
    if given.docs:
        rows = [row for found in done.values() for row in found]
        given.docs.write_text(markdown(rows, about(campaign, rows)), encoding="utf-8")
    return int(failed > 0)


def _longest_first(due: Sequence[str], done: dict[str, list[Row]]) -> list[str]:
    """Parts judged by the clock before all else; by their time of the last run, or the last families (the soak)
    first."""
    return sorted(reversed(due), key=lambda part: (not clocked(part), -sum(row.seconds for row in done.get(part, []))))


def _measured(due: Sequence[str], campaign: Campaign, jobs: int) -> Iterator[tuple[str, list[Row]]]:
    """Parts with their rows, each when it is done; at last, and once more, those that failed beside others.

    Parts judged by the clock mostly wait: beside ``jobs`` of these, one at a time of the others runs.
    """
    again = []
    with (
        tempfile.TemporaryDirectory(prefix="faults-") as name,
        ThreadPoolExecutor(jobs) as judged,
        ThreadPoolExecutor(1) as others,
    ):
        results = {part: Path(name) / f"{number}.json" for number, part in enumerate(due)}
        pool = {part: judged if jobs == 1 or clocked(part) else others for part in due}
        futures: dict[Future[list[Row]], str] = {pool[p].submit(_one, p, campaign, results[p]): p for p in due}
        for future in as_completed(futures):
            part, rows = futures[future], future.result()
            if jobs > 1 and clocked(part) and any(row.failures for row in rows):
                again.append(part)
                print(f"{part} failed beside other parts, and is tried again alone:", flush=True)
                print("\n".join(f"  {told(row)}" for row in rows if row.failures), flush=True)
            else:
                yield part, rows
        for part in again:
            yield part, _one(part, campaign, results[part])


def _one(part: str, campaign: Campaign, result: Path) -> list[Row]:
    """The rows of one part, in a process of its own; one that ends without them is a failed row."""
    result.unlink(missing_ok=True)
    options = ["--share", str(campaign.share), "--seed", str(campaign.seed), "--only", part, "-o", str(result)]
    patience = [] if clocked(part) else ["nice", "-n", "10"]
    command = [*patience, sys.executable, "-m", "benchmarks.faults", "--here", *options]
    # Killed hosts leave their status behind: not where this person's own programs look for it.
    environment = os.environ | {"XDG_RUNTIME_DIR": str(result.parent)}
    process = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    rows = load(result, campaign).get(part)
    if rows:
        return rows
    return [Row(part, "the part runs to its end", trials=1, failures=[process.stderr[-1000:]], part=part)]


if __name__ == "__main__":
    sys.exit(main())
