"""The thresholds of the conformal set, from reports on blind cases and their keys.

    python benchmarks/blind/run.py --tiers T2 T3 T6 --n 60 --seed 41 -o out/blind
    python benchmarks/blind/conformal.py --of out/blind/reports out/blind/T2-41-key/key.bin \\
        --of out/blind/reports out/blind/T3-41-key/key.bin --of ... -o gap/decision/conformal.yaml

``--of`` names a folder of reports and the key of their cases; cases without a report are left out. Counted are cases
without an effect, and those whose effects an observer without the skin's law could see (δ_free of ``--least`` at
least): of what no one could see, a set holds nothing but `none`. Prints how often a set made without a case holds what
was hidden in it (leave one out), and how large it is.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import yaml

from gap.blind.lock import unseal
from gap.decision.conformal import (
    COVERAGE,
    FEWEST,
    NEGLIGIBLE,
    NEXT,
    PENALTY,
    Entry,
    Threshold,
    chosen,
    group,
    quantile,
    ranked,
    score,
    shares,
)

Found = tuple[str, str, list[Entry], list[str]]
"""Tier, group, entries and truth of a case."""


def cases(reports: Path, key: Path, least: float, passphrase: str) -> list[Found]:
    """The cases of a key that have a report."""
    found = []
    for c in json.loads(unseal(key.read_bytes(), passphrase))["cases"]:
        path = reports / f"{c['case']}.json"
        if not path.exists() or (c["effects"] and c["delta_free"] < least):
            continue
        r = json.loads(path.read_text(encoding="utf-8"))
        if "none_probability" in r:  # else the data could not be diagnosed
            classes = [(x["probability"], x["class"]) for x in r["causes"]]
            entries = shares(classes, r["none_probability"], r["outside_probability"])
            truth = [h["concept"] for h in c["effects"]]
            found.append((c["tier"], group(c["instrument"], c["reference"]), entries, truth))
    return found


def table(found: Sequence[Found]) -> tuple[dict[str, dict[str, float]], list[float]]:
    """Threshold and number of sessions of all and of each group; and the score of each case."""
    scores = [score(entries, truth) for _, _, entries, truth in found]
    groups = {"all": scores} | {
        g: [s for s, f in zip(scores, found, strict=True) if f[1] == g] for g in sorted({f[1] for f in found})
    }
    return {g: {"n": len(s), "score": round(float(quantile(s)), 4)} for g, s in groups.items()}, scores


def left_out(found: Sequence[Found], scores: Sequence[float]) -> tuple[list[bool], list[int]]:
    """For each case, whether a set by the other cases (of its group, if they are enough) holds the truth; its size."""
    held, sizes = [], []
    for k, (_, of, entries, _truth) in enumerate(found):
        every = [s for j, s in enumerate(scores) if j != k]
        own = [s for j, s in enumerate(scores) if j != k and found[j][1] == of]
        used = own if len(own) + 1 >= FEWEST else every
        without = Threshold(of, len(used), quantile(used))
        held.append(scores[k] <= without.score or scores[k] == ranked(entries)[0][0])
        sizes.append(len(chosen(entries, without)))
    return held, sizes


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--of", nargs=2, action="append", type=Path, required=True, metavar=("REPORTS", "KEY"))
    parser.add_argument("--least", type=float, default=5.0, help="delta_free of a case that is counted")
    parser.add_argument("--passphrase", default="")
    parser.add_argument("-o", "--output", type=Path, help="YAML file to write")
    given = parser.parse_args()
    found = [f for reports, key in given.of for f in cases(reports, key, given.least, given.passphrase)]
    if not found:
        sys.exit("no case has a report")
    groups, scores = table(found)
    for name, row in groups.items():
        print(f"{name:<14} n = {row['n']:>4}  threshold {row['score']:.4f}")
    held, sizes = left_out(found, scores)
    said = f"{np.mean(held):.2f} of {len(held)} sets hold the truth, mean size {np.mean(sizes):.1f} names"
    print(f"leave one out: {said}")
    for what in sorted({f[0] for f in found}):
        mine = [k for k, f in enumerate(found) if f[0] == what]
        print(
            f"  {what}: {np.mean([held[k] for k in mine]):.2f} of {len(mine)}, {np.mean([sizes[k] for k in mine]):.1f}"
        )
    if given.output:
        tiers = ", ".join(f"{n} {tier}" for tier, n in sorted(Counter(f[0] for f in found).items()))
        text = (
            "# Thresholds of the conformal set by group (an instrument; + with references): sessions, largest score.\n"
            "# Made by: python benchmarks/blind/conformal.py (its docstring has the whole command).\n"
            f"# Sessions: {tiers}, without an effect or with delta_free >= {given.least:g}. Leave one out:\n# {said}.\n"
        )
        body = {
            "coverage": COVERAGE, "penalty": PENALTY, "negligible": NEGLIGIBLE, "next": NEXT, "groups": groups
        }  # fmt: skip
        given.output.write_text(text + yaml.safe_dump(body, sort_keys=False), encoding="utf-8")


if __name__ == "__main__":
    main()
