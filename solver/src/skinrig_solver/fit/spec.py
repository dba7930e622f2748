"""The task of a fit: a frozen specification, read from YAML. Faults name file, line and field."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import yaml

from ..api import ModelInfo
from . import units
from .priors import read_prior
from .variables import Free, Tied, Variables

Optimiser = Literal["trust-region", "slsqp", "nelder-mead"]
Drive = Literal["measured", "commanded"]
Balance = Literal["samples", "recordings"]
Origin = Literal["recording", "load"]
Zero = Literal["auto", "free", "fixed"]

# Identified by the papers; the rest of a model's parameters is held where a specification does not free them.
FREE: dict[str, tuple[str, ...]] = {
    "suction_yeoh_qlv": ("G", "c20", "g1", "tau1", "g2", "tau2"),
    "suction_rubin_bodner": tuple(
        f"{layer}.{name}" for layer in ("skin", "smas") for name in ("mu0", "q", "n", "m2", "Gamma1", "Gamma2", "r2")
    ),
    "suction_yeoh_2": ("skin.G", "skin.c20", "fat.G", "skin.g1", "skin.tau1"),
    "suction_yeoh_3": ("skin.G", "skin.c20", "fat.G", "skin.g1", "skin.tau1"),
    "suction_neo_hooke": ("G", "g1", "tau1", "g2", "tau2"),
    "suction_mooney_rivlin": ("c10", "c01", "g1", "tau1", "g2", "tau2"),
    "suction_fibres": ("G", "k1", "k2", "g1", "tau1", "g2", "tau2"),
    "finger_section": ("subcutis.E", "dermis.E", "epidermis.E"),
}
MAX_LENGTH = 256 * 1024  # characters of a specification
_HELD = re.compile(r"bulk|gbar2?|tau2?")  # of a sheet: paper M held them
VISCOUS = re.compile(r"(.*\.)?(g\d|tau\d?|gbar2?|Gamma\d|n|r\d)")


class SpecError(ValueError):
    """A specification that cannot be followed; the message says where and why."""


@dataclass(frozen=True)
class Phase:
    """Samples from ``start`` to ``stop`` [s] count with ``weight`` altogether, however many they are (paper F)."""

    start: float
    stop: float
    weight: float


@dataclass(frozen=True)
class Stage:
    """One step of a staged fit: which of the free parameters move, on which recordings (patterns; all if empty)."""

    name: str
    free: tuple[str, ...] | Literal["viscous", "elastic", "all"] = "all"
    recordings: tuple[str, ...] = ()

    def moving(self, symbols: Sequence[str]) -> tuple[str, ...]:
        """Those of the free ``symbols`` that this stage moves. Raises SpecError for a name that is not free."""
        if isinstance(self.free, tuple):
            for symbol in self.free:
                if symbol not in symbols:
                    raise SpecError(f"stage {self.name}: {symbol!r} is not free; free are {', '.join(symbols)}")
            return self.free
        viscous = tuple(s for s in symbols if VISCOUS.fullmatch(s))
        chosen = {"viscous": viscous, "elastic": tuple(s for s in symbols if s not in viscous), "all": tuple(symbols)}
        return chosen[self.free]


@dataclass(frozen=True)
class Options:
    """Settings for recordings that match a pattern: weight, geometry options of the model, or left out."""

    pattern: str
    weight: float = 1.0
    geometry: Mapping[str, Any] = field(default_factory=dict)
    skip: bool = False


@dataclass(frozen=True)
class Spec:
    """A fit. Parameters that are neither given nor the paper's free ones keep the model's default.

    Attributes
    ----------
    model : name of a forward model
    parameters : symbol -> number (held), 'free', Tied or Free, as in the YAML file
    geometry : options of the model for every recording; ``recordings`` refines them
    channels : channel -> weight; a channel left out counts 1, weight 0 leaves it out
    phases, phase_origin : weights over time, counted from the recording's first sample or from the load's beginning
    balance : 'samples', every sample counts alike, or 'recordings', every recording alike
    drive : 'measured', or 'commanded' (set-points) also where the drive was measured
    zero : 'free', each curve has an unknown zero of its own; 'fixed', zeros are as recorded; 'auto', those of heights
        are free, as a reading is zeroed to no better than its noise and drift, and those of forces as recorded
    samples : a recording of more samples is thinned to about so many
    optimiser, starts, spread, seed : how the optimum is sought; from ``starts`` points, the further ones drawn up to a
        factor ``spread`` (log parameters), or up to half the range between bounds (others), from the first. 'auto'
        tries further ones only where the first leaves more than noise, until two end in the same best place
    stages : steps of a staged fit
    profile : symbols whose profile likelihood is computed; 'all' of the free ones
    evaluations, tolerance : of one optimisation; relative change of the objective that ends it
    """

    model: str
    parameters: Mapping[str, float | Free | Tied | Literal["free"]] = field(default_factory=dict)
    geometry: Mapping[str, Any] = field(default_factory=dict)
    channels: Mapping[str, float] = field(default_factory=dict)
    recordings: tuple[Options, ...] = ()
    phases: tuple[Phase, ...] = ()
    phase_origin: Origin = "recording"
    balance: Balance = "samples"
    drive: Drive = "measured"
    zero: Zero = "auto"
    samples: int = 4000
    optimiser: Optimiser = "trust-region"
    starts: int | Literal["auto"] = "auto"
    spread: float = 3.0
    seed: int = 0
    stages: tuple[Stage, ...] = (Stage("all"),)
    profile: tuple[str, ...] | Literal["all"] = ()
    evaluations: int = 100
    tolerance: float = 1e-5

    def __post_init__(self) -> None:
        choices = {"optimiser": Optimiser, "drive": Drive, "balance": Balance, "phase_origin": Origin, "zero": Zero}
        for name, kind in choices.items():
            if getattr(self, name) not in get_args(kind):
                raise SpecError(f"{name}: {getattr(self, name)!r} is none of {', '.join(get_args(kind))}")
        for name, least in {"samples": 10, "starts": 1, "evaluations": 1, "seed": 0}.items():
            if not (name == "starts" and self.starts == "auto"):
                _whole(name, getattr(self, name), least)
        if not self.spread > 1.0:
            raise SpecError(f"spread: {self.spread} must be above 1")
        if not 0.0 < self.tolerance < 1.0:
            raise SpecError(f"tolerance: {self.tolerance} must lie between 0 and 1")
        self._check_weights()

    def _check_weights(self) -> None:
        for channel, weight in self.channels.items():
            if not weight >= 0.0:
                raise SpecError(f"channels.{channel}: weight {weight} must not be negative")
        for phase in self.phases:
            if not (phase.stop > phase.start and phase.weight >= 0.0):
                raise SpecError(
                    f"phases: from {phase.start} s to {phase.stop} s with weight {phase.weight} is no phase"
                )

    def variables(self, info: ModelInfo) -> Variables:
        """The free, tied and held parameters of a model. Raises SpecError naming the parameter that is wrong."""
        for symbol in self.parameters:
            if symbol not in info.symbols:
                raise SpecError(f"parameters.{symbol}: model {info.name} has {', '.join(info.symbols)}")
        asked = any(isinstance(value, Free) or value == "free" for value in self.parameters.values())
        values = info.defaults
        free, tied = [], []
        for parameter in info.parameters:
            symbol = parameter.symbol
            given = self.parameters.get(symbol, "free" if not asked and symbol in free_by_default(info) else None)
            if given == "free":
                free.append(Free.of(parameter))
            elif isinstance(given, Free):
                free.append(given.within(parameter))
            elif isinstance(given, Tied):
                tied.append(given)
            elif given is not None:
                values[symbol] = float(given)
        try:
            info.complete(values)
            return Variables(info, tuple(free), tuple(tied), values)
        except ValueError as error:
            raise SpecError(f"parameters: {error}") from error


def _whole(name: str, value: Any, least: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise SpecError(f"{name}: {value!r} must be a whole number of at least {least}")


def free_by_default(info: ModelInfo) -> tuple[str, ...]:
    """The parameters that a fit moves when nobody says otherwise: those that the papers identified."""
    if info.problem == "sheet":
        return tuple(s for s in info.symbols if not _HELD.fullmatch(s))
    return FREE.get(info.name.removesuffix("_gamma"), info.symbols)


def load_spec(path: Path | str, model: str = "", info: ModelInfo | None = None) -> Spec:
    """Read a specification file, of ``model`` where it names none; ``info`` of a model that is not registered.

    Raises SpecError that names file, line and field; FileNotFoundError.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise SpecError(f"{path}: not UTF-8 text") from None
    if len(text) > MAX_LENGTH:
        raise SpecError(f"{path}: more than {MAX_LENGTH} characters")
    try:
        tree, data = yaml.compose(text, Loader=yaml.SafeLoader), yaml.safe_load(text)
    except RecursionError:
        raise SpecError(f"{path}: nested too deeply") from None
    except (yaml.YAMLError, ValueError) as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark else ""
        raise SpecError(f"{path}{line}: not YAML: {getattr(error, 'problem', None) or error}") from None
    try:
        return read_spec({"model": model, **data} if isinstance(data, dict) else data, info)
    except SpecError as error:
        named = str(error).split(":")[0]
        raise SpecError(f"{path}:{_line(tree, named.split('.'))}: {error}") from error


