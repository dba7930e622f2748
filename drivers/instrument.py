"""How an instrument presents itself to the application: what it measures and may do, and how one is opened.

Each instrument's package exports ``INSTRUMENT`` (entry point ``acquire.instruments``); importing it is cheap.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from drivers.device import DeviceError, Rig
from drivers.signals import Channel
from protocols.limits import Limits

#: Wall time in s without a heartbeat after which a device makes itself safe: by default, and the least and most that
#: a station may ask for. Beats come every 0.05 s; a second of unattended suction is the most that can be defended.
WATCHDOG = 0.25
WATCHDOG_BOUNDS = (0.1, 1.0)


class NotAllowed(DeviceError):
    """The station does not permit to open this link (for example a codec that nobody verified on hardware)."""


@dataclass(frozen=True)
class Entry:
    """One instrument of a station: where its links are, and the station's calibration and limits.

    ``address`` is the driven device's link: ``/dev/tty*`` or another serial port, ``socket://host:port``,
    ``usb:VID:PID``.
    ``sources`` maps further sources to their links (``{"camera": "socket://…"}`` or ``"uvc:0"``). ``options`` are the
    instrument's own settings (its package documents them). ``usb_backend`` is a ``usb.backend.IBackend`` for virtual
    devices; None takes the system's. ``watchdog`` is in s of wall time. Raises ValueError for one out of its bounds.
    """

    instrument: str
    address: str
    simulated: bool = False
    i_have_verified_the_codec: bool = False
    sources: Mapping[str, str] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    watchdog: float = WATCHDOG
    usb_backend: Any = None

    def __post_init__(self) -> None:
        least, most = WATCHDOG_BOUNDS
        if not least <= self.watchdog <= most:
            raise ValueError(f"{self.instrument}: a watchdog of {self.watchdog:g} s; it must be {least:g} … {most:g} s")


@dataclass(frozen=True)
class Instrument:
    """An instrument's descriptor.

    ``channels`` are all it can deliver, ``quantities`` are commanded, ``limits`` are those of the hardware,
    ``transports`` the kinds of link of the driven device (``serial``, ``socket``, ``usb``), ``sources`` the names of
    further links a rig may have. ``open_rig`` builds the rig of a station entry without touching the link; it raises
    `NotAllowed` where the station does not permit it and ValueError for options it does not know.
    """

    name: str
    title: str
    channels: tuple[Channel, ...]
    quantities: tuple[str, ...]
    limits: Limits
    transports: tuple[str, ...]
    open_rig: Callable[[Entry], Rig]
    sources: tuple[str, ...] = ()


def permit(entry: Entry, why: str) -> None:
    """See that the station permits to open an entry's links; ``why`` says why a real port needs its word.

    ``simulated`` is believed of this computer's TCP ports, pseudo-terminals and virtual USB only, and even there the
    instrument's identity has to confirm it (see `drivers.stream.StreamDevice`). Elsewhere an instrument can be reached
    over TCP alone, where asking who it is does no harm. Raises NotAllowed, ValueError (an address that means nothing).
    """
    from drivers.transports import is_local_simulator, kind_of

    kind = kind_of(entry.address)
    if entry.i_have_verified_the_codec:
        return
    if not entry.simulated:
        raise NotAllowed(
            f"{entry.instrument} on {entry.address}: {why}, or put 'i_have_verified_the_codec: true' into the station "
            "file"
        )
    if entry.usb_backend is None and kind != "socket" and not is_local_simulator(entry.address):
        raise NotAllowed(
            f"{entry.instrument} on {entry.address}: a real port is not 'simulated: true' (a pseudo-terminal or "
            "socket:// is); say 'i_have_verified_the_codec: true' if it is so"
        )
