"""Switching on the simulated instruments of a station. Only sessions, the command line and tests use this module."""

from __future__ import annotations

import secrets
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from acquire.station import Instrument, Simulation

if TYPE_CHECKING:
    from sim_devices.chain import Chain
    from sim_devices.servers import Server

#: Stiffness of a reference specimen relative to skin: a rigid block does not follow, open air does not resist.
SPECIMENS = {"skin": 1.0, "rigid block": 1e6, "open air": 1e-6}


def settled(simulation: Simulation) -> Simulation:
    """The same with a seed, drawn where none was given, so that the recording tells it."""
    if simulation.seed is not None:
        return simulation
    return simulation.model_copy(update={"seed": secrets.randbelow(2**31)})


def chain(kind: str, simulation: Simulation, *, opening: float | None = None, specimen: str = "skin") -> Chain:
    """The forward chain of a simulated instrument with its tissue, noise and effects.

    ``opening`` is the probe's diameter in m (suction). Raises ValueError for an unknown tissue, effect or specimen.
    """
    from sim_devices.stages import noisy, nominal

    options: dict[str, Any] = {"tissue": _specimen(kind, simulation.tissue, specimen)}
    if opening is not None and kind != "microrobot":
        options["opening"] = opening
    result = noisy(nominal(kind, **options), simulation.seed or 0)
    for text in simulation.effects:
        from sim_devices.effects import parse_effect

        effect, values = parse_effect(text, kind)
        result = effect.apply(result, values)
    _compiled(kind, result)
    return result


def _compiled(kind: str, chain: Chain) -> None:
    """Have the chain's kernels compiled now: an instrument that compiles while it runs answers nobody for seconds."""
    import numpy as np

    from sim_devices.chain import Runner
    from sim_devices.servers.bench import BENCHES

    time = np.arange(4, dtype=np.float64) * 1e-3
    Runner(chain).advance(time, {name: np.zeros(len(time)) for name in BENCHES[kind].command.values()})


def start(
    kind: str,
    entry: Instrument,
    *,
    speed: float = 1.0,
    opening: float | None = None,
    specimen: str = "skin",
    frame_size: tuple[int, int] = (640, 480),
) -> Server:
    """Switch on the simulated instrument of a station's entry. Close the result to switch it off."""
    from sim_devices.servers import serve

    assert entry.simulated is not None
    simulation = settled(entry.simulated)
    # TCP works on every system and copes with any load; pseudo-terminals do neither.
    automatic = "usb" if kind == "microrobot" else "tcp"
    link = automatic if simulation.link == "auto" else simulation.link
    return serve(
        kind,
        link,
        chain=chain(kind, simulation, opening=opening, specimen=specimen),
        speed=speed,
        seed=simulation.seed or 0,
        frame_size=frame_size,
        options=entry.driver_options,
        watchdog=entry.watchdog,
        token=secrets.token_urlsafe(16),
    )


def _specimen(kind: str, tissue: str, specimen: str) -> Any:
    """The tissue, or a reference specimen in its place."""
    if specimen not in SPECIMENS:
        raise ValueError(f"no simulated specimen {specimen!r}; there is {', '.join(SPECIMENS)}")
    if specimen == "skin":
        return tissue
    from sim_devices.stages import tissues

    if kind == "microrobot":
        sheet = tissues.sheet_tissue(tissue)
        a, b, c = (k * SPECIMENS[specimen] for k in sheet.stiffness)
        return replace(sheet, stiffness=(a, b, c))
    if specimen == "open air":
        raise ValueError("a suction probe in open air holds no pressure: simulate 'rigid block' or 'skin'")
    skin = tissues.suction_tissue(tissue)
    return replace(skin, compliance=skin.compliance / SPECIMENS[specimen])
