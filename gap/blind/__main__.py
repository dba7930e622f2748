"""``python -m gap.blind make|score``: the blind check without the rest of the application."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from .cases import make
from .laboratory import STYLES
from .rig import REFERENCES, perform
from .scoring import score
from .vocabulary import INSTRUMENTS


def main(arguments: list[str] | None = None) -> int:
    """Run a command; returns the exit status (0 done, 2 bad input)."""
    parser = argparse.ArgumentParser(prog="gap.blind", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    m = commands.add_parser("make", help="write anonymous cases and their sealed key")
    m.add_argument("--tier", required=True)
    m.add_argument("--n", type=int, required=True)
    m.add_argument("--seed", type=int, required=True)
    m.add_argument("-o", "--out", type=Path, required=True)
    m.add_argument("--instrument", action="append", choices=INSTRUMENTS, help="may be repeated (default: all)")
    m.add_argument("--passphrase", default="")
    m.add_argument("--style", choices=STYLES, default="wide", help="laboratories as they differ, or the README's one")
    m.add_argument("--references", choices=REFERENCES, default="some", help="reference recordings of a case")
    a = commands.add_parser("answer", help="do an experiment on a case's hidden rig")
    a.add_argument("case", type=Path)
    a.add_argument("experiment", type=Path)
    a.add_argument("-o", "--out", type=Path, required=True)
    a.add_argument("--passphrase", default="")
    s = commands.add_parser("score", help="compare reports with the sealed keys")
    s.add_argument("reports", type=Path)
    s.add_argument("key", type=Path, nargs="+")
    s.add_argument("--passphrase", default="")
    s.add_argument("--json", type=Path, help="write the figures to this file too")
    given = parser.parse_args(arguments)
    try:
        if given.command == "make":
            key = make(given.tier, given.n, given.seed, given.out, given.instrument or INSTRUMENTS, given.passphrase,
                       style=given.style, references=given.references)  # fmt: skip
            print(f"{given.n} cases in {given.out}, key in {key}")
        elif given.command == "answer":
            print(perform(given.case, given.experiment, given.out, given.passphrase))
        else:
            card = score(given.reports, given.key, given.passphrase)
            print(card.as_text())
            if given.json:
                given.json.write_text(json.dumps(card.as_json(), indent=1) + "\n")
    except (ValueError, OSError) as e:
        print(f"error: {e}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
