"""The closed loop on blind cases: figures after 0, 1, 2 and 3 experiments, for our choice, chance and a fixed order.

    python benchmarks/blind/loop.py --tiers T2 T3 --n 100 --seed 7 -o out/loop

Cases have no reference recordings (or the standard set, with ``--references standard``). A case that has its reports
is not run again, so that a run can go on where it was broken off.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from gap.blind import make
from gap.blind.cases import TIERS
from gap.blind.laboratory import STYLES
from gap.blind.rig import REFERENCES
from gap.blind.vocabulary import INSTRUMENTS
from gap.loop.blind import as_text, loop_cases
from gap.loop.policies import POLICIES


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tiers", nargs="+", default=["T2", "T3"], choices=TIERS, metavar="TIER")
    parser.add_argument("--n", type=int, default=100, help="cases for each tier")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--most", type=int, default=3, help="experiments of a case")
    parser.add_argument("--instrument", nargs="+", default=list(INSTRUMENTS), choices=INSTRUMENTS, metavar="NAME")
    parser.add_argument("--policy", nargs="+", default=list(POLICIES), choices=list(POLICIES), metavar="POLICY")
    parser.add_argument("--references", default="none", choices=REFERENCES)
    parser.add_argument("--style", default="wide", choices=STYLES)
    parser.add_argument("--jobs", type=int, default=1, help="processes that share a case's fits")
    parser.add_argument("--quick", action="store_true", help="quick diagnoses: few effects are fitted, and no pairs")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/loop"))
    given = parser.parse_args()
    drawn = f"{given.style} style, seed {given.seed}, {given.n} cases a tier, {', '.join(given.instrument)}"
    lines = [f"{drawn}, references {given.references}{', quick diagnoses' if given.quick else ''}"]
    figures = {}
    for tier in given.tiers:
        cases = given.output / tier
        if not cases.exists():
            make(tier, given.n, given.seed, cases, given.instrument, style=given.style, references=given.references)
        for policy in given.policy:
            out = given.output / f"{tier}-{policy}"
            found = loop_cases(cases, out, policy, given.most, given.seed, "", given.jobs, given.quick)
            figures[f"{tier} {policy}"] = found
            lines += ["", f"{tier}, {policy}", as_text(found)]
            text = "\n".join(lines) + "\n"
            (given.output / "figures.txt").write_text(text, encoding="utf-8")
    (given.output / "figures.json").write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
