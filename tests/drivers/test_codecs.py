"""All three dialects: what one end encodes the other decodes, cut and soiled as it may be."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers import messages as msg
from drivers.aspiration.pressure import PressureCodec
from drivers.cutometer.codec import COUNTS, CutometerCodec
from drivers.device import Identity, Status
from drivers.microrobot.codec import MicrorobotCodec
from drivers.stream import Codec
from protocols.limits import Range

CODECS = {
    "cutometer": (CutometerCodec, 1, 2),
    "aspiration": (PressureCodec, 1, 1),
    "microrobot": (MicrorobotCodec, 3, 6),
    "cutometer with reference": (partial(CutometerCodec, reference=True), 1, 3),
    "aspiration with reference": (partial(PressureCodec, reference=True), 1, 2),
}
#: Range and resolution of each raw channel on the wire; None: 32 bit floating point.
STEPS = {
    "cutometer": COUNTS[:2],
    "aspiration": np.array([0.01]),
    "microrobot": None,
    "cutometer with reference": COUNTS,
    "aspiration with reference": np.array([0.01]),
}
LIMIT = {
    "cutometer": np.array([1e5, 0.5]),
    "aspiration": np.array([1e5]),
    "microrobot": np.full(6, 10.0),
    "cutometer with reference": np.array([1e5, 0.5, 1e5]),
    "aspiration with reference": np.array([1e5, 1e5]),
}

numbers = st.floats(-1e6, 1e6, allow_nan=False)
text = st.text(max_size=40)
names = st.sampled_from(["pressure", "probe_x", "apex_height", "probe", "größe;=*"])
above_zero = st.floats(0, exclude_min=True)
ranges = st.builds(
    lambda a, b, rate, dwell: Range(min(a, b), max(a, b), rate, dwell),
    st.floats(allow_nan=False),
    st.floats(allow_nan=False),
    above_zero,
    above_zero,
)
bodies = st.one_of(
    st.just(msg.Identify()),
    st.builds(msg.Stream, st.booleans()),
    st.builds(
        msg.Arm,
        st.dictionaries(names, ranges, max_size=4),
        st.floats(0.01, 10),
        st.integers(0, 2**40),
    ),
    st.just(msg.Start()),
    st.just(msg.Hold()),
    st.builds(msg.Skip, st.integers(0, 2**31)),
    st.just(msg.Safe()),
)
replies = st.one_of(
    st.builds(msg.Reply, st.integers(0, 255)),
    st.builds(msg.Reply, st.integers(0, 255), text.filter(bool)),
    st.builds(msg.Reply, st.integers(0, 255), st.just(""), st.builds(Identity, text, text, text)),
)
statuses = st.builds(
    Status,
    st.integers(0, 10**12).map(lambda us: us / 1e6),
    st.sampled_from(["idle", "armed", "running", "held", "safe", "fault"]),
    st.integers(0, 10**6),
    st.integers(0, 200),
    text,
    st.one_of(st.just(math.nan), st.integers(0, 10**12).map(lambda us: us / 1e6)),
)


@st.composite
def pieces(draw: st.DrawFn, width: int) -> msg.Piece:
    ends = st.tuples(*[numbers] * width)
    return msg.Piece(draw(st.floats(0, 1e5)), draw(ends), draw(ends))


@st.composite
def samples(draw: st.DrawFn, name: str) -> msg.Samples:
    channels = CODECS[name][2]
    count = draw(st.integers(0, 6))
    start = draw(st.integers(0, 10**12))
    stamps = start + np.cumsum([0, *draw(st.lists(st.integers(1, 10**6), min_size=count, max_size=count))])[:count]
    raw = draw(
        st.lists(st.lists(st.floats(-1, 1), min_size=channels, max_size=channels), min_size=count, max_size=count)
    )
    values = np.array(raw).reshape(count, channels) * LIMIT[name]
    if count and draw(st.booleans()):
        values[draw(st.integers(0, count - 1)), draw(st.integers(0, channels - 1))] = np.nan
    return msg.Samples(draw(st.integers(0, 2**31)), stamps / 1e6, values, draw(statuses), draw(st.integers(0, 2**31)))


def decoded(codec: Codec, data: bytes, cuts: list[int]) -> list[msg.Message]:
    edges = sorted({0, len(data), *(c % (len(data) + 1) for c in cuts)})
    return [m for a, b in itertools.pairwise(edges) for m in codec.decode(data[a:b])]


def same(a: object, b: object) -> bool:
    """Equal, not-a-number included; text in messages may be cut by the dialect."""
    return repr(a) == repr(b)


@pytest.mark.parametrize("name", CODECS)
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_requests_and_replies_survive_any_cutting(name: str, data: st.DataObject) -> None:
    make, width, _ = CODECS[name]
    enqueue = st.builds(msg.Enqueue, st.lists(pieces(width), min_size=1, max_size=5).map(tuple))
    request = st.builds(msg.Request, st.integers(1, 255), st.one_of(bodies, enqueue))
    sent = data.draw(st.lists(st.one_of(request, replies, st.builds(msg.Beat, st.integers(0, 2**40))), max_size=5))
    codec = make()
    stream = b"".join(codec.encode(m) for m in sent)
    heard = decoded(make(), stream, data.draw(st.lists(st.integers(0, 10**6), max_size=8)))
    assert len(heard) == len(sent)
    assert all(same(a, b) for a, b in zip(heard, sent, strict=True))


@pytest.mark.parametrize("name", CODECS)
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_samples_arrive_within_the_resolution_of_the_wire(name: str, data: st.DataObject) -> None:
    sent = data.draw(samples(name))
    make = CODECS[name][0]
    heard = [m for m in make().decode(make().encode(sent)) if isinstance(m, msg.Samples)]
    assert heard[-1].status.state == sent.status.state
    assert heard[-1].status.executed == sent.status.executed
    assert heard[-1].status.queued == sent.status.queued
    assert heard[-1].status.fault == sent.status.fault
    assert heard[-1].status.began == pytest.approx(sent.status.began, nan_ok=True)
    if not len(sent.time):
        return
    values = np.concatenate([h.values for h in heard])
    assert heard[0].first == sent.first
    assert np.allclose(np.concatenate([h.time for h in heard]), sent.time, rtol=0, atol=1e-6)
    step = STEPS[name]
    if step is None:
        assert np.allclose(values, sent.values, rtol=1e-7, atol=1e-30, equal_nan=True)
    else:
        assert np.array_equal(np.isnan(values), np.isnan(sent.values))
        assert np.all(np.isnan(values) | (np.abs(values - sent.values) <= 0.51 * step))


@pytest.mark.parametrize("name", CODECS)
@settings(max_examples=60, deadline=None)
@given(junk=st.binary(max_size=300), data=st.data())
def test_in_step_again_one_message_after_garbage(name: str, junk: bytes, data: st.DataObject) -> None:
    make = CODECS[name][0]
    codec = make()
    reply = codec.encode(msg.Reply(7))
    receiver = make()
    heard = receiver.decode(junk) + receiver.decode(reply) + receiver.decode(reply)
    assert msg.Reply(7) in heard[-2:]
    assert receiver.tally.discarded <= len(junk) + len(reply)


@pytest.mark.parametrize("name", CODECS)
@settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_one_changed_byte_is_noticed(name: str, data: st.DataObject) -> None:
    make, width, _ = CODECS[name]
    sent = msg.Request(3, msg.Enqueue((data.draw(pieces(width)),)))
    packet = bytearray(make().encode(sent))
    spot = data.draw(st.integers(0, len(packet) - 1))
    packet[spot] ^= data.draw(st.integers(1, 255))
    receiver = make()
    heard = receiver.decode(bytes(packet))
    assert not heard or same(heard[0], sent)


@pytest.mark.parametrize("name", CODECS)
def test_a_value_that_is_not_finite_is_no_segment(name: str) -> None:
    make, width, _ = CODECS[name]
    bad = msg.Request(1, msg.Enqueue((msg.Piece(1.0, (math.nan,) * width, (0.0,) * width),)))
    receiver = make()
    assert receiver.decode(make().encode(bad)) == []
    assert receiver.tally.discarded > 0
    assert "finite" in receiver.tally.last_fault


def test_the_cutometer_line_is_what_the_codec_says_it_is() -> None:
    status = Status(2.0, "running", 3, 4, "", 1.5)
    line = CutometerCodec().encode(
        msg.Samples(7, np.array([1.99, 2.0]), np.array([[-3e4, 2e-4], [math.nan, 0.0]]), status, 31)
    )
    body = (
        b"#31,7,1990000,2000000,R,3,4,1500000,;2;"
        + b"00000000ffd23940"
        + b"00030d40"
        + b"00002710"
        + b"80000000"
        + b"0" * 8
    )
    assert line.startswith(body + b"*")
    assert line.endswith(b"\r")


def test_the_pressure_line_is_what_the_codec_says_it_is() -> None:
    status = Status(50.0, "running", 3, 12, "", 49.2)
    line = PressureCodec().encode(msg.Samples(1250, np.array([50.0]), np.array([[-3e4]]), status, 431))
    assert line.startswith(b"A -30000.00 1250 50000000 431 R,3,12,49200000,*")


@pytest.mark.parametrize("make", [CutometerCodec, PressureCodec])
def test_a_gauge_too_many_or_too_few_makes_no_false_sample(make: Callable[..., Codec]) -> None:
    for reference in (False, True):
        width = (2 if make is CutometerCodec else 1) + reference
        for count in range(1, 9):
            sent = msg.Samples(0, np.arange(count) / 100, np.ones((count, width)), Status(0.0, "idle", 0, 0))
            receiver = make(reference=not reference)
            assert receiver.decode(make(reference=reference).encode(sent)) == []
            assert "instead of" in receiver.tally.last_fault


def test_a_sample_beyond_the_wire_stays_at_its_end() -> None:
    heard = CutometerCodec().decode(
        CutometerCodec().encode(msg.Samples(0, np.zeros(1), np.array([[-1e9, 10.0]]), Status(0.0, "idle", 0, 0)))
    )
    assert isinstance(heard[0], msg.Samples)
    assert heard[0].values[0, 0] == pytest.approx(-21474836.47)
    assert heard[0].values[0, 1] == pytest.approx(2.147483647)