def _line(node: Any, names: Sequence[str]) -> int:
    """Line of the deepest of nested keys that exists, from 1."""
    line = 1
    for depth, _ in enumerate(names):
        if not isinstance(node, yaml.MappingNode):
            break
        # a parameter's own name may hold dots
        for key, value in node.value:
            if key.value in (names[depth], ".".join(names[depth:])):
                line, node = key.start_mark.line + 1, value
                break
        else:
            break
    return line


def read_spec(data: Any, info: ModelInfo | None = None) -> Spec:
    """A Spec from plain data, as YAML gives it; numbers may carry units ('12 kPa').

    ``info`` describes the model where it is not registered under its name. Raises SpecError.
    """
    _check_form(data)
    values: dict[str, Any] = dict(data)
    info = info or _info(data["model"])
    values["parameters"] = {s: _parameter(info, str(s), v) for s, v in data.get("parameters", {}).items()}
    values["channels"] = {c: _number(w, "", f"channels.{c}") for c, w in data.get("channels", {}).items()}
    values["recordings"] = tuple(_options(str(p), o) for p, o in data.get("recordings", {}).items())
    values["geometry"] = _geometry(data.get("geometry", {}), "geometry")
    values["phases"] = tuple(_phase(p) for p in _list(data, "phases"))
    values["stages"] = tuple(_stage(s) for s in _list(data, "stages")) or (Stage("all"),)
    profile = data.get("profile", ())
    values["profile"] = profile if profile == "all" else tuple(_list(data, "profile"))
    for name in ("spread", "tolerance"):
        if name in data:
            values[name] = _number(data[name], "", name)
    spec = Spec(**values)
    spec.variables(info)
    return spec


