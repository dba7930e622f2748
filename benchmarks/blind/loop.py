"""The closed loop on blind cases: figures after 0, 1, 2 and 3 experiments, for our choice, chance and a fixed order.

    python benchmarks/blind/loop.py --tiers T2 T3 --n 40 --seed 7 --cases 6 --workers 2 -o out/loop
    python benchmarks/blind/loop.py --n 20 --seed 907 --instrument microrobot --qualification with

Cases have no reference recordings (or the standard set, with ``--references standard``; with ``--qualification`` the
loop begins with skin alone, with or without a qualification by the standard set on the same rig). An effect that no
observer could see tells nothing of a choice, and a case that is claimed from its session alone asks for nothing: every
visible case (δ_free of ``--least`` at least, by the key) is diagnosed, in the key's order, until ``--cases`` of a tier
are not claimed; these go through every policy, up to the first claim or ``--most`` experiments. Policies that ask for
the same share answer and report, seconds included. Reports are kept: a run that was broken off goes on where
it stopped; ``--only-figures`` runs nothing. By ``--record``, the tables also go to ``loop.json`` and ``loop.md``
in another folder.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gap.batch import QUALIFICATIONS
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
ALONE = "alone"
"""Folder of the reports on sessions alone, beside those of the policies."""
RATIO = "≤ 60 % of a random choice"


def figures(cases: Sequence[Case], costs: Sequence[Sequence[dict[str, Any]]], k: int) -> dict[str, float | None]:
    """Figures after ``k`` experiments, None of no case; ``costs`` are each case's steps."""
    claims = [c for c in cases if c.claims]
    return {
        "right class first": _mean(_first, cases),
        "right and claimed": _mean(_claimed, cases),
        "right among claims": _mean(_first, claims) if claims else None,
        "stage": _mean(_stage_right, cases),
        "in the set": _mean(lambda c: bool(c.covered), cases),
        "names in the set": _mean(lambda c: len(c.report.chosen or ()), [c for c in cases if c.report is not None]),
        "minutes of bench time so far": _mean(lambda steps: sum(s["minutes"] for s in steps[:k]), costs),
        "CPU seconds of this step": _mean(lambda steps: sum(steps[k]["seconds"].values()) if steps[k:] else 0.0, costs),
    }


def _mean(of: Callable[[Any], float], each: Iterable[Any]) -> float:
    return float(np.mean([of(one) for one in each]))


def _first(case: Case) -> bool:
    return case.hit(1)


def _claimed(case: Case) -> bool:
    return case.claims and case.hit(1)


def _stage_right(case: Case) -> bool:
    places = case.report.where if case.report else []
    return bool(places) and max(places, key=lambda p: p.probability).stage in case.stages


def needed(after: Sequence[Sequence[Case]]) -> float:
    """Experiments until the right class is claimed, mean over cases; where it never is, one more than were done."""
    counts = []
    for case in zip(*after, strict=True):
        right = [k for k, c in enumerate(case) if _claimed(c)]
        counts.append(right[0] if right else len(case))
    return float(np.mean(counts))


Named = tuple[str, str]
"""Tier and name of a case."""


def table(root: Path, policy: str, named: Sequence[Named], most: int) -> dict[str, Any]:
    """Figures of cases, by number of experiments; ``needed`` beside them, and each case with its experiments."""
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
         "right": [_claimed(x) for x in case],
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
        if "over all" in t:
            shares = ", ".join(f"{v:.2f}" for v in t["over all"])
            lines += ["", f"Right class first of all visible cases, claimed ones included, after 0, 1 …: {shares}."]
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


@dataclass(frozen=True)
class Work:
    """A case to be run, and how; ``policy`` '' is the diagnosis of its session alone."""

    root: Path
    tier: str
    name: str
    policy: str
    most: int
    seed: int
    quick: bool
    qualification: str

    @property
    def out(self) -> Path:
        """The folder of its reports."""
        return self.root / f"{self.tier}-{self.policy or ALONE}"

    def run(self) -> None:
        most = self.most if self.policy else 0
        loop_case(
            self.root / self.tier / self.name, self.out, self.policy or "fixed", most, self.seed, "", 1, self.quick,
            self.root / "shared" / self.tier, True, self.qualification,
        )  # fmt: skip


def run_cases(works: Sequence[Work]) -> str:
    """Do the work on one case in this process: its tier and name."""
    for work in works:
        work.run()
    return f"{works[0].tier} {works[0].name}"


def undecided(root: Path, tier: str, names: Sequence[str], wanted: int) -> tuple[list[Case], list[str]]:
    """Of the cases that have been diagnosed, in the order of ``names``: all up to the last one ``wanted``, and the
    names of those that are not claimed."""
    out = root / f"{tier}-{ALONE}"
    had = [n for n in names if (out / "0" / f"{n}.json").exists()]
    by_name = {c.name: c for c in answered(out, 0, key_of(root / tier), only=had)} if had else {}
    seen: list[Case] = []
    left: list[str] = []
    for name in had:
        if len(left) == wanted:
            break
        seen.append(by_name[name])
        if not by_name[name].claims:
            left.append(name)
    return seen, left


