"""Names as people write them; numbers are in `gap.data.quantities`."""

from __future__ import annotations

import re

from gap.inference.hypothesis import Candidate
from sim_devices.effects import effects

SPLITS = {"waveform": "another waveform", "level": "another level", "direction": "another direction",
          "repeat": "another repeat", "recording": "another recording"}  # fmt: skip


def words(name: str) -> str:
    """An effect's name as people say it."""
    return name.replace("_", " ")


def options(effect: Candidate, instrument: str) -> dict[str, str]:
    """Which of its forms, channels or axes an effect of an instrument has, in words; of a rig's, the tap that it acts
    at, and its form where that has a name of its own."""
    if "@" in effect.key:
        kind, tap = effect.key.split("@", 1)
        return {"tap": tap} | ({"form": words(kind)} if kind != effect.name else {})
    known = effects(instrument).get(effect.name) if "[" in effect.key else None
    if known is None:
        return {}
    taken = dict(part.split("=") for part in effect.key.partition("[")[2].rstrip("]").split(","))
    form = int(taken.get("form", 0))
    means = [p for p in known.parameters if p.name in taken and (not p.only or form in p.only)]
    return {p.name: re.split(r"(?:^|, )\d+ ", p.meaning)[1:][int(taken[p.name])] for p in means}
