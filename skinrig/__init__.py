"""skinrig in Python: run a protocol, read recordings, fit a model, and diagnose why simulation and measurement differ.

The one public import; the packages behind it (``acquire``, ``drivers``, ``gap``, …) may change.

>>> import skinrig
>>> outcome = skinrig.run("demo-cutometer", skinrig.simulated_station(), speed=50)      # doctest: +SKIP
>>> recordings = [skinrig.load(outcome.recording)]                                      # doctest: +SKIP
>>> diagnosis = skinrig.diagnose(recordings)                                            # doctest: +SKIP
>>> print(skinrig.as_json(diagnosis)["sentences"])                                      # doctest: +SKIP
>>> skinrig.write_page(diagnosis, Path("gap.html"))                                     # doctest: +SKIP
>>> result = skinrig.fit(recordings, model="suction")                                   # doctest: +SKIP

Nothing is imported before it is used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from acquire.recording import Recording, load
    from acquire.session import Session
    from acquire.station import Station, load_station, simulated_station
    from gap import Diagnosis, ForwardModel, as_json, diagnose, load_model, plan, write_page
    from skinrig.work import fit, run

_HOMES = {
    "load": "acquire.recording", "Recording": "acquire.recording",
    "Session": "acquire.session",
    "Station": "acquire.station", "load_station": "acquire.station", "simulated_station": "acquire.station",
    "diagnose": "gap", "Diagnosis": "gap", "as_json": "gap", "write_page": "gap", "plan": "gap",
    "ForwardModel": "gap", "load_model": "gap",
    "run": "skinrig.work", "fit": "skinrig.work",
}  # fmt: skip

__all__ = [
    "Diagnosis", "ForwardModel", "Recording", "Session", "Station", "as_json", "diagnose", "fit", "load", "load_model",
    "load_station", "plan", "run", "simulated_station", "write_page",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'skinrig' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
