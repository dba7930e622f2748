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
from collections import Counter
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
UNCLAIMED = dict.fromkeys(("claim", "exact", "family", "hinted", "stage", "wrong", "tiny", "extra"), False)
"""The score of a report that claims nothing; ``hinted`` where it names the effect first all the same."""
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
    if not report["causes"]:
        return dict(UNCLAIMED)
    cause = report["causes"][0]
    names = {part for name in (*cause["class"], *cause["effects"]) for part in (name, *parts_of(name))}
    exact = not names.isdisjoint(truth["exact"])
    if report["verdict"] not in ("effect", "several"):
        return UNCLAIMED | {"hinted": exact}
    real, family = bool(truth["exact"]), exact or not names.isdisjoint(truth["near"])
    sure = cause["probability"] > 0.5
    return UNCLAIMED | {
        "claim": True,
        "exact": exact,
        "family": family and real,
        "stage": cause["stages"][0] in truth["stages"],
        "wrong": sure and not (family and real),
        "tiny": sure and family and not real,  # really there, but far below the noise
        "extra": family and len(cause["effects"]) > 1,
    }


def parts_of(name: str) -> list[str]:
    """The effects that the name of a pair is made of."""
    return name.replace(" + ", "+").split("+")


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


Marks = dict[str, dict[str, Any]]
"""What `judged` says of each case."""


def counted(marks: Marks, names: Iterable[str], mark: str) -> str:
    """How many of the cases ``names`` have a mark."""
    return share(marks[n][mark] for n in names)


def summary(key: dict[str, Any], reports: dict[str, Any]) -> str:
    """How often the first cause is right where there is an effect, and one is claimed where there is none."""
    marks = {n: judged(key[n], r) for n, r in reports.items()}
    effects = {n: contrast(key[n]) for n in marks if key[n]["exact"]}
    real = {n: c for n, c in effects.items() if c}
    weak = [n for n, c in effects.items() if not c]
    nulls = [n for n in marks if n not in effects]
    lines = [f"{len(real)} cases with an effect, {len(nulls)} without; too weak to be seen: {weak or 'none'}"]
    lines += by_contrast(marks, real)
    lines += of_nulls(marks, nulls, reports)
    lines += of_trouble(reports)
    return "\n".join(lines)


def by_contrast(marks: Marks, real: dict[str, float]) -> list[str]:
    """Lines on the cases with an effect, all and by how far it stands out."""
    lines = []
    for low, high, word in ((1, float("inf"), "all"), *BINS):
        some = [n for n, found in real.items() if low <= found < high]
        if some:
            lines.append(
                f"  {word:15} exact {counted(marks, some, 'exact'):12}"
                f" family {counted(marks, some, 'family'):12}"
                f" stage {counted(marks, some, 'stage'):12}"
                f" first but unclaimed {counted(marks, some, 'hinted'):12}"
                f" wrong with p>.5 {counted(marks, some, 'wrong')}"
            )
    extra = counted(marks, (n for n in real if marks[n]["family"]), "extra")
    return [*lines, f"  of right families with a second effect besides: {extra}"]


def of_trouble(reports: dict[str, Any]) -> list[str]:
    """Lines on crashes and slow cases."""
    crashes = [n for n, r in reports.items() if r["verdict"] == "crash"]
    slow = {n: round(r["wall"]) for n, r in reports.items() if r["wall"] > SLOW}
    return [f"crashes: {crashes or 'none'}", f"slower than {SLOW:.0f} s: {slow or 'none'}"]


def of_nulls(marks: Marks, nulls: list[str], reports: dict[str, Any]) -> list[str]:
    """Lines on the cases without an effect."""
    tiny = sum(marks[n]["tiny"] for n in nulls)
    return [
        f"no effect: claimed all the same {counted(marks, nulls, 'claim')},"
        f" with p>.5 {counted(marks, nulls, 'wrong')} (of them a tiny one that is there {tiny})",
        f"  verdicts there: {dict(Counter(reports[n]['verdict'] for n in nulls))}",
    ]


def diagnose_all(jobs: list[tuple[Path, str, Path, int]], processes: int) -> None:
    """Diagnose cases in some processes and tell each as it ends."""
    if processes == 1:
        for job in jobs:
            print(diagnosed(job), flush=True)
        return
    with ProcessPoolExecutor(processes) as pool:
        for line in pool.map(diagnosed, jobs):
            print(line, flush=True)


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
    diagnose_all([j for j in jobs if given.fresh or not j[2].exists()], given.jobs)
    reports = {n: json.loads((out / f"{n}.json").read_text()) for n in key if (out / f"{n}.json").exists()}
    heading = (f"{'case':18} {'truth':22} {'size':>8} {'before':>7} {'after':>5} {'verdict':12} {'p':>5} {'shrink':>14}"
               f" {'s':>6}  {'worth':6} first cause | its class")  # fmt: skip
    text = "\n".join([heading, *(row(n, key[n], r) for n, r in reports.items()), "", summary(key, reports)])
    (given.folder / f"{given.reports}.txt").write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
