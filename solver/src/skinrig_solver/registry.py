"""The models of the plugin, collected lazily: a problem's package is imported when one of its models is asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module

from .api import Model

# problem package -> names its MODELS dict holds, so that listing names costs no import of numba
_PACKAGES: dict[str, tuple[str, ...]] = {
    "suction": ("suction_yeoh_qlv", "suction_rubin_bodner", "suction_rubin_bodner_gamma"),
    "sheet": ("sheet_ogden", "sheet_tong_fung", "sheet_bischoff", "sheet_fung", "sheet_gasser", "sheet_yeoh"),
    "finger": ("finger_section",),
}


class _LazyModels(Mapping[str, Model]):
    def __iter__(self) -> Iterator[str]:
        return (name for names in _PACKAGES.values() for name in names)

    def __len__(self) -> int:
        return sum(len(names) for names in _PACKAGES.values())

    def __getitem__(self, name: str) -> Model:
        for package, names in _PACKAGES.items():
            if name in names:
                found: dict[str, Model] = import_module(f"{__package__}.{package}").MODELS
                return found[name]
        raise KeyError(f"no model {name!r}; there are {', '.join(self)}")


@cache
def models() -> Mapping[str, Model]:
    """All models by name; a model's package is imported on first access to it."""
    return _LazyModels()
