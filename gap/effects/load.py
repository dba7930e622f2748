"""The effects the diagnosis chooses from: the library, plug-ins, and a user's file."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gap.rig.generic import GenericEffect
from sim_devices.chain import Effect


def library(instrument: str, files: Sequence[Path] = ()) -> dict[str, Effect]:
    """Effects for ``instrument`` by key, one for each form they have, with those of the user's ``files``.

    A file is Python; every `sim_devices.chain.Effect` at its top level counts. Raises ValueError that names the file.
    """
    from sim_devices.effects import effects, variants

    found = {key: form for effect in effects(instrument).values() for key, form in variants(effect).items()}
    for path in files:
        added = _from_file(path)
        fitting = {e.name: e for e in added if instrument in e.instruments}
        if not fitting:
            raise ValueError(f"{path}: it defines no effect for instrument {instrument}")
        found.update({key: form for effect in fitting.values() for key, form in variants(effect).items()})
    return found


def forms_by_name(effects: Mapping[str, Effect]) -> dict[str, list[Effect]]:
    """All forms of each effect by its name, in the order of ``effects``, which has them by key."""
    forms: dict[str, list[Effect]] = {}
    for effect in effects.values():
        forms.setdefault(effect.name, []).append(effect)
    return forms


def generic(files: Sequence[Path]) -> list[GenericEffect]:
    """Effects that users' ``files`` add to those that any rig can have. Raises ValueError that names the file."""
    found = []
    for path in files:
        added = [v for v in _values(path) if isinstance(v, GenericEffect)]
        if not added:
            raise ValueError(f"{path}: it defines no gap.GenericEffect for a --model's taps")
        found += added
    return found


def _from_file(path: Path) -> list[Effect]:
    return [value for value in _values(path) if isinstance(value, Effect)]


def _values(path: Path) -> list[Any]:
    """The names at the top level of a file of Python."""
    if not path.is_file():
        raise ValueError(f"{path}: there is no such file of effects")
    spec = importlib.util.spec_from_file_location(f"skinrig_effects_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise ValueError(f"{path}: fails on import: {type(error).__name__}: {error}") from error
    return list(vars(module).values())
