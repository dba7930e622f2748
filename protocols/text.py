"""Protocols as text: `load` and `dump` YAML, and the JSON schema for editors."""

from __future__ import annotations

import difflib
import typing
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from protocols.errors import Problem, ProtocolError
from protocols.schema import NAMED, Protocol
from protocols.source import Key, Source, read
from protocols.steps import STEPS

M = TypeVar("M", bound=BaseModel)


def load(path_or_text: str | Path) -> Protocol:
    """The protocol in a YAML file, or in a string that has a line break.

    Raises ProtocolError with every fault found: file, line, column and field.
    """
    data, source = read(path_or_text)
    protocol = validate(Protocol, data, source)
    protocol._read = source
    return protocol


def validate(model: type[M], data: Any, source: Source) -> M:
    """``data`` as read from ``source``, as an instance of ``model`` (of any YAML file, not only a protocol).

    Raises ProtocolError with every fault found: file, line, column and field.
    """
    if not isinstance(data, dict):
        raise source.fault((), f"a {model.__name__.lower()} is a mapping of keys, not a {type(data).__name__}")
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise ProtocolError(tuple(_problems(error, model, data, source)), source.file) from None


def dump(protocol: Protocol) -> str:
    """YAML text that `load` turns into an equal protocol; values at their defaults are left out."""
    data = protocol.model_dump(mode="json", by_alias=True, exclude_defaults=True)
    return yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=110)


def json_schema() -> dict[str, Any]:
    """JSON schema of protocol files, for editors (in VS Code: ``# yaml-language-server: $schema=schema.json``)."""
    schema = Protocol.model_json_schema(by_alias=True, mode="validation")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


ALIKE = 0.65
"""Ratio of letters in common from which on a word may be a misspelt other (`difflib`)."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """``; did you mean 'x'?``, or the list of names, to append to a message."""
    known = list(known)
    close = resembling(word, known)
    return f"; did you mean {close!r}?" if close else f"; there is {', '.join(known)}"


def resembling(word: str, known: Iterable[str], least: float = ALIKE) -> str:
    """The known name most like ``word``; '' where none is so by a ratio of ``least`` (`difflib`)."""
    return next(iter(difflib.get_close_matches(word, list(known), n=1, cutoff=least)), "")


WORDS = {
    **dict.fromkeys(("tuple_type", "list_type"), "expected a list"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "must be a whole number"),
    **dict.fromkeys(("bool_type", "bool_parsing"), "must be true or false"),
    "string_type": "must be text",
    "less_than_equal": "must be at most {le}",
    "greater_than_equal": "must be at least {ge}",
}
"""What a value of a wrong kind or size should be, by pydantic's types of errors and in the names of their bounds."""


def _problems(error: ValidationError, model: type[BaseModel], data: Any, source: Source) -> list[Problem]:
    """All faults in the order of the file, but missing keys last: often a misspelt key is the reason."""
    errors: list[dict[str, Any]] = [dict(e) for e in error.errors(include_url=False)]
    places = {e["loc"] for e in errors}
    found = []
    for one in errors:
        # Pydantic counts only the valid entries of a list; the faults of the others are reported by themselves.
        hollow = one["type"] == "too_short" and any(p[: len(one["loc"])] == one["loc"] != p for p in places)
        if not hollow:
            problem = _problem(one, model, data, source)
            found.append((one["type"] == "missing", problem.line, problem.column, problem))
    return [entry[-1] for entry in sorted(found, key=lambda entry: entry[:-1])]


def _problem(error: dict[str, Any], root: type[BaseModel], data: Any, source: Source) -> Problem:
    """One of pydantic's errors in the words of protocols, at its line."""
    path, model = _follow(tuple(part for part in error["loc"] if part != "[key]"), root, data)
    kind, context = error["type"], error.get("ctx", {})
    if kind == "extra_forbidden":
        meant = did_you_mean(str(path[-1]), _aliased(model))
        return source.problem(path, f"unknown key {path[-1]!r}{meant}", at_key=True)
    if kind == "missing":
        return source.problem(path, "is missing")
    if kind == "too_short":
        return source.problem(path, "must have at least one entry")
    if kind == "union_tag_not_found":
        return source.problem(path, f"a step needs a type: {', '.join(STEPS)}")
    if kind == "union_tag_invalid":
        message = f"unknown step type {context['tag']!r}{did_you_mean(str(context['tag']), STEPS)}"
        return source.problem((*path, "type"), message)
    if kind == "literal_error":
        choices = context["expected"].replace("'", "").replace(" or ", ", ").split(", ")
        return source.problem(path, f"{error['input']!r} is not known{did_you_mean(str(error['input']), choices)}")
    if kind == "string_pattern_mismatch":
        message = f"{error['input'][:40]!r} cannot be a name: it takes {NAMED}"
        return source.problem(path, message)
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        wanted = _model_of(model, str(path[-1])) if kind == "model_type" else model
        keys = f" ({', '.join(_aliased(wanted))})" if wanted.__name__ == context.get("class_name") else ""
        return source.problem(path, f"expected keys and values{keys}, not {str(error['input'])[:40]!r}")
    if kind in WORDS:
        given = "nothing" if error["input"] is None else repr(str(error["input"])[:40])
        return source.problem(path, f"{WORDS[kind].format(**context)}, not {given}")
    return source.problem(path, error["msg"].removeprefix("Value error, "))


def _follow(location: tuple[str | int, ...], root: type[BaseModel], data: Any) -> tuple[Key, type[BaseModel]]:
    """The path in the file of pydantic's location (without its step types), and the model its last part belongs to."""
    path: list[str | int] = []
    model = root
    last = len(location) - 1
    for index, part in enumerate(location):
        inside = isinstance(data, dict) and part in data
        if isinstance(part, str) and not inside and part in STEPS and path and isinstance(path[-1], int):
            model = STEPS[part]
            continue
        path.append(part)
        if index < last:
            data = data[part] if inside or isinstance(data, list) else None
            if isinstance(part, str):
                model = _model_of(model, part)
    return tuple(path), model


def _aliased(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """The fields of a model by the keys they have in a file."""
    return {f.alias or name: f for name, f in model.model_fields.items()}


def _model_of(model: type[BaseModel], name: str) -> type[BaseModel]:
    """The model that a field holds, itself or in a container; the parent when it holds none."""
    fields = _aliased(model)
    todo = [fields[name].annotation] if name in fields else []
    while todo:
        kind = todo.pop()
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            return kind
        todo.extend(typing.get_args(kind))
    return model
