"""The library of protocols that come with the package."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from protocols.errors import Problem, ProtocolError
from protocols.files import is_file, shortened
from protocols.text import resembling


def library() -> dict[str, Path]:
    """Name (the file's stem) and path of every protocol in ``protocols/library``, in alphabetical order."""
    folder = Path(str(resources.files("protocols") / "library"))
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def find(name_or_path: str | Path) -> Path:
    """The file at a path, or the library's protocol of that name. Raises ProtocolError.

    A path that is gone is no misspelt name: the library's names would tell nothing.
    """
    path = Path(name_or_path)
    if is_file(path):
        return path
    known = library()
    name = str(name_or_path).removesuffix(".yaml")
    if name in known:
        return known[name]
    message = "no such file"
    if path.parent == Path() and path.suffix != ".yml":
        close = resembling(name, known)
        hint = f"did you mean {close!r}?" if close else f"'acquire check' lists its {len(known)}"
        message = f"no such file, and no protocol of that name in the library; {hint}"
    raise ProtocolError((Problem(message),), shortened(str(name_or_path)))
