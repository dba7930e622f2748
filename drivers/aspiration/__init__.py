"""ETH aspiration device: a pressure controller on a serial link and a camera that sees the tissue bubble from the side.

Options of a station entry: ``baudrate`` (115200).
"""

from __future__ import annotations

from drivers.device import Rig, Source
from drivers.instrument import Entry, Instrument
from drivers.options import take
from drivers.signals import Channel
from protocols.limits import Limits, Range

MBAR = 100.0

PRESSURE = Channel("pressure", "Pa", "actuator", (-700 * MBAR, 0.0), 10.0)
APEX = Channel("apex_height", "m", "processing", (0.0, 8e-3), 2e-6)

#: Suction to 700 mbar (reported).
LIMITS = Limits({"pressure": Range(-700 * MBAR, 0.0)}, "hardware")


def open_rig(entry: Entry) -> Rig:
    """The rig of a station entry; its links are opened by ``connect``.

    Raises ValueError for an unknown option or source.
    """
    from drivers.aspiration.pressure import CAPACITY, PressureCodec
    from drivers.stream import StreamDevice
    from drivers.transports import open_transport

    options = take(entry, baudrate=115200)
    device = StreamDevice(
        "aspiration",
        open_link=lambda: open_transport(entry.address, baudrate=options["baudrate"]),
        codec=PressureCodec,
        channels=(PRESSURE,),
        quantities=("pressure",),
        capacity=CAPACITY,
        watchdog=entry.watchdog,
        convert=lambda raw: {PRESSURE.name: raw[:, 0]},
    )
    unknown = sorted(set(entry.sources) - set(INSTRUMENT.sources))
    if unknown:
        raise ValueError(f"aspiration: unknown source {unknown[0]!r}; it has {', '.join(INSTRUMENT.sources)}")
    cameras = tuple(_camera(name, address) for name, address in entry.sources.items())
    return Rig("aspiration", device, cameras)


def _camera(name: str, address: str) -> Source:
    from drivers.aspiration.camera import FramedCamera, UvcCamera

    kind = UvcCamera if address.startswith("uvc:") else FramedCamera
    return kind(name, address, (APEX,), None)


INSTRUMENT = Instrument(
    name="aspiration",
    title="ETH aspiration device",
    channels=(PRESSURE, APEX),
    quantities=("pressure",),
    limits=LIMITS,
    transports=("serial", "socket"),
    open_rig=open_rig,
    sources=("camera",),
)
