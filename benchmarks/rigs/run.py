"""Diagnose the benchmark's cases and say how often the answer is right.

    python benchmarks/rigs/make.py -o out/rigs
    OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 python benchmarks/rigs/run.py out/rigs --jobs 1

Reports stay in ``out/rigs/reports``: a run that was broken off goes on where it stopped (``--fresh`` starts anew).
"""

from __future__ import annotations

import argparse
import json
import signal
import time as clock
import traceback
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from acquire.recording import load
from gap.diagnosis import diagnose
from gap.report.document import as_json
from gap.rig.model import load_model

MODELS = Path(__file__).parent
SLOW = 20.0
"""Seconds above which a case counts as slow."""
BINS = ((1, 1.5, "barely visible"), (1.5, 4, "visible"), (4, 15, "strong"), (15, float("inf"), "dominating"))
"""Gap of the fitted nominal model over that with the truth."""
HIDDEN = 5.0
"""Standard deviations below which an effect is too weak to be asked for."""


def diagnosed(job: tuple[Path, str, Path, int]) -> str:
    """Diagnose one case folder with its model into a file; crashes and time-outs become reports, too."""
    folder, model, path, limit = job

    def over(*_: object) -> None:
        raise TimeoutError(f"longer than {limit} s")

    signal.signal(signal.SIGALRM, over)
    signal.alarm(limit)
    begin = clock.perf_counter()
    try:
        runs = [load(p) for p in sorted(folder.iterdir())]
        report = as_json(diagnose(runs, model=load_model(f"{MODELS}/{model}")))
    except Exception as error:
        report = {"verdict": "crash", "causes": [], "error": f"{type(error).__name__}: {error}",
                  "trace": traceback.format_exc()}  # fmt: skip
    signal.alarm(0)
    report["wall"] = clock.perf_counter() - begin
    path.write_text(json.dumps(report) + "\n")
    return f"{folder.name}: {report['verdict']}, {report['wall']:.0f} s"


def judged(truth: dict[str, Any], report: dict[str, Any]) -> dict[str, Any]:
    """The score of a report.

    A case with an effect is ``exact`` or ``family`` where one of the first class's names is; the verdict must be a
    claim (`effect`, `several`). ``wrong``: claimed with p > 0.5 and no name of the family in it. Of a pair, every
    member's class counts.
    """
    cause = report["causes"][0] if report["causes"] else None
    claim = report["verdict"] in ("effect", "several") and cause is not None
    names = set(cause["class"]) | set(cause["effects"]) if cause else set()
    names |= {part for n in names for part in n.replace(" + ", "+").split("+")}
    exact = bool(names & set(truth["exact"]))
    family = exact or bool(names & set(truth["near"]))
    sure = claim and cause["probability"] > 0.5
    return {
        "claim": claim,
        "exact": claim and exact,
        "family": claim and family and bool(truth["exact"]),
        "hinted": not claim and exact,  # named first, but not claimed
        "stage": claim and cause["stages"][0] in truth["stages"],
        "wrong": sure and not (family and truth["exact"]),
        "tiny": sure and family and not truth["exact"],  # really there, but far below the noise
        "extra": claim and family and len(cause["effects"]) > 1,
    }


def contrast(truth: dict[str, Any]) -> float:
    """How far the effect stands out; 0 where it is weaker than `HIDDEN`."""
    ratio = truth["before"] / truth["after"]
    return ratio if (max(ratio**2 - 1, 0) * truth["samples"]) ** 0.5 > HIDDEN else 0.0


def row(name: str, truth: dict[str, Any], report: dict[str, Any]) -> str:
    cause = report["causes"][0] if report["causes"] else {}
    mark = judged(truth, report)
    word = next((w for w in ("wrong", "exact", "family", "hinted") if mark[w]), "claim" if mark["claim"] else "-")
    effects = "+".join(cause.get("where", [])) or report.get("error", "")[:50]
    rest = [n for n in cause.get("class", []) if n not in cause.get("effects", [])]
    shrink = cause.get("shrink", {})
    shown = "/".join(f"{shrink[k]:.2f}" for k in ("fitted", "waveform", "repeat") if shrink.get(k) is not None)
    return (
        f"{name:18} {'/'.join(truth['exact'][:1]) or 'none':22} {truth['size']:8.3g} {truth['before']:7.2f}"
        f" {truth['after']:5.2f} {report['verdict']:12} {cause.get('probability', 0):5.2f} {shown:>14}"
        f" {report['wall']:6.1f}  {word:6} {effects}{' | ' + ','.join(rest) if rest else ''}"
    )


