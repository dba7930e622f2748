"""How much each threshold of the verdict matters: right and wrong claims at half and at twice its value.

    python benchmarks/blind/thresholds.py CASES KEY -o out/thresholds.md

Every case is fitted once and decided many times. ``CASES`` is a folder made by ``acquire gap blind make``, ``KEY`` its
key. A threshold that moves nothing on fresh cases is one too many.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path

from threadpoolctl import threadpool_limits

from acquire.recording import load
from gap.batch import session_paths
from gap.blind.answers import load as load_truths
from gap.data.checks import in_order
from gap.data.pauses import without_pauses
from gap.decision.settle import Case, believed, settle
from gap.decision.thresholds import INSTRUMENT, Thresholds, provenance
from gap.diagnosis import EFFORTS, Options, gathered
from gap.search.compare import Effort

NOT_ASKED = ("coverage", "surrogate")
"""Thresholds on which no verdict depends here."""


def outcome(case: Case, truth: tuple[str, ...], t: Thresholds) -> tuple[bool, bool]:
    """Whether the right class is claimed, and whether a wrong one is."""
    verdict = settle(believed(case, t)[0], t).verdict
    if not verdict.claims:
        return False, False
    right = bool(truth) and set(truth) <= {n for name in verdict.causes[0].names for n in name.split(" + ")}
    return right, not right


def variants() -> Iterator[tuple[str, str, Thresholds]]:
    """Threshold, factor and thresholds with it; probabilities stay below one."""
    yield "", "as stated", INSTRUMENT
    for name in (f.name for f in fields(Thresholds) if f.name not in NOT_ASKED):
        value = getattr(INSTRUMENT, name)
        for word, factor in (("half", 0.5), ("twice", 2.0)):
            moved = value * factor
            if provenance()[name]["unit"] == "probability":
                moved = min(moved, 0.999 if value > 0.9 else 0.9)
            yield name, word, replace(INSTRUMENT, **{name: moved})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("keys", type=Path, nargs="+")
    parser.add_argument("-o", "--output", type=Path, help="file for the table (default: stdout)")
    options = parser.parse_args()
    truths = {c.name: c.effects for c in load_truths(options.cases, options.keys)}
    counts: dict[tuple[str, str], list[int]] = {}
    cases = 0
    with threadpool_limits(limits=1):
        for folder in sorted(p for p in options.cases.iterdir() if p.name in truths):
            recordings = without_pauses(in_order([load(p) for p in session_paths(folder)]))
            case, _ = gathered(recordings, Options(effort=EFFORTS.get(recordings[0].info.instrument, Effort())))
            cases += 1
            print(f"{cases}/{len(truths)} {folder.name}", file=sys.stderr, flush=True)
            for name, word, t in variants():
                right, wrong = outcome(case, truths[folder.name], t)
                sums = counts.setdefault((name, word), [0, 0])
                sums[0] += right
                sums[1] += wrong
    text = table(counts, cases)
    if options.output:
        options.output.parent.mkdir(parents=True, exist_ok=True)
        options.output.write_text(text, encoding="utf-8")
    else:
        print(text, end="")


def table(counts: dict[tuple[str, str], list[int]], cases: int) -> str:
    """The counts as a table in Markdown."""
    right, wrong = counts["", "as stated"]
    lines = [f"{cases} cases: {right} right claims and {wrong} wrong ones as stated.", ""]
    lines += ["| threshold | value | right / wrong at half | at twice |", "|---|---|---|---|"]
    for name in dict.fromkeys(n for n, _ in counts if n):
        cells = [f"{counts[name, word][0]} / {counts[name, word][1]}" for word in ("half", "twice")]
        moved = any(counts[name, word] != [right, wrong] for word in ("half", "twice"))
        shown = f"**{name}**" if moved else name
        lines.append(f"| {shown} | {getattr(INSTRUMENT, name):g} {provenance()[name]['unit']} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
