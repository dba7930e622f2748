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
from sim_devices.servers.bench import BENCHES, USB_ID, Bench, with_reference
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
    link = _link(instrument, link)
    options = dict(options or {})
    bench = _bench(instrument, options, seed)
    chain = _nominal(instrument, seed) if chain is None else chain
    control: PtyLink | TcpLink = PtyLink() if link == "pty" else TcpLink(port, token=token)
    frames = None
    if bench.seen and camera:
        frames = TcpLink(send_buffer=_CAMERA_BUFFER, token=token)
        render = render or _scene(frame_size, seed)
    sim = SimInstrument(bench, chain, clock or ScaledClock(speed), control, frames, render)
    extra: dict[str, Any] = {} if watchdog is None else {"watchdog": watchdog}
    address = control.address
    if link == "usb":
        address = f"usb:{USB_ID[0]:04X}:{USB_ID[1]:04X}"
        extra["usb_backend"] = _virtual_usb(control, token)
    if instrument == "microrobot":
        # The host turns forces on the transducers into the force on the probe: an effect there is a wrong matrix here.
        options.setdefault("force_matrix", _force_matrix(chain))
    entry = Entry(
        instrument=instrument,
        address=address,
        simulated=True,
        sources={"camera": frames.address} if frames else {},
        options=options,
        **extra,
    )
    return Server(sim, entry)


def _link(instrument: str, asked: str) -> str:
    """The link to an instrument: the one asked for, by default its first. Raises ValueError."""
    if instrument not in BENCHES:
        raise ValueError(f"no simulated instrument {instrument!r}; there are {', '.join(BENCHES)}")
    links = _LINKS_OF[instrument]
    if asked and asked not in links:
        raise ValueError(f"the simulated {instrument} has no link {asked!r}; it has {', '.join(links)}")
    return asked or links[0]


def _bench(instrument: str, options: Mapping[str, Any], seed: int) -> Bench:
    """An instrument's bench, of suction with a second gauge where the options ask for one."""
    if options.get(f"pressure{REFERENCE}") is True and instrument != "microrobot":
        return with_reference(BENCHES[instrument], seed)
    return BENCHES[instrument]


def _nominal(instrument: str, seed: int) -> Chain:
    from sim_devices.stages import noisy, nominal

    return noisy(nominal(instrument), seed)


def _scene(frame_size: tuple[int, int], seed: int) -> Render:
    """The scene before the camera. In a small frame the rim is drawn narrower, so that the scale stays the one that
    stations state."""
    from sim_devices.stages.scene import Scene

    return Scene(frame_size, FRAME_SCALE, min(RIM, 0.7 * frame_size[0] * FRAME_SCALE), seed=seed)


def _virtual_usb(control: Link, token: str) -> object:
    """A pyusb backend of one device, behind the TCP link of its instrument."""
    from sim_devices.servers.usb import VirtualDevice, VirtualUsb

    assert isinstance(control, TcpLink)
    return VirtualUsb(VirtualDevice(*USB_ID, control.port, token))


def _force_matrix(chain: Chain) -> list[float]:
    return [float(m) for m in chain["force_matrix"].matrix]  # type: ignore[attr-defined]
