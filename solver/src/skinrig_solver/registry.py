"""The models of the plugin, collected lazily: a problem's package is imported when one of its models is asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module

from . import users
from .api import Model

# problem package -> names its MODELS dict holds, so that listing names costs no import of numba
_PACKAGES: dict[str, tuple[str, ...]] = {
    "suction": (
        "suction_yeoh_qlv",
        "suction_yeoh_2",
        "suction_yeoh_3",
        "suction_neo_hooke",
        "suction_mooney_rivlin",
        "suction_fibres",
        "suction_rubin_bodner",
        "suction_rubin_bodner_gamma",
    ),
    "sheet": ("sheet_ogden", "sheet_tong_fung", "sheet_bischoff", "sheet_fung", "sheet_gasser", "sheet_yeoh"),
    "finger": ("finger_section",),
}

_OWN = frozenset(name for names in _PACKAGES.values() for name in names)


class _LazyModels(Mapping[str, Model]):
    def __iter__(self) -> Iterator[str]:
        yield from (name for names in _PACKAGES.values() for name in names)
        yield from (name for name in users.installed() if name not in _OWN)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __getitem__(self, name: str) -> Model:
        for package, names in _PACKAGES.items():
            if name in names:
                found: dict[str, Model] = import_module(f"{__package__}.{package}").MODELS
                return found[name]
        if users.is_file(name):
            return users.from_file(name)
        if name in users.installed():
            return users.from_package(name)
        raise KeyError(f"no model {name!r}; there are {', '.join(self)}")


@cache
def models() -> Mapping[str, Model]:
    """All models by name; a model's package is imported on first access to it.

    Beside the plugin's own there are those of the entry point group ``skinrig.laws``; ``path.py:NAME`` is the object
    NAME of a file. Access raises KeyError for an unknown name, ``users.UserModelError`` for one that does not load.
    """
    return _LazyModels()
