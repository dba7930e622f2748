"""The closed loop on blind cases: figures after 0, 1, 2 and 3 experiments, for our choice, chance and a fixed order.

    python benchmarks/blind/loop.py --tiers T2 T3 --n 100 --seed 7 -o out/loop
    python benchmarks/blind/loop.py --n 40 --seed 907 --instrument cutometer --record benchmarks/results

Cases have no reference recordings (or the standard set, with ``--references standard``). An effect that no observer
could see tells nothing of a choice: only cases with δ_free of ``--least`` at least are run, which the key says; the
output counts the others. All policies go on from one diagnosis of a case's session, and stop once a cause is certain. A
case that has its reports is not run again, so that a run can go on where it was broken off; ``--only-figures`` runs
none. By ``--record``, what is printed also goes to ``loop.json`` and ``loop.md`` in another folder.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from gap.blind import make
from gap.blind.answers import Case, visible
from gap.blind.cases import TIERS
from gap.blind.laboratory import STYLES
from gap.blind.rig import REFERENCES
from gap.blind.vocabulary import INSTRUMENTS
from gap.loop.blind import STEPS, answered, key_of, loop_case
from gap.loop.policies import POLICIES

TARGETS = {
    "right class first": "≥ .80 after 0, ≥ .97 after 3", "stage": "≥ .90 after 0, ≥ .97 after 3",
    "right among claims": "≥ .95", "in the set": ".88–.95", "names in the set": "≤ 2",
}  # fmt: skip
RATIO = "≤ 60 % of a random choice"


def figures(cases: Sequence[Case], costs: Sequence[Sequence[dict[str, Any]]], k: int) -> dict[str, float | None]:
    """Figures after ``k`` experiments, None of no case; ``costs`` are each case's steps."""
    claims = [c for c in cases if c.claims]
    reports = [c.report for c in cases if c.report is not None]
    minutes = [sum(s["minutes"] for s in steps[:k]) for steps in costs]
    seconds = [sum(steps[k]["seconds"].values()) if k < len(steps) else 0.0 for steps in costs]
    return {
        "right class first": float(np.mean([c.hit(1) for c in cases])),
        "right and claimed": float(np.mean([c.claims and c.hit(1) for c in cases])),
        "right among claims": float(np.mean([c.hit(1) for c in claims])) if claims else None,
        "stage": float(np.mean([_stage_right(c) for c in cases])),
        "in the set": float(np.mean([bool(c.covered) for c in cases])),
        "names in the set": float(np.mean([len(r.chosen or ()) for r in reports])),
        "minutes of bench time so far": float(np.mean(minutes)),
        "CPU seconds of this step": float(np.mean(seconds)),
    }


def _stage_right(case: Case) -> bool:
    places = case.report.where if case.report else []
    return bool(places) and max(places, key=lambda p: p.probability).stage in case.stages


def needed(after: Sequence[Sequence[Case]]) -> float:
    """Experiments until the right class is claimed, mean over cases; where it never is, one more than were done."""
    counts = []
    for case in zip(*after, strict=True):
        right = [k for k, c in enumerate(case) if c.claims and c.hit(1)]
        counts.append(right[0] if right else len(case))
    return float(np.mean(counts))


Named = tuple[str, str]
"""Tier and name of a case."""


def table(root: Path, policy: str, named: Sequence[Named], most: int) -> dict[str, Any]:
    """Figures of cases, by number of experiments; ``needed`` beside them, and each case with what was asked for."""
    tiers = dict.fromkeys(tier for tier, _ in named)
    only = {tier: [n for t, n in named if t == tier] for tier in tiers}
    after = [
        [c for t in tiers for c in answered(root / f"{t}-{policy}", k, key_of(root / t), only=only[t])]
        for k in range(most + 1)
    ]
    costs = [
        json.loads((root / f"{c.tier}-{policy}" / STEPS / f"{c.name}.json").read_text(encoding="utf-8"))
        for c in after[0]
    ]
    each = [
        {"case": c.name, "effects": list(c.effects), "delta_free": round(c.delta_free or 0.0, 1),
         "right": [x.claims and x.hit(1) for x in case],
         "asked": [f"{s['waveform']} on {s['specimen']}" for s in steps if s["specimen"]]}
        for c, case, steps in zip(after[0], zip(*after, strict=True), costs, strict=True)
    ]  # fmt: skip
    rows = [figures(cases, costs, k) for k, cases in enumerate(after)]
    return {"n": len(named), "needed": needed(after), "after": rows, "cases": each}


def finished(root: Path, tier: str, policies: Sequence[str], names: Sequence[str], most: int) -> list[Named]:
    """Cases that every one of the policies has been through: only these can be compared."""
    through = [n for n in names if all((root / f"{tier}-{p}" / str(most) / f"{n}.json").exists() for p in policies)]
    return [(tier, n) for n in through]


