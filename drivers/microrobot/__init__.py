"""Three-axis voice-coil micro-robot: forces and displacements of a probe glued to skin, on a USB bulk link.

The transducers are tared when the stream begins: the probe must hang free then. Options of a station entry:
``force_matrix`` (nine numbers, row by row; the paper's).
"""

from __future__ import annotations

from drivers.device import Rig
from drivers.instrument import Entry, Instrument, permit
from drivers.options import take
from drivers.signals import Channel
from protocols.limits import PROBE, Limits, Range

QUANTITIES = ("probe_x", "probe_y", "probe_z")

_AXIS = (-5e-3, 5e-3)
_REACH = (-3e-3, 3e-3)

CHANNELS = (
    *(Channel(f"axis_position_{k}", "m", "sensor", _AXIS, 50e-6) for k in (1, 2, 3)),
    *(Channel(f"transducer_force_{k}", "N", "sensor", (-14.7, 14.7), 6e-3) for k in "abc"),
    *(Channel(q, "m", "processing", _REACH, 50e-6) for q in QUANTITIES),
    *(Channel(f"force_{k}", "N", "processing", (-14.7, 14.7), 6e-3) for k in "xyz"),
)

#: Excursion, tip speed and half an hour away from the centre are assumed; the transducers end at 1500 g (datasheet).
LIMITS = Limits(
    {**{q: Range(*_REACH, rate=20e-3) for q in QUANTITIES}, PROBE: Range(0.0, 3e-3, rate=20e-3, dwell=1800.0)},
    "hardware",
)


def open_rig(entry: Entry) -> Rig:
    """The rig of a station entry; the link is opened by ``connect``.

    Raises NotAllowed on a real port whose dialect nobody vouches for, ValueError for an unknown option.
    """
    from drivers.microrobot.codec import CAPACITY, MicrorobotCodec
    from drivers.microrobot.processing import TARE_SAMPLES, Processing
    from drivers.stream import StreamDevice
    from drivers.transports import open_transport

    permit(entry, "this driver's dialect is assumed and was never verified on a real controller")
    processing = Processing(take(entry, force_matrix=None)["force_matrix"])
    device = StreamDevice(
        "microrobot",
        open_link=lambda: open_transport(entry.address, usb_backend=entry.usb_backend),
        codec=MicrorobotCodec,
        channels=CHANNELS,
        quantities=QUANTITIES,
        capacity=CAPACITY,
        watchdog=entry.watchdog,
        simulated=entry.simulated,
        convert=processing,
        zero=(processing.tare, TARE_SAMPLES),
    )
    return Rig("microrobot", device)


INSTRUMENT = Instrument(
    name="microrobot",
    title="Three-axis micro-robot",
    channels=CHANNELS,
    quantities=QUANTITIES,
    limits=LIMITS,
    transports=("usb", "socket", "serial"),
    open_rig=open_rig,
)
