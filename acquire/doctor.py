"""Common faults of an installation: files of other packages, libraries, permissions, versions, threads.

>>> all(c.remedy for c in examine() if c.level != "ok")
True
"""

from __future__ import annotations

import ctypes.util
import importlib.util
import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

OURS = ("skinrig", "acquire", "drivers", "protocols", "sim_devices", "gap")
"""Our top packages. Other projects have some of these names: pip installs both into one folder without a word."""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
Level = Literal["ok", "warning", "fault"]


@dataclass(frozen=True)
class Check:
    """One check: its finding, and the ``remedy`` where something is wrong."""

    name: str
    level: Level
    found: str
    remedy: str = ""


def examine() -> list[Check]:
    """Everything, in the order in which to mend it."""
    return [*packages(), *usb(), *serial_ports(), *qt(), *solver(), *threads()]


def packages(distributions: Iterable[metadata.Distribution] | None = None) -> list[Check]:
    """Files that another distribution has put into our packages, by the RECORD of each."""
    ours, foreign = _owners(metadata.distributions() if distributions is None else distributions)
    elsewhere = [name for name in OURS if not _is_here(name)]
    if elsewhere:
        text = f"{', '.join(elsewhere)} is loaded from another place than {home()}"
        return [Check("packages", "fault", text, "remove the other package, or install skinrig in a venv of its own")]
    if not foreign:
        return [Check("packages", "ok", f"no other distribution has files in {', '.join(OURS)}")]
    remedy = "install skinrig by itself: pipx install skinrig, uv tool install skinrig, or a venv of its own"
    return [Check("packages", "fault", _intruder(name, files, ours), remedy) for name, files in sorted(foreign.items())]


def _owners(distributions: Iterable[metadata.Distribution]) -> tuple[set[str], dict[str, list[str]]]:
    """Files in our packages: our own, and those of each other distribution."""
    ours: set[str] = set()
    foreign: dict[str, list[str]] = {}
    for distribution in distributions:
        name = distribution.metadata["Name"] or "?"
        files = [f.as_posix() for f in distribution.files or () if f.parts and f.parts[0] in OURS]
        if name.lower() == "skinrig":
            ours |= set(files)
        elif files:
            foreign[name] = files
    return ours, foreign


def _intruder(name: str, files: list[str], ours: set[str]) -> str:
    """A distribution with files in our packages, in words."""
    both = sorted(ours & set(files))
    hit = f"; {len(both)} of them, such as {both[0]}, are ours too and overwritten" if both else ""
    return f"{name} has {len(files)} files in our packages, such as {files[0]}{hit}"


def _is_here(package: str) -> bool:
    """Whether a package of ours is the one beside this file."""
    found = importlib.util.find_spec(package)
    return found is not None and found.origin is not None and Path(found.origin).parents[1] == home()


def usb(find: Callable[[str], str | None] = ctypes.util.find_library) -> list[Check]:
    """libusb, by which the micro-robot is reached."""
    if find("usb-1.0"):
        return [Check("libusb", "ok", "found")]
    text = "not found: the micro-robot cannot be reached over USB"
    return [Check("libusb", "warning", text, "apt install libusb-1.0-0, brew install libusb, or WinUSB by Zadig")]


def serial_ports(ports: Sequence[str] | None = None) -> list[Check]:
    """Whether this user may open the serial ports that there are."""
    if ports is None:
        from serial.tools.list_ports import comports

        ports = [p.device for p in comports()]
    shut = [p for p in ports if os.name == "posix" and not os.access(p, os.R_OK | os.W_OK)]
    if shut:
        remedy = "add yourself to the port's group (ls -l PORT; often: sudo usermod -aG dialout $USER), log in anew"
        return [Check("serial ports", "fault", f"no permission to open {', '.join(shut)}", remedy)]
    return [Check("serial ports", "ok", f"{', '.join(ports)} may be opened" if ports else "there are none")]


def qt() -> list[Check]:
    """Whether the window could open: PySide6 in a version that does not crash, with the libraries it loads."""
    if importlib.util.find_spec("PySide6") is None:
        return [Check("window", "warning", "PySide6 is not installed", "pip install 'skinrig[gui]' for the window")]
    version = metadata.version("PySide6")
    if tuple(int(n) for n in version.split(".")[:2]) >= (6, 12) or version in ("6.9.1", "6.9.2"):
        return [Check("window", "fault", f"PySide6 {version} crashes", "pip install 'PySide6<6.12,!=6.9.1,!=6.9.2'")]
    tried = subprocess.run(
        [sys.executable, "-c", "import PySide6.QtWidgets, pyqtgraph"],
        env={**os.environ, "QT_QPA_PLATFORM": "offscreen"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    if tried.returncode == 0:
        return [Check("window", "ok", f"PySide6 {version}")]
    last = (tried.stderr.strip().splitlines() or [f"exit status {tried.returncode}"])[-1]
    remedy = "apt install libegl1 libgl1 libxkbcommon0 libdbus-1-3 fontconfig (`make system` does)"
    return [Check("window", "fault", f"PySide6 {version} does not load: {last}", remedy)]


def solver() -> list[Check]:
    """Plugins that do not load, and whether there is a solver."""
    from acquire.plugins import GROUPS, plugins

    found = [p for group in GROUPS for p in plugins(group).values()]
    broken = [p for p in found if not p.working]
    checks = [
        Check("plugins", "fault", f"{p.name} ({p.value}) does not load: {p.error}", f"mend or remove {p.name}")
        for p in broken
    ]
    if any(p.group == "acquire.solvers" and p.working for p in found):
        return [*checks, Check("solver", "ok", "installed")]
    return [*checks, Check("solver", "warning", "none: acquire fit is not installed", "pip install ./solver")]


def threads(environment: dict[str, str] | None = None) -> list[Check]:
    """How many threads linear algebra may start: on few cores more than one makes small solves many times slower."""
    given = dict(os.environ) if environment is None else environment
    free = [name for name in THREADS if given.get(name) != "1"]
    if not free:
        return [Check("threads", "ok", "one each for linear algebra")]
    text = f"{', '.join(free)} not 1: small sparse solves may be many times slower"
    return [Check("threads", "warning", text, "export " + " ".join(f"{name}=1" for name in free))]


def home() -> Path:
    """The folder that the running skinrig is loaded from."""
    return Path(__file__).parents[1]
