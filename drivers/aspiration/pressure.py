"""The aspiration device's pressure controller: text lines in the manner of Alicat's.

Assumed: the ETH device's own controller is not documented. A lab can buy a vacuum pressure controller whose
public serial protocol (Alicat: lines ended by CR, a data frame that begins with the unit's letter and carries decimal
values) has no queue, no sequence numbers and no checksum; this dialect keeps its manner and adds those three. It was
never run on real hardware.

One line a sample: ``A -30000.00 1250 50000000 431 R,3,12,49200000,`` — pressure in Pa, sample number, device time in
µs, packet number, status. A second gauge's pressure stands behind the first one's, after a slash.
"""

from __future__ import annotations

import numpy as np

from drivers import messages as msg
from drivers.lines import LineCodec, read_status, write_status

#: Segments that the controller's queue holds (assumed).
CAPACITY = 64
_NO_READING = "---"


class PressureCodec(LineCodec):
    """One end of the pressure controller's link. Raw channel: pressure (Pa), with a ``reference`` also its pressure."""

    REQUEST, REPLY, SAMPLE = "$", "!", "A"
    TERMINATOR = b"\r"
    BEAT = "K"
    VERBS = {  # noqa: RUF012 - a constant
        msg.Identify: "??M",
        msg.Stream: "@",
        msg.Arm: "L",
        msg.Enqueue: "SR",
        msg.Start: "G",
        msg.Hold: "HC",
        msg.Skip: "N",
        msg.Safe: "E",
    }

    def __init__(self, reference: bool = False) -> None:
        super().__init__()
        self._channels = 2 if reference else 1

    def sample_lines(self, samples: msg.Samples) -> list[str]:
        """A line a sample; a block without samples is a line with neither value nor number."""
        status = f"{samples.packet} {write_status(samples.status)}"
        stamps = np.rint(samples.time * 1e6).astype(np.int64)
        if not len(stamps):
            return [f" {_NO_READING} - {round(samples.status.time * 1e6)} {status}"]
        return [
            f" {'/'.join(map(_written, row))} {samples.first + k} {t} {status}"
            for k, (row, t) in enumerate(zip(samples.values, stamps, strict=True))
        ]

    def parse_sample(self, text: str) -> msg.Samples:
        _, value, number, stamp, packet, rest = text.split(" ", 5)
        time = int(stamp) / 1e6
        status = read_status(rest, time)
        if number == "-":
            return msg.Samples(0, np.empty(0), np.empty((0, self._channels)), status, int(packet))
        row = [np.nan if part == _NO_READING else float(part) for part in value.split("/")]
        if len(row) != self._channels:
            raise ValueError(f"{len(row)} pressures instead of {self._channels}")
        return msg.Samples(int(number), np.array([time]), np.array([row]), status, int(packet))


def _written(pressure: float) -> str:
    return _NO_READING if np.isnan(pressure) else f"{pressure:+.2f}"
