"""The blind check in full: fresh cases of every tier, their diagnosis, and every figure beside its target.

    python benchmarks/blind/run.py --n 100 --seed 2027 --jobs 2 -o out/blind
    python benchmarks/blind/run.py --tiers T2 T3 --n 300 --instrument cutometer
    python benchmarks/blind/run.py --tiers T2 T3 --n 200 --least 5 --references standard
    python benchmarks/blind/run.py --tiers T2 T3 --n 50 --least 5 --qualification with
    python benchmarks/blind/run.py --tiers T2 T6 --n 14 --seed 7 8 --record benchmarks/results

Cases and reports stay in the folder: a run that was broken off goes on where it stopped, and reports made before are
not made again. The figures also go to ``figures.txt`` and ``figures.json``, and by ``--record`` to ``blind_*`` in
another folder.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from itertools import product
from pathlib import Path

from gap.batch import QUALIFICATIONS, diagnose_cases
from gap.blind import Scorecard, make, score
from gap.blind.answers import visible
from gap.blind.laboratory import STYLES
from gap.blind.rig import REFERENCES
from gap.blind.vocabulary import INSTRUMENTS
from gap.design.simulated_cases import make_own

TIERS = ("T0", "T1", "T2", "T3", "T4", "T5", "T6")


def run(
    output: Path,
    tiers: list[str],
    n: int,
    seeds: Sequence[int],
    instruments: list[str],
    jobs: int,
    style: str,
    references: str = "some",
    least: float = 0.0,
    qualification: str = "",
) -> Scorecard:
    """Make what is missing of the ``n`` cases for each of ``seeds`` and ``tiers``, diagnose what has no report, score
    all whose δ_free is ``least`` or more, and those that hide nothing."""
    reports = output / "-".join(["reports", *([qualification] if qualification else [])])
    keys = []
    for seed, tier in product(seeds, tiers):
        cases, key = output / f"{tier}-{seed}", output / f"{tier}-{seed}-key" / "key.bin"
        if not key.exists():
            begin = time.perf_counter()
            if tier == "T0":
                make_own(n, seed, cases, "", instruments)
            else:
                make(tier, n, seed, cases, instruments, style=style, references=references)
            print(f"{tier}: {n} cases made in {time.perf_counter() - begin:.0f} s", file=sys.stderr, flush=True)
        begin = time.perf_counter()
        only = visible(key, least) if least else None
        diagnose_cases(cases, reports, jobs, only, qualification)
        print(f"{tier}: diagnosed in {time.perf_counter() - begin:.0f} s", file=sys.stderr, flush=True)
        keys.append(key)
    return score(reports, keys, least=least)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tiers", nargs="+", default=list(TIERS), choices=TIERS, metavar="TIER", help="T0 ... T6")
    parser.add_argument("--n", type=int, default=100, help="cases for each tier and seed")
    clock = [int(time.time())]
    parser.add_argument("--seed", nargs="+", type=int, default=clock, help="of the sets (default: the clock, so fresh)")
    parser.add_argument("--instrument", nargs="+", default=list(INSTRUMENTS), choices=INSTRUMENTS, metavar="NAME")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--style", choices=STYLES, default="wide", help="laboratories as they differ, or one of them")
    parser.add_argument("--references", choices=REFERENCES, default="some", help="recordings on reference specimens")
    parser.add_argument("--least", type=float, default=0.0, metavar="DELTA", help="δ_free of the cases that are run")
    parser.add_argument(
        "--qualification", choices=QUALIFICATIONS, default="",
        help="diagnose skin alone, with or without a qualification by the standard references of the same rig",
    )  # fmt: skip
    parser.add_argument("-o", "--output", type=Path, default=Path("out/blind"))
    parser.add_argument("--record", type=Path, help="folder for the figures, beside the command that made them")
    given = parser.parse_args()
    if given.qualification:
        given.references = "standard"
    card = run(
        given.output, given.tiers, given.n, given.seed, given.instrument, given.jobs, given.style, given.references,
        given.least, given.qualification,
    )  # fmt: skip
    seeds = ", ".join(map(str, given.seed))
    drawn = f"{given.style} style, references: {given.references}, seed {seeds}, {given.n} cases of each of "
    drawn += ", ".join(given.tiers) + (f", those of δ_free ≥ {given.least:g} scored" if given.least else "")
    drawn += f"; skin alone, {given.qualification} a qualification" if given.qualification else ""
    text = f"{drawn}; {', '.join(given.instrument)}\n{card.as_text()}\n"
    figures = json.dumps(card.as_json(), indent=1) + "\n"
    (given.output / "figures.txt").write_text(text)
    (given.output / "figures.json").write_text(figures)
    if given.record:
        name = "_".join(["blind", *given.instrument, *([given.references] if given.references != "some" else [])])
        name += f"_{given.qualification}_qualification" if given.qualification else ""
        name += "_sound" if given.tiers == ["T6"] else ""
        told = {"tiers": given.tiers, "n": [given.n], "seed": given.seed, "instrument": given.instrument}
        flags = " ".join(f"--{flag} {' '.join(map(str, values))}" for flag, values in told.items())
        command = f"python benchmarks/blind/run.py {flags} --style {given.style} --references {given.references}"
        command += f" --least {given.least:g}" if given.least else ""
        command += f" --qualification {given.qualification}" if given.qualification else ""
        given.record.mkdir(parents=True, exist_ok=True)
        (given.record / f"{name}.md").write_text(f"`{command}`\n\n```\n{text}```\n")
        (given.record / f"{name}.json").write_text(figures)
    print(text)


if __name__ == "__main__":
    main()
