"""Frames and checksums that the codecs share."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.framing import Splitter, cobs_decode, cobs_encode, crc16


def test_crc16_check_value() -> None:
    assert crc16(b"123456789") == 0x31C3  # the catalogue's check value of CRC-16/XMODEM


@pytest.mark.parametrize(
    ("data", "packet"),
    [  # examples of the COBS paper and its usual test vectors
        (b"\x00", b"\x01\x01"),
        (b"\x00\x00", b"\x01\x01\x01"),
        (b"\x11\x22\x00\x33", b"\x03\x11\x22\x02\x33"),
        (b"\x11\x22\x33\x44", b"\x05\x11\x22\x33\x44"),
        (b"\x11\x00\x00\x00", b"\x02\x11\x01\x01\x01"),
    ],
)
def test_cobs_vectors(data: bytes, packet: bytes) -> None:
    assert cobs_encode(data) == packet
    assert cobs_decode(packet) == data


@given(st.one_of(st.binary(max_size=600), st.binary(max_size=3).map(lambda b: b * 260)))
def test_cobs_round_trip(data: bytes) -> None:
    packet = cobs_encode(data)
    assert 0 not in packet
    assert len(packet) <= len(data) + len(data) // 254 + 2
    assert cobs_decode(packet) == data


def test_cobs_accepts_a_full_group_at_the_end() -> None:
    assert cobs_decode(b"\xff" + b"x" * 254) == b"x" * 254


@pytest.mark.parametrize("packet", [b"", b"\x05abc", b"\x02a\x00"])
def test_cobs_refuses_what_no_encoder_makes(packet: bytes) -> None:
    with pytest.raises(ValueError, match=r"packet|byte"):
        cobs_decode(packet)


@given(st.lists(st.binary(min_size=1, max_size=20).filter(lambda b: b"\r" not in b), max_size=10), st.data())
def test_splitter_gives_the_same_pieces_however_the_bytes_arrive(pieces: list[bytes], data: st.DataObject) -> None:
    stream = b"".join(p + b"\r" for p in pieces)
    splitter, out, at = Splitter(b"\r", 100), [], 0
    while at < len(stream):
        step = data.draw(st.integers(1, 30))
        out += splitter.feed(stream[at : at + step])
        at += step
    assert out == pieces


def test_splitter_drops_an_endless_run() -> None:
    splitter = Splitter(b"\r", 10)
    assert splitter.feed(b"x" * 50) == []
    assert splitter.overrun == 50
    assert splitter.feed(b"ab\r") == [b"ab"]
