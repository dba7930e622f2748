"""The fault campaign.

    python -m benchmarks.faults [--share 0.1] [--seed 1] [--jobs 3] [--only links,host] [-o RESULT.json]

Faults of every kind, seeded, on simulated instruments in processes of their own; what happened to a person's skin is
asked of the instrument, never of the host. A table of trials, failures and the worst figure is printed row by row; the
exit status is 1 if a row has a failure. ``--share 1`` makes at least 100 trials a row and takes hours, 0.1 (what
continuous integration runs) minutes. Most rows wait for something: ``--jobs`` families run side by side. What fails
beside others is tried once more with the computer to itself, and the output says so: a starved host trips rightly.
"""

from __future__ import annotations

import argparse
import importlib
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from benchmarks.faults.table import Campaign, Row, about, markdown, save, timed, told

#: In this order; each is a module here with a function ``rows``.
FAMILIES = ("links", "wire", "host", "disk", "readings", "bounds", "files", "fuzz", "hostile", "soak")


def main() -> int:
    """Run the campaign; exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.faults", description="The fault campaign.")
    parser.add_argument("--share", type=float, default=1.0, help="share of the full number of trials")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="families side by side")
    parser.add_argument("--only", default="", help=f"families, separated by commas: {','.join(FAMILIES)}")
    parser.add_argument("-o", "--output", type=Path, default=None, help="results as JSON")
    parser.add_argument("--docs", type=Path, default=None, help="the table as Markdown")
    given = parser.parse_args()
    chosen = given.only.split(",") if given.only else FAMILIES
    if unknown := set(chosen) - set(FAMILIES):
        parser.error(f"no family {', '.join(sorted(unknown))}")
    campaign = Campaign(given.seed, given.share)
    began = time.monotonic()
    done: list[Row] = []
    for row in _beside(chosen, campaign, given.jobs) if given.jobs > 1 else _here(chosen, campaign):
        print(told(row), flush=True)
        done.append(row)
    seconds = time.monotonic() - began
    failures = sum(len(row.failures) for row in done)
    print(f"{sum(row.trials for row in done)} trials, {failures} failures, {seconds:.0f} s")
    if given.output:
        save(done, campaign, seconds, given.output)
    if given.docs:
        given.docs.write_text(markdown(done, about(campaign, seconds)), encoding="utf-8")
    return int(failures > 0)


def _here(families: Sequence[str], campaign: Campaign) -> Iterator[Row]:
    for family in families:
        yield from timed(importlib.import_module(f"benchmarks.faults.{family}").rows(campaign))


def _beside(families: Sequence[str], campaign: Campaign, jobs: int) -> Iterator[Row]:
    """Rows of families that run in processes of their own, ``jobs`` at a time, in the order of the families; then of
    those with failures once more, alone."""
    with tempfile.TemporaryDirectory(prefix="faults-") as name:
        with ThreadPoolExecutor(jobs) as pool:
            found = pool.map(lambda family: _one(family, campaign, Path(name) / f"{family}.json"), families)
            beside = dict(zip(families, found, strict=True))
        for family, rows in beside.items():
            failed = [row for row in rows if row.failures]
            if failed:
                print(f"{family}: {len(failed)} rows failed beside other families, tried again alone", flush=True)
                for row in failed:
                    print(f"  {told(row)}", flush=True)
                rows = _one(family, campaign, Path(name) / f"{family}-again.json")
            yield from rows


def _one(family: str, campaign: Campaign, result: Path) -> list[Row]:
    """The rows of one family; a family that ends without them is a failed row."""
    options = ["--share", str(campaign.share), "--seed", str(campaign.seed), "-o", str(result)]
    command = [sys.executable, "-m", "benchmarks.faults", "--only", family, *options]
    process = subprocess.run(command, capture_output=True, text=True, check=False)
    if not result.exists():
        return [Row(family, "the family runs to its end", trials=1, failures=[process.stderr[-1000:]])]
    return [Row(**row) for row in json.loads(result.read_text())["rows"]]


if __name__ == "__main__":
    sys.exit(main())
