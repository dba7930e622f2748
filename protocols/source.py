"""YAML read with care: plain data, and where in the text each piece stands, so that every fault has a line.

Files come from other people: the size is capped, and anchors, aliases, merges, tags and repeated keys are refused
(protocols need none of them, and aliases are how a few hundred bytes of YAML become gigabytes).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from protocols.errors import Problem, ProtocolError
from protocols.files import NUMBER, UNSTORABLE, contents, shortened

MAX_BYTES = 256 * 1024
MAX_DEPTH = 24
MAX_NODES = 50_000  # before aliases, where they are allowed, are written out, and after
Key = tuple[str | int, ...]


@dataclass(frozen=True)
class Source:
    """The text of a protocol, its file, and the line and column (from 1) of each key and value by its path.

    Two sources are equal whatever they hold: the place of a protocol is no part of its meaning.
    """

    file: str = ""
    text: str = ""
    keys: dict[Key, tuple[int, int]] = field(default_factory=dict, repr=False)
    values: dict[Key, tuple[int, int]] = field(default_factory=dict, repr=False)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Source)

    def problem(self, path: Key, message: str, *, at_key: bool = False) -> Problem:
        """A fault at ``path``, or at the nearest place above it that is in the text."""
        marks = self.keys if at_key else self.values
        place = path
        while place and place not in marks:
            place = place[:-1]
        line, column = marks.get(place) or self.values.get(place, (0, 0))
        return Problem(message, spell(path), line, column)

    def fault(self, path: Key, message: str) -> ProtocolError:
        """One `problem` as an exception."""
        return ProtocolError((self.problem(path, message),), self.file)


def spell(path: Key) -> str:
    """``("steps", 2, "rate")`` as ``steps[2].rate``."""
    return "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in path).lstrip(".")


def read(path_or_text: str | Path, *, aliases: bool = False) -> tuple[Any, Source]:
    """Plain data (dict, list, scalars) and its `Source`; a string with a line break is text, any other a path.

    ``aliases`` lets anchors and aliases pass, because programs that dump YAML write them for whatever they hold twice.

    Raises ProtocolError: unreadable, too large, not YAML, or YAML of a kind that is refused.
    """
    if isinstance(path_or_text, str) and "\n" in path_or_text:
        file, text = "<text>", path_or_text
        if len(text) > MAX_BYTES:
            raise ProtocolError((Problem(f"the text is larger than {MAX_BYTES // 1024} kB"),), file)
    else:
        file = str(path_or_text)
        text = _contents(Path(path_or_text))
    source = Source(file, text)
    try:
        _refuse_tricks(text, source, aliases)
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = _place(mark) if mark else (0, 0)
        what = " ".join(part for part in (error.context, error.problem) if part)
        raise ProtocolError((Problem(f"not YAML: {what}", "", line, column),), file) from None
    except yaml.reader.ReaderError as error:
        before = text[: error.position]
        line, column = before.count("\n") + 1, error.position - before.rfind("\n")
        raise ProtocolError(
            (Problem(f"not YAML: forbidden character {text[error.position]!r}", "", line, column),), file
        ) from None
    if node is None:
        raise ProtocolError((Problem("the file is empty" if file != "<text>" else "the text is empty"),), file)
    return _plain(node, (), source), source


def _contents(path: Path) -> str:
    try:
        raw = contents(path, MAX_BYTES)
    except (OSError, ValueError) as error:
        raise ProtocolError((Problem(str(error).removeprefix(f"{path}: ")),), str(path)) from None
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise ProtocolError((Problem("not UTF-8 text", "", line, 1),), str(path)) from None


def _refuse_tricks(text: str, source: Source, aliases: bool) -> None:
    """Look at the stream of events, which needs no recursion, before any tree is built of it."""
    depth = nodes = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        refused = ""
        if isinstance(event, yaml.AliasEvent) and not aliases:
            refused = "aliases (*name) are not allowed"
        elif isinstance(event, yaml.NodeEvent) and event.anchor is not None and not aliases:
            refused = "anchors (&name) are not allowed"
        elif isinstance(event, (yaml.ScalarEvent, yaml.CollectionStartEvent)) and event.tag is not None:
            refused = f"tags ({event.tag}) are not allowed"
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        nodes += isinstance(event, yaml.NodeEvent)
        if depth > MAX_DEPTH:
            refused = f"nested deeper than {MAX_DEPTH} levels"
        elif nodes > MAX_NODES:
            refused = f"more than {MAX_NODES} entries"
        if refused:
            raise ProtocolError((Problem(refused, "", *_place(event.start_mark)),), source.file)


def _plain(node: yaml.Node, path: Key, source: Source) -> Any:
    source.values[path] = _place(node.start_mark)
    if len(path) > MAX_DEPTH or len(source.values) > MAX_NODES:
        raise source.fault(path[:4], "aliases make it too large or endless")
    if isinstance(node, yaml.MappingNode):
        return _mapping(node, path, source)
    if isinstance(node, yaml.SequenceNode):
        return [_plain(item, (*path, index), source) for index, item in enumerate(node.value)]
    return _scalar(node, path, source)


def _mapping(node: yaml.MappingNode, path: Key, source: Source) -> dict[str, Any]:
    mapping: dict[str, Any] = {}
    for key_node, value_node in node.value:
        place = _place(key_node.start_mark)
        key = _scalar(key_node, path, source) if isinstance(key_node, yaml.ScalarNode) else None
        if not isinstance(key, str) or key_node.tag == "tag:yaml.org,2002:merge":
            said = repr(key_node.value) if isinstance(key_node, yaml.ScalarNode) else "a collection"
            raise ProtocolError((Problem(f"a key must be a word, not {said}", spell(path), *place),), source.file)
        inner = (*path, key)
        if key in mapping:
            message = f"repeated key (first in line {source.keys[inner][0]})"
            raise ProtocolError((Problem(message, spell(inner), *place),), source.file)
        source.keys[inner] = place
        mapping[key] = _plain(value_node, inner, source)
    return mapping


def _place(mark: Any) -> tuple[int, int]:
    """Line and column, from 1, of PyYAML's mark."""
    return mark.line + 1, mark.column + 1


