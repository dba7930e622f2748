"""A run and a fit in one call each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from acquire.engine import Outcome
from acquire.plugins import solver
from acquire.recording import Recording
from acquire.session import Request, Session
from acquire.station import Station, load_station


def run(
    protocol: str | Path,
    station: Station | Path | str,
    *,
    instrument: str = "",
    out: Path | str = "runs",
    speed: float = 1.0,
    **request: Any,
) -> Outcome:
    """Run a protocol (a file, or a name of the library) on a station (or its file) and record it in the folder ``out``.

    ``instrument`` is the station's (default: the first of the protocol's kind); ``speed`` is for simulated ones;
    ``request`` are fields of `acquire.session.Request`, such as ``subject="P07"``. Returns when the run has ended and
    the instrument is safe: ``outcome.status``, ``outcome.recording``. Raises ValueError for a fault in protocol or
    station, and DeviceError where an instrument does not answer.
    """
    bench = station if isinstance(station, Station) else load_station(Path(station))
    with Session(bench, speed=speed, out=Path(out)) as session:
        return session.run(str(protocol), Request(**request), name=instrument)


def fit(recordings: Sequence[Recording], spec: Path | str | None = None, *, model: str = "", **more: Any) -> Any:
    """Fit a solver plugin's model to recordings, with free parameters, bounds and weights from ``spec`` (YAML).

    One of ``model`` and ``spec`` is needed; ``more`` goes to the solver (``jobs=2``, ``posterior=True``). The result
    has ``as_dict()``, ``in_words()`` and ``write_page(path)``. Raises ValueError where no solver is installed, or where
    none knows the model.
    """
    return solver(model).fit(recordings, Path(spec) if spec else None, model=model, **more)
