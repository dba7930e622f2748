"""The aspiration device's pressure controller: text lines in the manner of Alicat's.

Assumed: the ETH device's own controller is not documented. What a lab can buy is a vacuum pressure controller whose
public serial protocol (Alicat: lines ended by CR, a data frame that begins with the unit's letter and carries decimal
values) has no queue, no sequence numbers and no checksum; this dialect keeps its manner and adds those three. It was
never run on real hardware.

One line a sample: ``A -30000.00 1250 50000000 431 R,3,12,49200000,`` — pressure in Pa, sample number, device time in
µs, packet number, status.
"""

from __future__ import annotations

import numpy as np

from drivers import messages as msg
from drivers.lines import LineCodec, read_status, write_status

#: Segments that the controller's queue holds (assumed).
CAPACITY = 64
_NO_READING = "---"


class PressureCodec(LineCodec):
    """One end of the pressure controller's link. Raw channel: pressure (Pa)."""

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

    def sample_lines(self, samples: msg.Samples) -> list[str]:
        """A line a sample; a block without samples is a line with neither value nor number."""
        status = f"{samples.packet} {write_status(samples.status)}"
        stamps = np.rint(samples.time * 1e6).astype(np.int64)
        if not len(stamps):
            return [f" {_NO_READING} - {round(samples.status.time * 1e6)} {status}"]
        return [
            f" {_NO_READING if np.isnan(p) else format(p, '+.2f')} {samples.first + k} {t} {status}"
            for k, (p, t) in enumerate(zip(samples.values[:, 0], stamps, strict=True))
        ]

    def parse_sample(self, text: str) -> msg.Samples:
        _, value, number, stamp, packet, rest = text.split(" ", 5)
        time = int(stamp) / 1e6
        status = read_status(rest, time)
        if number == "-":
            return msg.Samples(0, np.empty(0), np.empty((0, 1)), status, int(packet))
        pressure = np.nan if value == _NO_READING else float(value)
        return msg.Samples(int(number), np.array([time]), np.array([[pressure]]), status, int(packet))
