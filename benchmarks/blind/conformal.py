"""The thresholds of the conformal set, from reports on blind cases and their keys.

    python benchmarks/blind/run.py --tiers T2 T6 --n 12 --seed 41 -o out/blind
    python benchmarks/blind/conformal.py out/blind/reports out/blind/*-key/key.bin -o gap/decision/conformal.yaml

Prints how often a set made without a case holds what was hidden in it (leave one out), and how large it is.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
import yaml

from gap.blind.lock import unseal
from gap.decision.conformal import COVERAGE, PENALTY, Entry, Threshold, chosen, group, quantile, ranked, score


def cases(reports: Path, keys: list[Path], passphrase: str) -> list[tuple[str, list[Entry], list[str]]]:
    """Group, entries and truth of every case that has a report."""
    found = []
    for key in keys:
        for c in json.loads(unseal(key.read_bytes(), passphrase))["cases"]:
            path = reports / f"{c['case']}.json"
            if not path.exists():
                continue
            r = json.loads(path.read_text(encoding="utf-8"))
            entries: list[Entry] = [(x["probability"], tuple(x["class"])) for x in r["causes"]]
            entries += [(r["none_probability"], ("none",)), (r["outside_probability"], ("outside",))]
            truth = [h["concept"] for h in c["effects"]]
            found.append((group(c["instrument"], c["reference"]), entries, truth))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("reports", type=Path)
    parser.add_argument("keys", type=Path, nargs="+")
    parser.add_argument("--passphrase", default="")
    parser.add_argument("-o", "--output", type=Path, help="YAML file to write")
    given = parser.parse_args()
    found = cases(given.reports, given.keys, given.passphrase)
    if not found:
        sys.exit("no case has a report")
    scores = np.array([score(entries, truth) for _, entries, truth in found])
    groups = {"all": scores} | {
        g: scores[[k for k, f in enumerate(found) if f[0] == g]] for g in sorted({f[0] for f in found})
    }
    table = {g: {"n": len(s), "score": float(quantile(s.tolist()))} for g, s in groups.items()}
    for name, row in table.items():
        print(f"{name:<14} n = {row['n']:>4}  threshold {row['score']:.4f}")
    held, sizes = [], []
    for k, (_, entries, _truth) in enumerate(found):
        without = Threshold("all", len(found) - 1, quantile(np.delete(scores, k).tolist()))
        held.append(scores[k] <= without.score or scores[k] == ranked(entries)[0][0])
        sizes.append(len(chosen(entries, without)))
    print(
        f"leave one out: {np.mean(held):.2f} of {len(held)} sets hold the truth, mean size {np.mean(sizes):.1f} names"
    )
    if given.output:
        text = (
            "# Thresholds of the conformal set by group (an instrument; + with references): sessions, largest score.\n"
        )
        text += "# Made by: python benchmarks/blind/conformal.py (its docstring has the whole command).\n"
        body = {"coverage": COVERAGE, "penalty": PENALTY, "groups": table}
        given.output.write_text(text + yaml.safe_dump(body, sort_keys=False), encoding="utf-8")


if __name__ == "__main__":
    main()
