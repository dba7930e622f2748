"""The list of effects in docs/effect-list.md, from the library.

python tools/effect_list.py docs/effect-list.md
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from gap.rig.catalogue import GENERIC
from gap.rig.generic import GenericEffect
from sim_devices.chain import Effect, Parameter
from sim_devices.effects import effects
from sim_devices.effects.build import CHOICE

BEGIN = """# The effects by name

The names that a diagnosis can give: first the effects of the three instruments by stage, then
[those of any other rig](#any-other-rig). `acquire gap effects cutometer` (or `aspiration`, `microrobot`, `rig`) lists
the ranges of their parameters, too, with `--json` their sources; [effects.md](effects.md) says how they are made, and
[nominal.md](nominal.md) what instruments and skin do without them, and how much of an effect is no finding. This page
is made by `tools/effect_list.py`.

An effect that differs from one instrument to another has a row for each. *Forms and channels* are its choices; a report
names the one that fits in a cause's `options`. *Parameters* have their unit in brackets, (1) of a share or ratio; not
every form has all of them.
"""
RIG = """## Any other rig

Effects that can act at any [tap](rigs.md) of a model of yours (`acquire gap diagnose … --model`), where the tap gives
the signal that they *need*. A name means what this table says, also where an instrument has an effect of the same name:
a `leak` of a suction line is a flow, here a held value bleeds away. In a report, `effects` has the effect, and `where`
the form and the tap, as `relaxation@tap` (without a form `creep@tap`).

| effect | form | needs | only where | meaning | parameters | remedy |
|---|---|---|---|---|---|---|"""
STAGES = ("timing", "actuator", "sensor", "interface", "tissue", "processing")


def page() -> str:
    """The whole page."""
    parts = [BEGIN]
    for stage in STAGES:
        rows = [
            f"## {stage.capitalize()}", "",
            "| effect | instruments | meaning | forms and channels | parameters | remedy |",
            "|---|---|---|---|---|---|",
        ]  # fmt: skip
        parts.append("\n".join([*rows, *_rows(stage)]) + "\n")
    parts.append("\n".join([RIG, *map(_generic, sorted(GENERIC, key=lambda e: (e.name, e.form)))]) + "\n")
    return "\n".join(parts)


def _rows(stage: str) -> Iterator[str]:
    """The rows of a stage: an effect has one for each way in which it differs between instruments."""
    # Where an effect takes other units on other instruments, the library has it several times.
    alike: dict[tuple[str, str, str, str, str], list[str]] = {}
    for effect in effects().values():
        if effect.stage == stage:
            told = (effect.name, effect.meaning, _choices(effect), _quantities(effect), effect.remedy)
            alike.setdefault(told, []).extend(effect.instruments)
    for (name, *told), instruments in sorted(alike.items(), key=lambda row: row[0][0]):
        yield " | ".join((f"| `{name}`", ", ".join(instruments), *told)) + " |"


def _quantities(effect: Effect) -> str:
    """The parameters that are numbers, with their units."""
    quantities = [p for p in effect.parameters if p.unit != CHOICE]
    return "<br>".join(f"`{p.name}` ({p.unit}): {p.meaning}" for p in quantities)


def _choices(effect: Effect) -> str:
    choices = [p for p in effect.parameters if p.unit == CHOICE and p.name != "seed"]
    return "<br>".join(f"{p.name}: {_options(p)}" for p in choices)


def _options(parameter: Parameter) -> str:
    """The options of a choice in words, without their numbers."""
    words, rest = [], parameter.meaning.removeprefix("0 ")
    for number in range(1, int(parameter.high) + 1):
        word, _, rest = rest.partition(f", {number} ")
        words.append(word)
    return "; ".join([*words, rest])


def _generic(effect: GenericEffect) -> str:
    where = {
        "the signal turns back": effect.of_turns and not effect.needs,
        f"the {effect.needs} turns back": effect.of_turns and bool(effect.needs),
        "whole series are tapped": effect.looks_ahead,
        "the tap is a net force": effect.of_net,
    }
    only = ", ".join(text for text, true in where.items() if true)
    parameters = ", ".join(p.name for p in effect.parameters)
    form = f"`{effect.form}`" if effect.form else ""
    return f"| `{effect.name}` | {form} | {effect.needs} | {only} | {effect.meaning} | {parameters} | {effect.remedy} |"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(page(), encoding="utf-8")