def _check_form(data: Any) -> None:
    """Raise SpecError for keys that are unknown, and for what is no mapping where there must be one."""
    if not isinstance(data, Mapping):
        raise SpecError("model: a specification is a mapping with at least a model")
    known = set(Spec.__dataclass_fields__)
    for name in data:
        if name not in known:
            raise SpecError(f"{name}: unknown; there are {', '.join(sorted(known))}")
    if not isinstance(data.get("model"), str):
        raise SpecError("model: the name of a forward model is needed")
    for name in ("parameters", "geometry", "channels", "recordings"):
        if not isinstance(data.get(name, {}), Mapping):
            raise SpecError(f"{name}: must be a mapping")


def _info(name: str) -> ModelInfo:
    from ..registry import models

    try:
        return models()[name].info
    except KeyError as error:
        raise SpecError(f"model: {error.args[0]}") from None


def _number(value: Any, unit: str, where: str) -> float:
    try:
        return units.read(value, unit, where)
    except ValueError as error:
        raise SpecError(str(error)) from None


def _list(data: Mapping[str, Any], name: str) -> list[Any]:
    value = data.get(name) or []
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise SpecError(f"{name}: must be a list")
    return list(value)


def _keys(data: Any, where: str, *allowed: str) -> Mapping[str, Any]:
    if not isinstance(data, Mapping):
        raise SpecError(f"{where}: must be a mapping with {', '.join(allowed)}")
    for name in data:
        if name not in allowed:
            raise SpecError(f"{where}: unknown key {name!r}; there are {', '.join(allowed)}")
    return data


