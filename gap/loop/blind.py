"""The loop on blind cases: reports after 0, 1, 2 … experiments, and how often they are right."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from acquire.files import write_text
from acquire.plugins import instrument
from gap.blind import score
from gap.blind.specimens import specimens_of
from gap.data.session import SKIN
from gap.loop.policies import Policy, policy_of
from gap.loop.rigs import BlindRig
from gap.loop.run import run


def loop_cases(
    cases: Path,
    out: Path,
    policy: str,
    most: int = 3,
    seed: int = 1,
    passphrase: str = "",
    jobs: int = 1,
    quick: bool = False,
) -> Mapping[int, Mapping[str, tuple[float, int]]]:
    """Run the loop on every case of a folder; the answers after k experiments go to ``out/k/<case>.json``.

    ``quick`` diagnoses fit few effects and no pairs. A case that stopped keeps its last report. Returns figures
    (value, n) by number of experiments; a case that has its reports is not run again. Raises FileNotFoundError,
    ValueError.
    """
    chooser = policy_of(policy)
    folders = sorted(p for p in cases.iterdir() if p.is_dir())
    if not folders:
        raise FileNotFoundError(f"{cases}: no case folder in it")
    for number, case in enumerate(folders):
        if not (out / str(most) / f"{case.name}.json").exists():
            _one(case, out, chooser, most, seed, passphrase, jobs, quick)
            print(f"{number + 1}/{len(folders)} {case.name}", file=sys.stderr, flush=True)
    key = cases.resolve().with_name(cases.resolve().name + "-key") / "key.bin"
    found = {}
    for k in range(most + 1):
        card = score(out / str(k), [key], passphrase)
        found[k] = {f.name: (f.value, f.n) for f in card.figures}
    return found


def _one(
    case: Path,
    out: Path,
    chooser: Callable[[int, Sequence[str]], Policy],
    most: int,
    seed: int,
    passphrase: str,
    jobs: int,
    quick: bool,
) -> None:
    work = out / "work" / case.name
    if work.exists():
        shutil.rmtree(work)  # of a run that was broken off
    rig = BlindRig(case, work, passphrase)
    kind = rig.session[0].info.instrument
    policy = chooser(seed, (SKIN, *specimens_of(kind)))
    steps = run(rig, policy, instrument(kind).limits, work, most, quick, jobs)
    for k in range(most + 1):
        report = steps[min(k, len(steps) - 1)].report
        write_text(out / str(k) / f"{case.name}.json", json.dumps(report) + "\n")


def as_text(found: Mapping[int, Mapping[str, tuple[float, int]]]) -> str:
    """Figures against the number of experiments, as a table."""
    names = [n for n in next(iter(found.values())) if any(figures[n][1] for figures in found.values())]
    lines = [f"{'':<52}" + "".join(f"{k:>12}" for k in found) + "   experiments"]
    for name in names:
        cells = (found[k][name] for k in found)
        lines.append(f"{name:<52.52}" + "".join(f"{v:>7.2f} ({n:>2})" if n else f"{'-':>12}" for v, n in cells))
    return "\n".join(lines)
