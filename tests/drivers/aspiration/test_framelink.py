"""The simulated camera's wire."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.aspiration import framelink
from drivers.aspiration.framelink import FrameDecoder, Picture
from drivers.device import Identity


def picture(seq: int, height: int = 12, width: int = 17) -> Picture:
    image = np.random.default_rng(seq).integers(0, 256, (height, width)).astype(np.uint8)
    return Picture(image, seq, seq / 25)


def same(a: object, b: object) -> bool:
    assert isinstance(a, Picture)
    assert isinstance(b, Picture)
    return a.seq == b.seq and a.time == pytest.approx(b.time, abs=1e-6) and np.array_equal(a.image, b.image)


@settings(max_examples=40, deadline=None)
@given(step=st.integers(1, 500), sizes=st.lists(st.tuples(st.integers(1, 30), st.integers(1, 30)), max_size=4))
def test_frames_survive_any_cutting(step: int, sizes: list[tuple[int, int]]) -> None:
    sent = [picture(k, *size) for k, size in enumerate(sizes)]
    stream = b"".join(map(framelink.encode, sent))
    decoder = FrameDecoder()
    heard = [m for at in range(0, len(stream), step) for m in decoder.feed(stream[at : at + step])]
    assert len(heard) == len(sent)
    assert all(same(a, b) for a, b in zip(heard, sent, strict=True))
    assert decoder.tally.discarded == 0


@settings(max_examples=60, deadline=None)
@given(junk=st.binary(max_size=100), spot=st.integers(0, 200), change=st.integers(1, 255))
def test_in_step_again_after_garbage_and_damage(junk: bytes, spot: int, change: int) -> None:
    damaged = bytearray(framelink.encode(picture(1)))
    damaged[spot % len(damaged)] ^= change
    decoder = FrameDecoder()
    heard = decoder.feed(junk + bytes(damaged) + junk + framelink.encode(picture(2)))
    assert len(heard) == 1
    assert same(heard[0], picture(2))
    assert decoder.tally.discarded > 0


def test_an_identity_comes_whole() -> None:
    who = Identity("camera", "7", "1.0")
    assert FrameDecoder().feed(framelink.encode(who)) == [who]


def test_a_header_that_promises_too_much_is_garbage() -> None:
    data = bytearray(framelink.encode(picture(1)))
    data[6:8] = b"\xff\xff"  # a width that does not go with the length
    decoder = FrameDecoder()
    assert decoder.feed(bytes(data)) == []
    assert decoder.tally.discarded > 0
