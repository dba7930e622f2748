"""False alarms of the pressure alone: fresh suction cases of T6, diagnosed without their height.

    python benchmarks/blind/sound_pressure.py --n 16 --seed 7 -o out/pressure
    python benchmarks/blind/sound_pressure.py --n 16 --seed 7 --record benchmarks/results

Nothing hides in the pressure of such a case, and a diagnosis of it takes seconds, so that this tells early whether a
change of the data or of the actuator's null model is right. ``--record`` keeps the figures and their table there.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from acquire.recording import load
from gap import diagnose
from gap.blind import make
from gap.blind.laboratory import STYLES
from gap.blind.lock import unseal
from gap.report.document import as_json


def table(found: dict[str, Any]) -> str:
    """The figures as Markdown."""
    head = f"Pressure alone, {found['cases']} sound cases, {found['style']} style, seed {found['seed']}: "
    lines = [head + f"{found['false_alarms']} false alarms", "", "| case | instrument | verdict | claimed | gap |"]
    lines.append("|---|---|---|---|---|")
    lines += [
        f"| {r['case']} | {r['instrument']} | {r['verdict']} | {r['claimed']} | {r['gap']} |" for r in found["rows"]
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=16, help="cases of T6")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--style", choices=STYLES, default="wide")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/pressure"))
    parser.add_argument("--record", type=Path, help="folder for the figures and their table")
    given = parser.parse_args()
    cases = given.output / f"T6-{given.seed}"
    key = cases.with_name(cases.name + "-key") / "key.bin"
    if not key.exists():
        make("T6", given.n, given.seed, cases, ("cutometer", "aspiration"), style=given.style)
    rows = []
    for truth in json.loads(unseal(key.read_bytes(), ""))["cases"]:
        whole = [load(p) for p in sorted((cases / truth["case"]).iterdir())]
        recordings = [replace(r, streams={"pressure": r.streams["pressure"]}) for r in whole]
        report = as_json(diagnose(recordings))
        first = report["causes"][0] if report["causes"] else None
        claimed = report["verdict"] in ("effect", "several") and first is not None and first["probability"] > 0.5
        named = "+".join(first["effects"]) if claimed and first is not None else ""
        rows.append({"case": truth["case"], "instrument": truth["instrument"], "verdict": report["verdict"],
                     "claimed": named, "gap": report["gap"].get("before")})  # fmt: skip
        print(f"{truth['case']} {truth['instrument']}: {report['verdict']} {named}", flush=True)
    alarms = sum(bool(r["claimed"]) for r in rows)
    found = {"style": given.style, "seed": given.seed, "cases": len(rows), "false_alarms": alarms, "rows": rows}
    for folder in filter(None, (given.output, given.record)):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "sound_pressure.json").write_text(json.dumps(found, indent=1) + "\n")
        (folder / "sound_pressure.md").write_text(table(found))
    print(f"{alarms} false alarms in {len(rows)} sound cases of the {given.style} style")


if __name__ == "__main__":
    main()
