"""Switching on the simulated instruments of a station. Only sessions, the command line and tests use this module."""

from __future__ import annotations

import secrets
import zlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from acquire.station import Instrument, Simulation
from protocols.specimens import MANOMETER, SKIN, Stated

if TYPE_CHECKING:
    from sim_devices.chain import Chain
    from sim_devices.servers import Server


@dataclass(frozen=True)
class Mounted:
    """The set-up of a simulated instrument: the probe's ``opening`` (m; None: its own), and the specimen in it with
    its properties (as `protocols.specimens.stated` gives them). ``times`` counts what was mounted before."""

    opening: float | None = None
    specimen: str = SKIN
    properties: tuple[tuple[str, Stated], ...] = ()
    times: int = field(default=0, compare=False)

    @property
    def number(self) -> int:
        """Of this mounting among all: 0 where the skin is measured first. Noise that came again in the recording of
        another specimen would look like a line of the instrument."""
        own = 0 if self.specimen == SKIN else zlib.crc32(repr((self.specimen, self.properties)).encode())
        return own + self.times


def settled(simulation: Simulation) -> Simulation:
    """The same with a seed, drawn where none was given, so that the recording tells it."""
    if simulation.seed is not None:
        return simulation
    return simulation.model_copy(update={"seed": secrets.randbelow(2**31)})


def chain(kind: str, simulation: Simulation, mounted: Mounted = Mounted()) -> Chain:
    """The forward chain of a simulated instrument with its tissue, noise and effects.

    Effects that a reference specimen does not meet leave it as it is. Raises ValueError for an unknown tissue, effect
    or specimen.
    """
    from sim_devices.stages import noisy, nominal, specimens

    options: dict[str, Any] = {"tissue": simulation.tissue}
    if mounted.opening is not None and kind != "microrobot":
        options["opening"] = mounted.opening
    result = noisy(nominal(kind, **options), simulation.seed or 0, mounting=mounted.number)
    if mounted.specimen != SKIN:
        result = specimens.mounted(result, mounted.specimen, dict(mounted.properties))
    for text in simulation.effects:
        from sim_devices.effects import parse_effect

        effect, values = parse_effect(text, kind)
        if specimens.meets(effect, mounted.specimen):
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
    mounted: Mounted = Mounted(),
    frame_size: tuple[int, int] = (640, 480),
) -> Server:
    """Switch on the simulated instrument of a station's entry. Close the result to switch it off."""
    from sim_devices.servers import serve
    from sim_devices.stages import remounted

    assert entry.simulated is not None
    simulation = settled(entry.simulated)
    second = {"pressure_reference": True} if mounted.specimen == MANOMETER else {}
    # TCP works on every system and copes with any load; pseudo-terminals do neither.
    automatic = "usb" if kind == "microrobot" else "tcp"
    link = automatic if simulation.link == "auto" else simulation.link
    return serve(
        kind,
        link,
        chain=chain(kind, simulation, mounted),
        speed=speed,
        seed=remounted(simulation.seed or 0, mounted.number),
        frame_size=frame_size,
        options={**entry.driver_options, **second},
        watchdog=entry.watchdog,
        token=secrets.token_urlsafe(16),
    )
