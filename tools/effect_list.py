"""The list of effects in docs/effect-list.md, from the library.

python tools/effect_list.py docs/effect-list.md
"""

from __future__ import annotations

import sys
from pathlib import Path

from sim_devices.chain import Effect
from sim_devices.effects import effects

BEGIN = """# The effects by name

What the diagnosis can name, by stage. `acquire gap effects` lists their parameters, too, with `--json` their sources;
[effects.md](effects.md) says how they are made. This page is made by `tools/effect_list.py`.
"""
STAGES = ("timing", "actuator", "sensor", "interface", "tissue", "processing")


def page() -> str:
    """The whole page."""
    parts = [BEGIN]
    for stage in STAGES:
        # Where an effect takes other units on other instruments, the library has it several times.
        named: dict[str, list[Effect]] = {}
        for effect in effects().values():
            if effect.stage == stage:
                named.setdefault(effect.name, []).append(effect)
        rows = [f"## {stage.capitalize()}", "", "| effect | instruments | meaning | remedy |", "|---|---|---|---|"]
        for name, same in sorted(named.items()):
            where = ", ".join(instrument for effect in same for instrument in effect.instruments)
            rows.append(f"| `{name}` | {where} | {same[0].meaning} | {same[0].remedy} |")
        parts.append("\n".join(rows) + "\n")
    return "\n".join(parts)


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(page(), encoding="utf-8")