def as_markdown(drawn: str, found: dict[str, dict[str, Any]]) -> str:
    """The tables by policy, beside the targets."""
    lines = ["# The closed loop", "", drawn, ""]
    for policy, t in found.items():
        header = "| figure | " + " | ".join(f"after {k}" for k in range(len(t["after"]))) + " | target |"
        lines += [f"## {policy}", "", header, "|---" * (len(t["after"]) + 2) + "|"]
        for figure in t["after"][0]:
            cells = " | ".join("–" if row[figure] is None else f"{row[figure]:.2f}" for row in t["after"])
            lines.append(f"| {figure} | {cells} | {TARGETS.get(figure, '')} |")
        lines += [
            "",
            f"Experiments until the right class is claimed: {t['needed']:.2f} (mean; never: one more than done)",
        ]
        random = found.get("random")
        if policy == "ours" and random and random["needed"]:
            lines.append(f"That is {100 * t['needed'] / random['needed']:.0f} % of a random choice's; target {RATIO}.")
        lines += [
            "",
            "| case | hidden | δ_free | claimed and right after 0, 1 … | asked for |",
            "|---|---|---|---|---|",
        ]
        for c in t["cases"]:
            right = ", ".join("yes" if r else "no" for r in c["right"])
            hidden, asked = " + ".join(c["effects"]), "; ".join(c["asked"])
            lines.append(f"| {c['case']} | {hidden} | {c['delta_free']} | {right} | {asked} |")
        lines.append("")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tiers", nargs="+", default=["T2", "T3"], choices=TIERS, metavar="TIER")
    parser.add_argument("--n", type=int, default=100, help="cases for each tier, of which the visible ones are run")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--least", type=float, default=3.0, help="delta_free of a visible case")
    parser.add_argument("--most", type=int, default=3, help="experiments of a case")
    parser.add_argument("--cases", type=int, default=10**6, help="how many visible cases of a tier are run at most")
    parser.add_argument("--instrument", nargs="+", default=list(INSTRUMENTS), choices=INSTRUMENTS, metavar="NAME")
    parser.add_argument("--policy", nargs="+", default=list(POLICIES), choices=list(POLICIES), metavar="POLICY")
    parser.add_argument("--references", default="none", choices=REFERENCES)
    parser.add_argument("--style", default="wide", choices=STYLES)
    parser.add_argument("--jobs", type=int, default=1, help="processes that share a case's fits")
    parser.add_argument("--quick", action="store_true", help="quick diagnoses: few effects are fitted, and no pairs")
    parser.add_argument("--only-figures", action="store_true", help="of what has been run; run nothing")
    parser.add_argument("--record", type=Path, help="folder that also gets loop.json and loop.md")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/loop"))
    given = parser.parse_args()
    root, chosen = given.output, {}
    for tier in given.tiers:
        if not (root / tier).exists():
            make(
                tier, given.n, given.seed, root / tier, given.instrument, style=given.style, references=given.references
            )
        chosen[tier] = visible(key_of(root / tier), given.least, nothing=False)[: given.cases]
    rows = zip_longest(*([(tier, name) for name in names] for tier, names in chosen.items()))  # tiers in turn
    todo = [case for row in rows for case in row if case is not None]
    for number, (tier, name) in enumerate(todo if not given.only_figures else []):
        for policy in given.policy:
            out, alone = root / f"{tier}-{policy}", root / f"{tier}-alone"
            loop_case(root / tier / name, out, policy, given.most, given.seed, "", given.jobs, given.quick, alone)
        print(f"{number + 1}/{len(todo)} {tier} {name}", file=sys.stderr, flush=True)
    done = [c for tier, names in chosen.items() for c in finished(root, tier, given.policy, names, given.most)]
    if not done:
        sys.exit("no case has been through every policy")
    found = {policy: table(root, policy, done, given.most) for policy in given.policy}
    counts = ", ".join(f"{len(names)} of {given.n} {tier}" for tier, names in chosen.items())
    drawn = (
        f"{given.style} style, seed {given.seed}, {', '.join(given.instrument)}, references {given.references}"
        f"{', quick diagnoses' if given.quick else ''}. Cases with delta_free >= {given.least:g}, by the key: {counts};"
        f" of these {len(done)} have been run with every policy. "
        "Seconds after 0 experiments, but for the choice, count with the policy that came first."
    )
    text = as_markdown(drawn, found)
    print(text)
    for folder, stem in [(root, "figures")] + ([(given.record, "loop")] if given.record else []):
        (folder / f"{stem}.md").write_text(text, encoding="utf-8")
        (folder / f"{stem}.json").write_text(json.dumps({"drawn": drawn, "found": found}, indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    main()
