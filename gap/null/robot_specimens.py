"""The micro-robot's nominal chain on skin and on each of its specimens."""

from __future__ import annotations

from functools import lru_cache

from gap.null.groups import Group
from sim_devices.chain import Chain
from sim_devices.stages import nominal
from sim_devices.stages.specimens import SHEETS, sheet_of, with_weight
from sim_devices.stages.tissues import SheetTissue, sheet_tissue


def specimen_chain(group: Group, tissue: SheetTissue, marks: tuple[float, ...] = ()) -> Chain:
    """The nominal chain for a group: ``tissue`` if it is skin, else its specimen.

    ``marks`` (s): when recordings start, for effects that begin anew with each.
    """
    if group.name == "dead weight":
        if not {"mass", "direction"} <= group.known.keys():
            raise ValueError("a dead weight tells nothing without its mass and direction")
        mass, direction = group.known["mass"].scalar, group.known["direction"].value
        return with_weight(_sound(sheet_tissue("open air"), marks), mass, direction)
    return _sound(tissue if group.skin else _specimen(group), marks)


@lru_cache(maxsize=64)
def _sound(tissue: SheetTissue, marks: tuple[float, ...]) -> Chain:
    return nominal("microrobot", tissue=tissue, marks=marks)


def _specimen(group: Group) -> SheetTissue:
    if group.name in SHEETS:
        return sheet_of(group.name, group.known["k"].scalar if "k" in group.known else 0.0)
    try:
        return sheet_tissue(group.name)
    except ValueError:
        return sheet_tissue("silicone")