def over_all(seen: Sequence[Case], table: dict[str, Any]) -> list[float]:
    """Share of all visible cases, claimed ones included, whose right class is first after 0, 1, 2 … experiments."""
    claimed = [c.hit(1) for c in seen if c.claims]
    return [(sum(claimed) + row["right class first"] * table["n"]) / (len(claimed) + table["n"])
            for row in table["after"]]  # fmt: skip


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tiers", nargs="+", default=["T2", "T3"], choices=TIERS, metavar="TIER")
    parser.add_argument("--n", type=int, default=40, help="cases made of each tier")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--least", type=float, default=5.0, help="delta_free of a visible case")
    parser.add_argument("--most", type=int, default=3, help="experiments of a case")
    parser.add_argument("--cases", type=int, default=6, help="unclaimed cases of a tier that are run at most")
    parser.add_argument("--instrument", nargs="+", default=list(INSTRUMENTS), choices=INSTRUMENTS, metavar="NAME")
    parser.add_argument("--policy", nargs="+", default=list(POLICIES), choices=list(POLICIES), metavar="POLICY")
    parser.add_argument("--references", default="none", choices=REFERENCES)
    parser.add_argument("--qualification", default="", choices=QUALIFICATIONS)
    parser.add_argument("--style", default="wide", choices=STYLES)
    parser.add_argument("--workers", type=int, default=1, help="processes, each at another case")
    parser.add_argument("--quick", action="store_true", help="quick diagnoses: few effects are fitted, and no pairs")
    parser.add_argument("--only-figures", action="store_true", help="of the reports that are there; run nothing")
    parser.add_argument("--record", type=Path, help="folder that also gets loop.json and loop.md")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/loop"))
    given = parser.parse_args()
    if given.qualification:
        given.references = "standard"
    return given


def work_on(given: argparse.Namespace, chosen: dict[str, list[str]], tell: Callable[[str], None]) -> None:
    """Diagnose visible cases until enough are not claimed, then let every policy go on with these."""

    def work(tier: str, name: str, policy: str) -> Work:
        return Work(given.output, tier, name, policy, given.most, given.seed, given.quick, given.qualification)

    with ProcessPoolExecutor(given.workers) as pool:
        for tier, names in chosen.items():
            for at in range(0, len(names), given.workers):
                if len(undecided(given.output, tier, names[:at], given.cases)[1]) >= given.cases:
                    break
                batch = [[work(tier, n, "")] for n in names[at : at + given.workers]]
                for done in pool.map(run_cases, batch):
                    tell(f"diagnosed {done}")
        todo = [
            [work(tier, n, policy) for policy in given.policy]
            for tier, names in chosen.items()
            for n in undecided(given.output, tier, names, given.cases)[1]
        ]
        for number, done in enumerate(pool.map(run_cases, todo)):
            tell(f"{number + 1}/{len(todo)} {done}")


def drawn_and_made(given: argparse.Namespace) -> dict[str, list[str]]:
    """The visible cases of each tier, by name; tiers that are not there yet are made."""
    for tier in given.tiers:
        folder = given.output / tier
        if not folder.exists():
            make(tier, given.n, given.seed, folder, given.instrument, style=given.style, references=given.references)
    return {tier: visible(key_of(given.output / tier), given.least, nothing=False) for tier in given.tiers}


def described(given: argparse.Namespace, chosen: Mapping[str, Sequence[str]], seen: Sequence[Case], left: int) -> str:
    """The cases in words: how many were ``chosen`` by tier, ``seen`` (diagnosed), and ``left`` to every policy."""
    counts = ", ".join(f"{len(names)} of {given.n} {tier}" for tier, names in chosen.items())
    qualified = f", skin alone, {given.qualification} a qualification" if given.qualification else ""
    quick = ", quick diagnoses" if given.quick else ""
    claimed = [c for c in seen if c.claims]
    return (
        f"{given.style} style, seed {given.seed}, {', '.join(given.instrument)}, references {given.references}"
        f"{qualified}{quick}. Cases with delta_free >= {given.least:g}, by the key: {counts}. "
        f"Of these {len(seen)} were diagnosed, {sum(map(_first, seen))} with the right class first: "
        f"{len(claimed)} were claimed from their session alone, "
        f"{sum(map(_first, claimed))} of them rightly, and are not asked about again; {left} of the others "
        "went through every policy, up to the first claim. The tables are of these."
    )


def main() -> None:
    given = arguments()
    root, chosen = given.output, drawn_and_made(given)
    if not given.only_figures:
        work_on(given, chosen, lambda text: print(text, file=sys.stderr, flush=True))
    found_alone = {tier: undecided(root, tier, names, given.cases) for tier, names in chosen.items()}
    done = [case for t, (_, left) in found_alone.items() for case in finished(root, t, given.policy, left, given.most)]
    if not done:
        sys.exit("no case has been through every policy")
    seen = [c for cases, _ in found_alone.values() for c in cases]
    found = {policy: table(root, policy, done, given.most) for policy in given.policy}
    for one in found.values():
        one["over all"] = over_all(seen, one)
    drawn = described(given, chosen, seen, len(done))
    text = as_markdown(drawn, found)
    print(text)
    for folder, stem in [(root, "figures")] + ([(given.record, "loop")] if given.record else []):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{stem}.md").write_text(text, encoding="utf-8")
        (folder / f"{stem}.json").write_text(json.dumps({"drawn": drawn, "found": found}, indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    main()
