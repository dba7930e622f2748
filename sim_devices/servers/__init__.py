"""Simulated instruments as servers that speak real bytes: on a pseudo-terminal, a TCP port or a virtual USB bus.

>>> with serve("cutometer", link="tcp", speed=20.0) as server:  # doctest: +SKIP
...     rig = server.open_rig()
...     rig.device.connect()
...     server.back_door.truth().vented
True
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.device import Rig
from drivers.instrument import Entry
from drivers.signals import REFERENCE
from sim_devices.chain import Chain
from sim_devices.clock import Clock, ScaledClock
from sim_devices.servers.backdoor import BackDoor, Truth
from sim_devices.servers.bench import BENCHES, USB_ID, with_reference
from sim_devices.servers.instrument import SimInstrument
from sim_devices.servers.links import Link, PtyLink, TcpLink
from sim_devices.servers.ports import Render

__all__ = ["LINKS", "BackDoor", "Server", "Truth", "serve"]

LINKS = ("pty", "tcp", "usb")
_LINKS_OF = {"cutometer": ("pty", "tcp"), "aspiration": ("pty", "tcp"), "microrobot": ("usb", "tcp", "pty")}
_CAMERA_BUFFER = 2**20
#: Of the simulated camera, m/px, and the diameter of the rim that it sees, m.
FRAME_SCALE = 2e-5
RIM = 8e-3


class Server:
    """One running simulated instrument. ``entry`` is how a station reaches it, ``back_door`` is for tests."""

    def __init__(self, sim: SimInstrument, entry: Entry) -> None:
        self._sim = sim
        self.entry = entry
        self.bench = sim.bench
        self.back_door = BackDoor(sim)
        sim.start()

    def open_rig(self) -> Rig:
        """The instrument's rig on this server, not connected yet."""
        return self.bench.instrument.open_rig(self.entry)

    def close(self) -> None:
        """Switch it off. Idempotent."""
        self._sim.close()

    def __enter__(self) -> Server:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def serve(
    instrument: str,
    link: str = "",
    *,
    chain: Chain | None = None,
    speed: float = 1.0,
    clock: Clock | None = None,
    seed: int = 0,
    port: int = 0,
    camera: bool = True,
    render: Render | None = None,
    frame_size: tuple[int, int] = (640, 480),
    options: Mapping[str, Any] | None = None,
    watchdog: float | None = None,
    token: str = "",
) -> Server:
    """Switch on a simulated instrument; use the result as a context manager or ``close`` it.

    ``link`` is ``pty``, ``tcp`` or ``usb`` (default: the first the instrument supports); ``port`` the TCP port (0: any
    free one). Without ``chain`` it is the nominal one with sensor noise and scatter by ``seed``. ``speed`` scales time,
    unless a ``clock`` is given. ``camera`` switches the aspiration device's camera, ``frame_size`` is (width, height)
    in px, always at the same scale. ``options`` and ``watchdog`` (s) go into the entry. With a ``token`` (8 to 64
    letters, digits, ``-`` or ``_``) TCP links let in only who says it; it is part of the addresses in the entry.

    Raises ValueError for an instrument, or a link that it does not have.
    """
    if instrument not in BENCHES:
        raise ValueError(f"no simulated instrument {instrument!r}; there are {', '.join(BENCHES)}")
    link = link or _LINKS_OF[instrument][0]
    if link not in _LINKS_OF[instrument]:
        raise ValueError(f"the simulated {instrument} has no link {link!r}; it has {', '.join(_LINKS_OF[instrument])}")
    bench, options = BENCHES[instrument], dict(options or {})
    if options.get(f"pressure{REFERENCE}") is True and instrument != "microrobot":
        bench = with_reference(bench, seed)
    if chain is None:
        from sim_devices.stages import noisy, nominal

        chain = noisy(nominal(instrument), seed)
    control: Link = PtyLink() if link == "pty" else TcpLink(port, token=token)
    frames = None
    if bench.seen and camera:
        from sim_devices.stages.scene import Scene

        frames = TcpLink(send_buffer=_CAMERA_BUFFER, token=token)
        # In a small frame the rim is drawn narrower, so that the scale stays the one that stations state.
        rim = min(RIM, 0.7 * frame_size[0] * FRAME_SCALE)
        render = render or Scene(frame_size, FRAME_SCALE, rim, seed=seed)
    sim = SimInstrument(bench, chain, clock or ScaledClock(speed), control, frames, render)
    extra: dict[str, Any] = {} if watchdog is None else {"watchdog": watchdog}
    if instrument == "microrobot":
        # The host turns forces on the transducers into the force on the probe: an effect there is a wrong matrix here.
        options.setdefault("force_matrix", [float(m) for m in chain["force_matrix"].matrix])  # type: ignore[attr-defined]
    if link == "usb":
        from sim_devices.servers.usb import VirtualDevice, VirtualUsb

        assert isinstance(control, TcpLink)
        address = f"usb:{USB_ID[0]:04X}:{USB_ID[1]:04X}"
        extra["usb_backend"] = VirtualUsb(VirtualDevice(*USB_ID, control.port, token))
    else:
        address = control.address
    entry = Entry(
        instrument=instrument,
        address=address,
        simulated=True,
        sources={"camera": frames.address} if frames else {},
        options=options,
        **extra,
    )
    return Server(sim, entry)
