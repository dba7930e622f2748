"""Cutometer MPA 580: suction probe with optical apex height, on a serial link.

Options of a station entry: ``baudrate`` (115200), ``pressure_reference`` (false: whether a second gauge is fitted).
"""

from __future__ import annotations

from functools import partial

from drivers.device import Rig
from drivers.instrument import Entry, Instrument, permit
from drivers.options import reference, take
from drivers.signals import Channel
from protocols.limits import Limits, Range

MBAR = 100.0

CHANNELS = (
    Channel("pressure", "Pa", "actuator", (-500 * MBAR, 0.0), 1 * MBAR),
    Channel("apex_height", "m", "sensor", (0.0, 4e-3), 1e-5),
)

#: Suction to 500 mbar (reported), for five minutes at a time (assumed); positive pressure is not possible, a gauge may
#: read a little above zero.
LIMITS = Limits({"pressure": Range(-500 * MBAR, 0.0, dwell=300.0)}, "hardware")


def open_rig(entry: Entry) -> Rig:
    """The rig of a station entry; the link is opened by ``connect``.

    Raises NotAllowed on a real port whose dialect nobody vouches for, ValueError for an unknown option.
    """
    from drivers.cutometer.codec import CAPACITY, CutometerCodec
    from drivers.stream import StreamDevice
    from drivers.transports import open_transport

    options = take(entry, baudrate=115200, pressure_reference=False)
    channels = (*CHANNELS, *reference(CHANNELS[0], options))
    permit(
        entry,
        "the wire protocol of the real instrument is not public and this driver's dialect was never verified on one; "
        "import exported curves instead",
    )
    device = StreamDevice(
        "cutometer",
        open_link=lambda: open_transport(entry.address, baudrate=options["baudrate"], usb_backend=entry.usb_backend),
        codec=partial(CutometerCodec, reference=options["pressure_reference"]),
        channels=channels,
        quantities=("pressure",),
        capacity=CAPACITY,
        watchdog=entry.watchdog,
        simulated=entry.simulated,
        convert=lambda raw: {c.name: raw[:, k] for k, c in enumerate(channels)},
    )
    return Rig("cutometer", device)


INSTRUMENT = Instrument(
    name="cutometer",
    title="Cutometer MPA 580",
    channels=CHANNELS,
    quantities=("pressure",),
    limits=LIMITS,
    transports=("serial", "socket"),
    open_rig=open_rig,
)
