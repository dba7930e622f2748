"""Writing a session as recording bundles: one folder ``r01``, ``r02`` ... a recording, in the laboratory's units."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import yaml

from . import robot
from .session import Recording, Session
from .signals import Array

# Column, unit, units per SI unit, decimals
_COLUMNS: dict[str, tuple[str, str, float, int]] = {
    "pressure": ("p", "mbar", 1e-2, 3),
    "pressure_reference": ("p_ref", "mbar", 1e-2, 3),
    "apex_height": ("h", "mm", 1e3, 4),
    **{name: (name, "mm", 1e3, 4) for name in robot.AXES},
    **{name: (name, "N", 1.0, 4) for name in robot.LEGS},
    **{name: (name, "mm", 1e3, 5) for name in robot.PROBE},
    **{name: (name, "N", 1.0, 5) for name in robot.FORCE},
}
_LOGGED = {"pause": "vented and held", "resume": "resumed at the beginning of the interrupted segment"}


def write_csv(path: Path, header: list[str], columns: list[Array], decimals: list[int]) -> None:
    """A plain CSV file; ``decimals`` for each column."""
    line = ",".join(f"%.{d}f" for d in decimals) + "\n"
    table = np.stack(columns, axis=1) + 0.0  # no negative zeros
    path.write_text(",".join(header) + "\n" + (line * len(table)) % tuple(table.ravel().tolist()))


def _stated(r: Recording) -> dict[str, object]:
    """The stated numbers of a reference specimen, as bundles write them."""
    return {
        key: {"value": value[0] if len(value) == 1 else list(value), "se": se, "unit": unit}
        for key, (value, se, unit) in r.properties
    }


def write_recording(
    folder: Path, session: Session, index: int, channels: Mapping[str, list[Array]], subject: str, site: str
) -> None:
    """Write recording ``index`` of a session as a bundle (``recording-bundle/1``) into the new ``folder``."""
    folder.mkdir(parents=True)
    r = session.recordings[index]
    names, more = [n for n in channels if len(channels[n][index])], session.lab.decimals
    data = [session.stamps(index)] + [channels[n][index] * _COLUMNS[n][2] for n in names]
    digits = [4] + [_COLUMNS[n][3] + more for n in names]
    write_csv(folder / "data.csv", ["t"] + [_COLUMNS[n][0] for n in names], data, digits)
    t, commands = session.commanded(index)
    scaled = [v * _COLUMNS[n][2] for n, v in commands.items()]
    write_csv(folder / "command.csv", ["t"] + [_COLUMNS[n][0] for n in commands], [t, *scaled], [4] + [5] * len(scaled))

    def entry(name: str, file: str) -> dict[str, object]:
        column, unit, _, _ = _COLUMNS[name]
        return {"file": file, "column": column, "unit": unit, "time": {"column": "t", "unit": "s"}}

    log = [
        {"time": round(float(r.start + t), 4), "level": "info", "code": code, "text": _LOGGED[code]}
        for t, code in r.events
    ]
    text = yaml.safe_dump(
        {
            "schema": "recording-bundle/1",
            "instrument": session.instrument,
            "subject": subject,
            "site": site,
            "repeat": r.repeat,
            "specimen": r.specimen,
            "specimen_properties": _stated(r),
            "channels": {n: entry(n, "data.csv") for n in names},
            "setpoints": {n: entry(n, "command.csv") for n in commands},
        }
        | ({"events": log} if log else {})
        | ({"experiment": r.experiment} if r.experiment else {}),
        sort_keys=False,
    )
    (folder / "recording.yaml").write_text(text)