_TEXTS = ("tag:yaml.org,2002:merge", "tag:yaml.org,2002:timestamp")
_NUMERIC = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
_NOT_FINITE = re.compile(r"[-+]?\.(inf|nan)", re.IGNORECASE)


def _scalar(node: yaml.Node, path: Key, source: Source) -> Any:
    said = str(node.value)
    if UNSTORABLE.search(said):
        raise source.fault(path, f"a text cannot hold {UNSTORABLE.findall(said)[0]!r}")
    if node.tag in _TEXTS:
        return said
    if getattr(node, "style", "") is None and (NUMBER.fullmatch(said) or node.tag in _NUMERIC):
        return _number(said, path, source)
    try:
        return yaml.SafeLoader("").construct_object(node)
    except (yaml.YAMLError, ValueError, OverflowError):
        raise source.fault(path, f"cannot be understood: {said[:40]!r}") from None


def _number(said: str, path: Key, source: Source) -> str | int | float:
    """The number that a text without quotes is; one that begins with zeros is a name (``subject: 007``).

    YAML 1.1 reads 1_0 as ten, 0x10 as sixteen and 1:30 as ninety, and 1e3 as a text: nobody here means that.
    """
    if re.fullmatch(r"[-+]?0\d+", said, re.ASCII):
        return said
    if re.fullmatch(r"[-+]?\d{1,18}", said, re.ASCII):
        return int(said)
    if NUMBER.fullmatch(said):
        value = float(said)
        if math.isinf(value):
            raise source.fault(path, f"{shortened(said)!r} is too large")
        return value
    if _NOT_FINITE.fullmatch(said):
        return float(said.replace(".", ""))
    raise source.fault(path, f"{shortened(said)!r} is not a plain number; in quotes it is a text")


class _Dumper(yaml.SafeDumper):
    """Writes a text of several lines as a block, one that `read` would take for a number in quotes, nothing as an
    alias."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    style = "|" if "\n" in text else "'" if NUMBER.fullmatch(text) else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _text)


def written(data: Any) -> str:
    """Plain ``data`` as YAML that `read` reads back as they are."""
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=110)
