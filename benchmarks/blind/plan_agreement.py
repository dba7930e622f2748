"""Does `gap plan` foretell the blind check's confusions?

    python benchmarks/blind/plan_agreement.py out/blind --tiers T2 T3

For every case with one hidden effect of δ ≥ 5 in which an effect is claimed: the case's own set-points are simulated on
the nominal instrument, before any look at its data, and every other effect is ranked by how well it could imitate the
hidden one (`gap.design.plan.likeness`). Printed is where the effects stand that the diagnosis then named in place of
the hidden one, or beside it in one class, against where they would stand by chance.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from acquire.recording import load
from acquire.recording.model import Recording
from gap.batch import session_paths
from gap.blind.answers import Case
from gap.blind.answers import load as load_cases
from gap.design import plan
from gap.design import simulated as own
from gap.effects.load import library
from gap.inference.evidence import Hypothesis
from gap.inference.least_squares import fit


def legs(recordings: Sequence[Recording]) -> list[own.Leg]:
    """The commands, and their specimens."""
    out = []
    for r in recordings:
        tables = {q: (np.asarray(s.time, float), np.asarray(s.value, float)) for q, s in r.setpoints.items()}
        begin = min(t[0] for t, _ in tables.values())
        end = max(t[-1] for t, _ in tables.values())
        moved = {q: (t - begin, v) for q, (t, v) in tables.items()}
        out.append(own.Leg(moved, float(end - begin), r.info.specimen or "skin", r.info.repeat))
    return out


def foretold(folder: Path, hidden: str) -> dict[str, float]:
    """Effect -> how well it could imitate ``hidden`` in a case's session, 0 to 1."""
    recordings = [load(p) for p in session_paths(folder)]
    instrument = recordings[0].info.instrument
    rng = np.random.default_rng(1)
    if instrument == "microrobot":
        made = own.robot_session(rng, legs=legs(recordings), scatter=0.0)
    else:
        made = own.suction_session(instrument, rng, legs=legs(recordings), scatter=0.0)
    problems, candidates = plan.build(made, library(instrument))
    blocks = {p.name: p for p in problems}
    null = Hypothesis((), {name: fit(p, iterations=10) for name, p in blocks.items()})
    traces = plan.traces(blocks, null, candidates)
    mine = [t for t in traces if t.candidate.name == hidden]
    out: dict[str, float] = {}
    for t in traces:
        name = t.candidate.name
        if name != hidden:
            out[name] = max(out.get(name, 0.0), *(plan.likeness(t, m) for m in mine)) if mine else 0.0
    return out


def confused(case: Case) -> set[str]:
    """Effects claimed with the hidden one in one class, or in its place; nothing where nothing is claimed."""
    if case.report is None or case.verdict not in ("effect", "several"):
        return set()
    named = case.report.ranked[0].names
    return {part for name in named for part in name.split(" + ")} - set(case.effects)


def main() -> None:
    """Print the agreement."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path, help="folder that run.py wrote")
    parser.add_argument("--tiers", nargs="+", default=["T2", "T3"], metavar="TIER")
    given = parser.parse_args()
    ranks, chance = [], []
    for key in sorted(p for tier in given.tiers for p in given.output.glob(f"{tier}-*-key/key.bin")):
        cases = key.parent.with_name(key.parent.name.removesuffix("-key"))
        for case in load_cases(given.output / "reports", [key]):
            others = confused(case)
            if len(case.effects) != 1 or case.delta < 5 or not others:
                continue
            likenesses = foretold(cases / case.name, case.effects[0])
            order = sorted(likenesses, key=lambda e: -likenesses[e])
            at = [order.index(e) / max(len(order) - 1, 1) for e in others if e in order]
            ranks += at
            chance.append(len(order))
            print(f"{case.name} {case.effects[0]}: " + ", ".join(f"{e} {likenesses.get(e, 0):.2f}" for e in others))
    if not ranks:
        print("no confusion among the diagnosed cases")
        return
    better = float(np.mean([1.0 - r for r in ranks]))
    top = float(np.mean([r <= 0.25 for r in ranks]))
    print(f"{len(ranks)} confusions in {len(chance)} cases, among {np.mean(chance):.0f} other effects each")
    print(f"an effect that was confused is likelier a priori than another one: {better:.2f} (chance 0.50)")
    print(f"it is among the likeliest quarter: {top:.2f} (chance 0.25)")


if __name__ == "__main__":
    main()
