"""ETH aspiration device: a pressure controller on a serial link and a camera that sees the tissue bubble from the side.

Options of a station entry: ``baudrate`` (115200), ``pressure_reference`` (false: whether a second gauge is fitted); of
the camera ``frame_scale`` (0.02 mm/px, assumed), and of the live apex height ``gvt`` (grey-value threshold; none:
proposed), ``apex`` (up or down), ``tissue`` (dark or bright).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from drivers.device import Rig, Source
from drivers.instrument import Entry, Instrument, permit
from drivers.options import reference, take
from drivers.signals import Channel
from protocols import units
from protocols.limits import Limits, Range

MBAR = 100.0

PRESSURE = Channel("pressure", "Pa", "actuator", (-700 * MBAR, 0.0), 10.0)
APEX = Channel("apex_height", "m", "processing", (0.0, 8e-3), 2e-6)

#: Suction to 700 mbar (reported), for five minutes at a time (assumed).
LIMITS = Limits({"pressure": Range(-700 * MBAR, 0.0, dwell=300.0)}, "hardware")


def open_rig(entry: Entry) -> Rig:
    """The rig of a station entry; its links are opened by ``connect``.

    Raises NotAllowed on a real port whose dialect nobody vouches for, ValueError for an unknown option or source.
    """
    from drivers.aspiration.pressure import CAPACITY, PressureCodec
    from drivers.stream import StreamDevice
    from drivers.transports import open_transport

    permit(entry, "this driver's dialect is assumed and was never verified on a real controller")
    options = take(
        entry, baudrate=115200, pressure_reference=False, frame_scale="0.02 mm/px", gvt=None, apex="up", tissue="dark"
    )
    channels = (PRESSURE, *reference(PRESSURE, options))
    device = StreamDevice(
        "aspiration",
        open_link=lambda: open_transport(entry.address, baudrate=options["baudrate"]),
        codec=partial(PressureCodec, reference=options["pressure_reference"]),
        channels=channels,
        quantities=("pressure",),
        capacity=CAPACITY,
        watchdog=entry.watchdog,
        simulated=entry.simulated,
        convert=lambda raw: {c.name: raw[:, k] for k, c in enumerate(channels)},
    )
    unknown = sorted(set(entry.sources) - set(INSTRUMENT.sources))
    if unknown:
        raise ValueError(f"aspiration: unknown source {unknown[0]!r}; it has {', '.join(INSTRUMENT.sources)}")
    cameras = tuple(_camera(name, address, options) for name, address in entry.sources.items())
    return Rig("aspiration", device, cameras)


def _camera(name: str, address: str, options: Mapping[str, Any]) -> Source:
    from drivers.aspiration.camera import FramedCamera, UvcCamera
    from drivers.aspiration.contour import Settings
    from drivers.aspiration.live import LiveApex

    settings = Settings(gvt=options["gvt"], apex=options["apex"], tissue=options["tissue"])
    kind = UvcCamera if address.startswith("uvc:") else FramedCamera
    return kind(name, address, (APEX,), LiveApex(units.parse(options["frame_scale"], "scale"), settings))


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
