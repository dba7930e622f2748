"""Models that people bring: of a file (``path.py:NAME``) or of an installed package (entry points ``skinrig.laws``)."""

from __future__ import annotations

import hashlib
import importlib.util
import sys
import traceback
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from .api import Model, ModelInfo

GROUP = "skinrig.laws"


class UserModelError(ValueError):
    """A model that somebody brought and that cannot be used; the message names file or package and line."""


def is_file(name: str) -> bool:
    """Whether a model's name means an object of a Python file."""
    return ".py:" in name


@cache
def installed() -> dict[str, EntryPoint]:
    """The entry points of installed packages, by the name that `acquire fit --model` knows them under."""
    return {point.name: point for point in entry_points(group=GROUP)}


@cache
def from_package(name: str) -> Model:
    """The model behind an entry point. Raises UserModelError naming it."""
    point = installed()[name]
    try:
        found = point.load()
    except Exception as error:  # a package's own fault, of any kind
        raise UserModelError(f"model {name} ({point.value}) does not load: {_fault(error)}") from error
    return _checked(found, f"model {name} ({point.value})")


@cache
def from_file(name: str) -> Model:
    """The object behind ``path.py:NAME``. Raises UserModelError naming the file."""
    path_name, _, attribute = name.rpartition(":")
    path = Path(path_name).resolve()
    if not path.is_file():
        raise UserModelError(f"{path_name}: no such file")
    module_name = f"skinrig_user_{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    spec = importlib.util.spec_from_file_location(module_name, path)
    if spec is None or spec.loader is None:
        raise UserModelError(f"{path_name}: not a Python file")
    module = sys.modules[module_name] = importlib.util.module_from_spec(spec)  # workers and pickles look it up by name
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # the file's own fault, of any kind
        del sys.modules[module_name]
        line = _line(error, str(path))
        raise UserModelError(f"{path_name}{line}: does not load: {_fault(error)}") from error
    if not hasattr(module, attribute):
        models = [key for key, value in vars(module).items() if isinstance(value, Model)]
        raise UserModelError(f"{path_name}: has no {attribute!r}; its models are {', '.join(models) or 'none'}")
    return _checked(getattr(module, attribute), f"{path_name}: {attribute}")


def _checked(found: Any, who: str) -> Model:
    if not isinstance(found, Model) or not isinstance(getattr(found, "info", None), ModelInfo):
        raise UserModelError(
            f"{who} is a {type(found).__name__}, not a model: it needs `info` (ModelInfo) and `simulate`, as a "
            "SuctionModel has (skinrig_solver.suction.one_layer makes one from a law)"
        )
    return found


def _fault(error: BaseException) -> str:
    return f"{type(error).__name__}: {error.msg if isinstance(error, SyntaxError) else error}"


def _line(error: BaseException, path: str) -> str:
    """``:12``, the last line of the file that the error passed through; empty where there is none."""
    if isinstance(error, SyntaxError) and error.filename == path:
        return f":{error.lineno}"
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == path]
    return f":{lines[-1]}" if lines else ""
