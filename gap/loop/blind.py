"""The loop on blind cases: reports after 0, 1, 2 … experiments, and how often they are right."""

from __future__ import annotations

import json
import sys
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any
from zlib import crc32

from acquire.files import write_text
from acquire.plugins import instrument
from gap.batch import qualified_by
from gap.blind.answers import Case, load
from gap.blind.scoring import evaluate
from gap.blind.specimens import specimens_of
from gap.data.session import SKIN
from gap.loop.policies import first_claim, policy_of
from gap.loop.rigs import BlindRig
from gap.loop.run import Step, run

STEPS = "steps"
"""Folder beside those of the reports: each experiment and its cost."""


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
    policy_of(policy)
    folders = sorted(p for p in cases.iterdir() if p.is_dir())
    if not folders:
        raise FileNotFoundError(f"{cases}: no case folder in it")
    for number, case in enumerate(folders):
        loop_case(case, out, policy, most, seed, passphrase, jobs, quick)
        print(f"{number + 1}/{len(folders)} {case.name}", file=sys.stderr, flush=True)
    found = {}
    for k in range(most + 1):
        card = evaluate(answered(out, k, key_of(cases), passphrase))
        found[k] = {f.name: (f.value, f.n) for f in card.figures}
    return found


def loop_case(
    case: Path,
    out: Path,
    policy: str,
    most: int = 3,
    seed: int = 1,
    passphrase: str = "",
    jobs: int = 1,
    quick: bool = False,
    shared: Path | None = None,
    until_claimed: bool = False,
    qualification: str = "",
) -> None:
    """Run the loop on one case, unless it has its reports: those after k experiments go to ``out/k/<case>.json``, the
    experiments and their cost to ``out/steps/<case>.json``.

    Policies given the same folder ``shared`` share answers and reports of equal experiments. With
    ``until_claimed`` the loop ends with the first claim, otherwise where a cause is certain. With a ``qualification``
    (of `gap.batch.QUALIFICATIONS`) it begins with the session's recordings of skin alone.
    """
    chooser = policy_of(policy)
    if (out / str(most) / f"{case.name}.json").exists():
        return
    work = out / "work" / case.name
    tree = (shared / case.name) if shared is not None else work
    rig = BlindRig(case, passphrase, bool(qualification))
    q = qualified_by(rig.recorded, tree / "qualification.yaml") if qualification == "with" else None
    kind = rig.session[0].info.instrument
    # A seed for each case: chance that draws the same experiments for all cases is another fixed order.
    choose = chooser(seed + crc32(case.name.encode()), (SKIN, *specimens_of(kind)))
    choose = first_claim(choose) if until_claimed else choose
    steps = run(rig, choose, instrument(kind).limits, work, most, quick, jobs, shared=tree, qualification=q)
    write_text(out / STEPS / f"{case.name}.json", json.dumps(_told(steps), indent=1) + "\n")
    for k in range(most + 1):
        report = steps[min(k, len(steps) - 1)].report
        write_text(out / str(k) / f"{case.name}.json", json.dumps(report) + "\n")


def _told(steps: Sequence[Step]) -> list[dict[str, Any]]:
    """The experiments asked for after each report, and their cost: seconds of this process, minutes of bench time."""
    rows = []
    for step in steps:
        asked = step.choice.experiment if step.choice is not None else None
        rows.append(
            {
                "specimen": asked.specimen if asked else "",
                "waveform": asked.waveform if asked else "",
                "minutes": asked.minutes if asked else 0.0,
                "stopped": step.choice.reason if step.choice is not None else "",
                "seconds": {"diagnosis": step.seconds[0], "choice": step.seconds[1]},
            }
        )
    return rows


def key_of(cases: Path) -> Path:
    """The sealed key beside a folder of cases."""
    return cases.resolve().with_name(cases.resolve().name + "-key") / "key.bin"


def answered(out: Path, k: int, key: Path, passphrase: str = "", only: Collection[str] = ()) -> list[Case]:
    """Truth and answer of the cases (``only`` those named) after ``k`` experiments. Raises ValueError."""
    return [c for c in load(out / str(k), [key], passphrase) if not only or c.name in only]


def as_text(found: Mapping[int, Mapping[str, tuple[float, int]]]) -> str:
    """Figures against the number of experiments, as a table."""
    names = [n for n in next(iter(found.values())) if any(figures[n][1] for figures in found.values())]
    lines = [f"{'':<52}" + "".join(f"{k:>12}" for k in found) + "   experiments"]
    for name in names:
        cells = (found[k][name] for k in found)
        lines.append(f"{name:<52.52}" + "".join(f"{v:>7.2f} ({n:>2})" if n else f"{'-':>12}" for v, n in cells))
    return "\n".join(lines)