def _parameter(info: ModelInfo, symbol: str, given: Any) -> float | Free | Tied | Literal["free"]:
    where = f"parameters.{symbol}"
    if symbol not in info.symbols:
        raise SpecError(f"{where}: model {info.name} has {', '.join(info.symbols)}")
    parameter = info[symbol]
    if given == "free":
        return "free"
    if given == "fixed":
        return parameter.default
    if not isinstance(given, Mapping):
        return _number(given, parameter.unit, where)
    if "tied" in given:
        entry = _keys(given, where, "tied", "factor")
        return Tied(symbol, str(entry["tied"]), _number(entry.get("factor", 1.0), "", where))
    entry = _keys(given, where, "start", "lower", "upper", "scale", "prior")
    numbers = {k: _number(entry[k], parameter.unit, where) for k in ("start", "lower", "upper") if k in entry}
    scale = entry.get("scale", parameter.scale)
    if scale not in ("linear", "log"):
        raise SpecError(f"{where}: scale {scale!r} is neither linear nor log")
    try:
        prior = read_prior(entry["prior"], parameter.unit, "prior") if "prior" in entry else None
        return Free.of(parameter, log=scale == "log", prior=prior, **numbers)
    except ValueError as error:
        raise SpecError(f"{where}: {error}") from None


def _options(pattern: str, data: Any) -> Options:
    where = f"recordings.{pattern}"
    entry = _keys(data, where, "weight", "geometry", "skip")
    weight = _number(entry.get("weight", 1.0), "", where)
    if not weight >= 0.0:
        raise SpecError(f"{where}: weight {weight} must not be negative")
    return Options(pattern, weight, _geometry(entry.get("geometry", {}), where), bool(entry.get("skip", False)))


def _geometry(data: Any, where: str) -> dict[str, Any]:
    """Options as the model reads them; lengths and times may be written with units."""
    if not isinstance(data, Mapping):
        raise SpecError(f"{where}: must be a mapping")
    result: dict[str, Any] = {}
    for name, value in data.items():
        if isinstance(value, Mapping):
            result[name] = _geometry(value, f"{where}.{name}")
        elif isinstance(value, str) and re.match(r"[-+.\d]", value):
            unit = "s" if name.endswith(("time", "ramp")) else "m"
            result[name] = _number(value, unit, f"{where}.{name}")
        else:
            result[name] = value
    return result


def _phase(data: Any) -> Phase:
    entry = _keys(data, "phases", "from", "to", "weight")
    if "from" not in entry or "to" not in entry:
        raise SpecError("phases: each needs 'from' and 'to'")
    start, stop = (_number(entry[k], "s", "phases") for k in ("from", "to"))
    return Phase(start, stop, _number(entry.get("weight", 1.0), "", "phases"))


def _stage(data: Any) -> Stage:
    if isinstance(data, str):
        data = {"name": data, "free": data}
    entry = _keys(data, "stages", "name", "free", "recordings")
    free = entry.get("free", "all")
    if isinstance(free, str):
        if free not in ("viscous", "elastic", "all"):
            raise SpecError(f"stages: {free!r} is none of viscous, elastic, all, or a list of parameters")
    else:
        free = tuple(free)
    return Stage(str(entry.get("name", free)), free, tuple(str(r) for r in entry.get("recordings", ())))
