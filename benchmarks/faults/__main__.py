"""The fault campaign.

    python -m benchmarks.faults [--share 0.1] [--seed 1] [--only links,host] [-o RESULT.json] [--docs TABLE.md]

Faults of every kind, seeded, on simulated instruments in processes of their own; what happened to a person's skin is
asked of the instrument, never of the host. A table of trials, failures and the worst figure is printed row by row; the
exit status is 1 if a row has a failure. ``--share 1`` makes at least 100 trials a row and takes hours, 0.1 (what
continuous integration runs) minutes.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import time
from pathlib import Path

from benchmarks.faults.table import Campaign, Row, about, markdown, save, timed, told

#: In this order; each is a module here with a function ``rows``.
FAMILIES = ("links", "wire", "host", "disk", "readings", "bounds", "files", "fuzz", "hostile")


def main() -> int:
    """Run the campaign; exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.faults", description="The fault campaign.")
    parser.add_argument("--share", type=float, default=1.0, help="share of the full number of trials")
    parser.add_argument("--seed", type=int, default=1)
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
    for family in chosen:
        for row in timed(importlib.import_module(f"benchmarks.faults.{family}").rows(campaign)):
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


if __name__ == "__main__":
    sys.exit(main())
