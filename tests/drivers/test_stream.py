"""The stream device on a scripted link: repeated requests, refusals, rubbish."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from drivers import messages as msg
from drivers import stream
from drivers.cutometer.codec import CutometerCodec
from drivers.device import Identity, LinkLost, ProtocolFault, Refused, Status
from drivers.signals import Block, Channel
from drivers.stream import StreamDevice
from drivers.transports import Transport
from protocols.setpoints import Segment

WHO = Identity("model", "serial", "firmware")
Answer = Callable[[msg.Message], bytes]


class Script(Transport):
    """A link whose other end is a function from message to bytes."""

    def __init__(self, answer: Answer) -> None:
        super().__init__("script")
        self.asked: list[msg.Message] = []
        self.waiting = b""
        self._answer = answer
        self._codec = CutometerCodec()

    def _receive(self, timeout: float) -> bytes:
        data, self.waiting = self.waiting, b""
        return data

    def write(self, data: bytes) -> None:
        for message in self._codec.decode(data):
            self.asked.append(message)
            self.waiting += self._answer(message)

    def close(self) -> None:
        pass


def obedient(message: msg.Message) -> bytes:
    if not isinstance(message, msg.Request):
        return b""
    return CutometerCodec().encode(
        msg.Reply(message.number, identity=WHO if isinstance(message.body, msg.Identify) else None)
    )


def device(script: Script, zero: tuple[Callable[..., None], int] | None = None) -> StreamDevice:
    return StreamDevice(
        "probe",
        open_link=lambda: script,
        codec=CutometerCodec,
        channels=(Channel("pressure", "Pa", "actuator"), Channel("apex_height", "m", "sensor")),
        quantities=("pressure",),
        capacity=4,
        watchdog=0.25,
        convert=lambda raw: {"pressure": raw[:, 0], "apex_height": raw[:, 1]},
        zero=zero,
    )


@pytest.fixture(autouse=True)
def hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "REPLY_TIMEOUT", 0.01)
    monkeypatch.setattr(stream, "FIRST_TIMEOUT", 0.05)


def samples(first: int, count: int, state: str = "running") -> bytes:
    time = (first + np.arange(count)) / 100
    values = np.column_stack([-1000.0 * np.ones(count), 1e-4 * np.arange(count)])
    return CutometerCodec().encode(msg.Samples(first, time, values, Status(float(time[-1]), state, 2, 1)))


def test_an_unheard_request_is_repeated_under_its_number() -> None:
    deaf = 3

    def answer(message: msg.Message) -> bytes:
        nonlocal deaf
        deaf -= 1
        return obedient(message) if deaf < 0 else b""

    script = Script(answer)
    assert device(script).connect() == WHO
    numbers = [m.number for m in script.asked if isinstance(m, msg.Request)]
    assert numbers == [1, 1, 1, 1, 2]


def test_request_numbers_wrap_around_without_zero() -> None:
    script = Script(obedient)
    probe = device(script)
    probe.connect()
    for _ in range(300):
        probe.hold()
    numbers = [m.number for m in script.asked if isinstance(m, msg.Request)]
    assert set(numbers) == set(range(1, msg.LAST_NUMBER + 1))


def test_samples_that_come_with_an_answer_are_kept_for_the_next_read() -> None:
    script = Script(lambda message: samples(7, 3) + obedient(message) + samples(10, 2))
    probe = device(script)
    probe.connect()
    probe.start()
    (block,) = probe.read(0.0)
    assert isinstance(block, Block)
    assert block.seq.tolist() == [7, 8, 9, 10, 11]
    assert block.values["apex_height"] == pytest.approx([0, 1e-4, 2e-4, 0, 1e-4])
    assert probe.status.executed == 2
    assert probe.read(0.0) == []


def test_silence_is_a_lost_link_and_rubbish_a_fault() -> None:
    with pytest.raises(LinkLost, match=r"probe on script: no answer to identify within .* \(silence\)"):
        device(Script(lambda message: b"")).connect()
    with pytest.raises(LinkLost, match="no checksum"):
        device(Script(lambda message: b"hello\r")).connect()
    with pytest.raises(ProtocolFault, match="without one valid message"):
        device(Script(lambda message: b"\xff" * 40000)).connect()


def test_an_answer_of_the_wrong_kind_names_nobody() -> None:
    nobody = Script(lambda m: CutometerCodec().encode(msg.Reply(m.number)) if isinstance(m, msg.Request) else b"")
    with pytest.raises(ProtocolFault, match="names nobody"):
        device(nobody).connect()


def test_a_refusal_carries_the_devices_reason() -> None:
    def answer(message: msg.Message) -> bytes:
        if isinstance(message, msg.Request) and isinstance(message.body, msg.Enqueue):
            return CutometerCodec().encode(msg.Reply(message.number, refused="queue; full*"))
        return obedient(message)

    probe = device(Script(answer))
    probe.connect()
    with pytest.raises(Refused, match=r"probe refused enqueue: queue; full\*"):
        probe.enqueue([Segment(1.0, {"pressure": 0.0}, {"pressure": -1.0})])
    probe.enqueue([])


def test_a_tare_waits_for_its_samples_and_leaves_them_to_be_read() -> None:
    taken = []
    script = Script(lambda message: obedient(message) + samples(0, 10))
    probe = device(script, (lambda raw: taken.append(raw.shape), 8))
    probe.connect()
    probe.start_stream()
    assert taken == [(8, 2)]
    assert sum(map(len, probe.read(0.0))) == 10
    mute = device(Script(obedient), (lambda raw: None, 8))
    mute.connect()
    with pytest.raises(LinkLost, match="no 8 samples"):
        mute.start_stream()
