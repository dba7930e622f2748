"""The page docs/tolerances.md, from the stated tolerances.

python tools/tolerance_list.py docs/tolerances.md
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from gap.data.tolerances import Tolerance, tolerances
from gap.rig.catalogue import GENERIC
from sim_devices.effects import effects

BEGIN = """# Tolerances

How far a sound instrument of a laboratory may be off: each number is one **standard deviation**, not a bound. A fit
moves the quantity within it and pays for that; where a group is an effect of the [list](effect-list.md), an effect
within twice the number is no finding. *Another make* is the wider tolerance of a sound instrument that was not built
or tuned as the nominal one; the width that the recordings make more probable is taken. A group in *italics* is no
effect: a part of the nominal instrument, or a quantity of it that a qualification reports. An effect without a row
has no tolerance: any amount that can be seen is a finding. [nominal.md](nominal.md) has the equations. *quantities* are
what an instrument passes a qualification with, wider than the prior of the same thing: a diagnosis asks the other row.
Of an effect with several forms the row of the form's own strength holds (a *delay* of 1 ms and looks every 5 ms, late
by half of that, are two). Skin's own (stiffer or softer by 5 % from recording to recording under suction, by 4 % on
the robot), zeros that are taken anew with each recording and the slower part of noise are in [nominal.md](nominal.md).
No maker publishes these numbers: all are assumed. This page is made by
`tools/tolerance_list.py` from `gap/data/tolerances.yaml`.
"""
TITLES = {
    "cutometer": "Cutometer and aspiration device",
    "microrobot": "Micro-robot",
    "rig": "Any other rig",
}
EFFECTS = {e.name for e in [*effects().values(), *GENERIC]}


def page() -> str:
    """The whole page."""
    assert tolerances("cutometer") == tolerances("aspiration"), "both have the same table"
    parts = [BEGIN]
    for instrument, title in TITLES.items():
        head = [f"## {title}", "", "| of | quantity | nominal | one standard deviation | another make | why |"]
        parts.append("\n".join([*head, "|---|---|---|---|---|---|", *_rows(instrument)]) + "\n")
    return "\n".join(parts)


def _rows(instrument: str) -> Iterator[str]:
    for group, parameters in tolerances(instrument).items():
        of = f"`{group}`" if group in EFFECTS else f"*{group}*"
        for name, t in parameters.items():
            other = _number(t.other, t) if t.other else ""
            yield f"| {of} | {name} | {t.nominal:g} | {_number(t.value, t)} | {other} | {t.source} |"


def _number(value: float, of: Tolerance) -> str:
    return f"{value:g}" if of.unit == "1" else f"{value:g} {of.unit}"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(page(), encoding="utf-8")
