"""Any rig as a diagnosable problem: a forward model with named taps, on recordings of any channels.

A model is a class (or object) in a user's file, given as ``--model file.py:Name``::

    class Servo:
        name = "servo"
        channels = ("motor_force",)                      # measured channels that it predicts
        stages = {"friction_force": "actuator", "motor_force": "sensor"}   # taps and their stages
        parameters = (Parameter("mass", "kg", 10, 1000, None, 100, "log"),)

        def simulate(self, time, data, parameters, tap):
            force = parameters["mass"] * data["acceleration"]
            force = force + tap("friction_force", 0 * force, velocity=data["velocity"])
            return {"motor_force": tap("motor_force", force)}

``data`` holds every channel and set-point of the recording on ``time`` (n,) s. ``tap`` returns its values unchanged
unless an effect acts there. An optional ``observe(time, data)`` returns the channels to compare with, where the
recorded ones must first be filtered like the model's inputs. See `gap.rig.generic` for the effects a tap can have;
``effects = (GenericEffect(...), ...)`` on the model adds the user's own.
"""

from __future__ import annotations

import ast
import importlib.util
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from acquire.recording.model import Recording
from protocols.files import in_words, is_file
from sim_devices.chain import STAGES, FloatArray, Parameter


class ModelError(ValueError):
    """A user's model that cannot be used: the message names the file, the model and the fault."""


class ForwardModel(Protocol):
    """The interface that `--model` expects; see the module's docstring."""

    name: str
    channels: Sequence[str]
    stages: Mapping[str, str]
    parameters: Sequence[Parameter]

    def simulate(
        self, time: FloatArray, data: Mapping[str, FloatArray], parameters: Mapping[str, float], tap: Callable[..., Any]
    ) -> Mapping[str, FloatArray]: ...


def load_model(where: str) -> ForwardModel:
    """The model named by ``file.py:Name``, or by ``file.py`` where it defines one class. Raises ModelError.

    A model is code: it is run only because the user names it, never found in a data folder.
    """
    path_text, _, name = where.rpartition(":")
    path = Path(path_text)
    if not path_text or not name or name.endswith(".py"):  # the colon may be a drive's
        path = Path(where.rstrip(":"))
        if len(only := _classes(path)) != 1:
            raise ModelError(f"model {where!r}: give it as file.py:Name{_defined_in(path)}")
        (name,) = only
    if not is_file(path):
        raise ModelError(f"model {where!r}: there is no file {path}")
    spec = importlib.util.spec_from_file_location(f"skinrig_model_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
        if not hasattr(module, name):
            raise ModelError(f"model {where!r}: {path} defines no {name}{_defined_in(path)}")
        given = getattr(module, name)
        model: ForwardModel = given() if isinstance(given, type) else given
    except ModelError:
        raise
    except (Exception, SystemExit) as error:  # whatever a stranger's module does
        raise ModelError(
            f"model {where!r}: {path} fails on import: {type(error).__name__}: {in_words(error)}"
        ) from error
    missing = [a for a in ("name", "channels", "stages", "parameters", "simulate") if not hasattr(model, a)]
    if missing:
        raise ModelError(f"model {where!r}: it lacks {', '.join(missing)} (see gap.rig.model)")
    return model


def check_model(model: ForwardModel, recordings: Sequence[Recording]) -> None:
    """Raises ModelError for channels, stages or parameters of a wrong kind."""
    who = f"model {model.name}"
    if isinstance(model.channels, str) or not len(model.channels):
        raise ModelError(f"{who}: channels should be a tuple of names, such as ('force',)")
    for recording in recordings:
        lacking = [c for c in model.channels if c not in recording.streams]
        if lacking:
            have = ", ".join(recording.streams)
            raise ModelError(f"{who}: recording {recording.info.id} has no channel {', '.join(lacking)}; it has {have}")
    for tap, stage in model.stages.items():
        if stage not in STAGES:
            raise ModelError(f"{who}: tap {tap} has the stage {stage!r}; there are {', '.join(STAGES)}")
    for p in model.parameters:
        if not p.low < p.high or (p.scale == "log" and p.low <= 0) or not p.low <= p.default <= p.high:
            raise ModelError(
                f"{who}: parameter {p.name} has the range {p.low:g} … {p.high:g} ({p.scale}) and the default "
                f"{p.default:g}: low < high, the default within, and low > 0 where it is log"
            )


def _defined_in(path: Path) -> str:
    """The classes that a file defines, as the end of a message; nothing where there are none."""
    names = _classes(path)
    return f"; it defines {', '.join(names)}" if names else ""


def _classes(path: Path) -> list[str]:
    """Names of the classes that a file defines; none where it cannot be read."""
    try:
        body = ast.parse(path.read_text(encoding="utf-8")).body if is_file(path) else []
    except (OSError, ValueError, SyntaxError):
        body = []
    return [node.name for node in body if isinstance(node, ast.ClassDef)]