def share(marks: Iterable[bool]) -> str:
    values = list(marks)
    return f"{sum(values)}/{len(values)}" + (f" ({sum(values) / len(values):.0%})" if values else "")


def summary(key: dict[str, Any], reports: dict[str, Any]) -> str:
    marks = {n: judged(key[n], r) for n, r in reports.items()}
    real = [n for n in marks if key[n]["exact"] and contrast(key[n])]
    weak = [n for n in marks if key[n]["exact"] and not contrast(key[n])]
    nulls = [n for n in marks if not key[n]["exact"]]
    lines = [f"{len(real)} cases with an effect, {len(nulls)} without; too weak to be seen: {weak or 'none'}"]
    for low, high, word in ((1, float("inf"), "all"), *BINS):
        some = [n for n in real if low <= contrast(key[n]) < high]
        if some:
            lines.append(
                f"  {word:15} exact {share(marks[n]['exact'] for n in some):12}"
                f" family {share(marks[n]['family'] for n in some):12}"
                f" stage {share(marks[n]['stage'] for n in some):12}"
                f" first but unclaimed {share(marks[n]['hinted'] for n in some):12}"
                f" wrong with p>.5 {share(marks[n]['wrong'] for n in some)}"
            )
    extra = share(marks[n]["extra"] for n in real if marks[n]["family"])
    lines.append(f"  of right families with a second effect besides: {extra}")
    lines.append(f"no effect: claimed all the same {share(marks[n]['claim'] for n in nulls)},"
                 f" with p>.5 {share(marks[n]['wrong'] for n in nulls)}"
                 f" (of them a tiny one that is there {sum(marks[n]['tiny'] for n in nulls)})")  # fmt: skip
    verdicts: dict[str, int] = {}
    for n in nulls:
        verdicts[reports[n]["verdict"]] = verdicts.get(reports[n]["verdict"], 0) + 1
    lines.append(f"  verdicts there: {verdicts}")
    lines.append(f"crashes: {[n for n, r in reports.items() if r['verdict'] == 'crash'] or 'none'}")
    slow = {n: round(r["wall"]) for n, r in reports.items() if r["wall"] > SLOW}
    lines.append(f"slower than {SLOW:.0f} s: {slow or 'none'}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("out/rigs"))
    parser.add_argument("--only", nargs="+", metavar="CASE", help="kinds of case, such as servo")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--limit", type=int, default=240, help="s after which a case is given up")
    parser.add_argument("--fresh", action="store_true", help="diagnose cases again that have a report")
    parser.add_argument("--reports", default="reports", help="name of the folder for the reports")
    given = parser.parse_args()
    key = json.loads((given.folder / "key.json").read_text())
    if given.only:
        key = {n: k for n, k in key.items() if n.rsplit("-", 1)[0] in given.only}
    out = given.folder / given.reports
    out.mkdir(exist_ok=True)
    jobs = [(given.folder / "cases" / n, k["model"], out / f"{n}.json", given.limit) for n, k in key.items()]
    jobs = [j for j in jobs if given.fresh or not j[2].exists()]
    if given.jobs > 1:
        with ProcessPoolExecutor(given.jobs) as pool:
            for line in pool.map(diagnosed, jobs):
                print(line, flush=True)
    else:
        for job in jobs:
            print(diagnosed(job), flush=True)
    reports = {n: json.loads((out / f"{n}.json").read_text()) for n in key if (out / f"{n}.json").exists()}
    heading = (f"{'case':18} {'truth':22} {'size':>8} {'before':>7} {'after':>5} {'verdict':12} {'p':>5} {'shrink':>14}"
               f" {'s':>6}  {'worth':6} first cause | its class")  # fmt: skip
    text = "\n".join([heading, *(row(n, key[n], r) for n, r in reports.items()), "", summary(key, reports)])
    (given.folder / f"{given.reports}.txt").write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
