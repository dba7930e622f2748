"""The Cutometer's dialect — UNVERIFIED.

The wire protocol of the Cutometer MPA 580 is not public. This dialect is this project's own: nothing in it was
ever tried on the instrument, and the driver refuses a real port unless the station vouches for it. Everything that
is assumed about the wire is in this file.

Lines end in CR. A sample line holds a block: ``#packet,first,t0,t1,status;channels;hex`` with times in µs and, for each
sample, 24 hexadecimal digits: µs after t0 (unsigned), pressure in 0.01 Pa and apex height in nm (two's complement;
80000000 says "no reading", which is not a number); with a second gauge 8 more for its pressure. At 100 samples/s this
fits 115200 baud four times over.
"""

from __future__ import annotations

import numpy as np

from drivers import messages as msg
from drivers.lines import LineCodec, read_status, write_status
from drivers.signals import FloatArray

#: Value of one count of each raw channel: pressure in Pa, apex height in m, pressure of a second gauge in Pa.
COUNTS = np.array([0.01, 1e-9, 0.01])
#: Segments that the instrument's queue holds (assumed).
CAPACITY = 64
_NO_READING = np.int32(-(2**31))
_MOST = 2**31 - 1


class CutometerCodec(LineCodec):
    """One end of a Cutometer link. Raw channels: pressure (Pa), apex height (m), with a ``reference`` its pressure."""

    REQUEST, REPLY, SAMPLE = "@", "=", "#"
    TERMINATOR = b"\r"
    BEAT = "BEAT"
    VERBS = {  # noqa: RUF012 - a constant
        msg.Identify: "ID?",
        msg.Stream: "STREAM",
        msg.Arm: "ARM",
        msg.Enqueue: "QUEUE",
        msg.Start: "GO",
        msg.Hold: "HOLD",
        msg.Skip: "SKIP",
        msg.Safe: "SAFE",
    }

    def __init__(self, reference: bool = False) -> None:
        super().__init__()
        self._counts = COUNTS if reference else COUNTS[:2]

    def sample_lines(self, samples: msg.Samples) -> list[str]:
        start = round(float(samples.time[0]) * 1e6) if len(samples.time) else round(samples.status.time * 1e6)
        table = np.empty((len(samples.time), 1 + len(self._counts)), dtype=">i4")
        table[:, 0] = np.rint(samples.time * 1e6).astype(np.int64) - start
        table[:, 1:] = _counts(samples.values, self._counts)
        end = round(samples.status.time * 1e6)
        return [
            f"{samples.packet},{samples.first},{start},{end},{write_status(samples.status)};{len(self._counts)};{table.tobytes().hex()}"
        ]

    def parse_sample(self, text: str) -> msg.Samples:
        head, channels, digits = text.split(";")
        if int(channels) != len(self._counts):
            raise ValueError(f"{channels} channels instead of {len(self._counts)}")
        packet, first, start, end, status = head.split(",", 4)
        table = np.frombuffer(bytes.fromhex(digits), dtype=">i4").reshape(-1, 1 + len(self._counts))
        values = table[:, 1:] * self._counts
        values[table[:, 1:] == _NO_READING] = np.nan
        time = (int(start) + table[:, 0].view(">u4").astype(np.int64)) / 1e6
        return msg.Samples(int(first), time, values, read_status(status, int(end) / 1e6), int(packet))


def _counts(values: FloatArray, count: FloatArray) -> FloatArray:
    """Raw values in counts; beyond the range of the wire they stay at its end, as a converter's do."""
    counts = np.clip(np.rint(values / count), -_MOST, _MOST)
    return np.where(np.isnan(values), float(_NO_READING), counts)
