"""A link that goes while no run is on comes back by itself; in a run it trips and stays away."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from acquire.engine import RunEngine, RunPlan, State, WrongState, absence
from drivers.device import Identity, LinkLost
from tests.acquire.engine.fake import FakeDevice
from tests.acquire.engine.helpers import LONG, SHORT, eventually, running

Plan = Callable[..., RunPlan]


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(absence, "FIRST", 0.01)


def pull(device: FakeDevice) -> None:
    device.unplugged = True


def test_it_is_tried_again_until_it_is_back(engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    engine.connect()
    pull(device)
    eventually(lambda: device.calls.count("connect") >= 4)
    assert "unplugged; lost for" in engine.away
    assert engine.trip is None
    device.unplugged = False
    eventually(lambda: engine.state is State.READY)
    assert engine.away == ""
    engine.connect()  # whoever did not see that it is back already does no harm
    engine.arm(plan(SHORT))
    engine.start()
    assert engine.wait(10).status is State.COMPLETED
    pull(device)
    eventually(lambda: engine.state in (State.IDLE, State.CONNECTING))
    device.unplugged = False
    eventually(lambda: engine.state is State.READY)


def test_it_is_tried_less_and_less_often() -> None:
    gone = absence.Absence("unplugged")
    waits = []
    for _ in range(20):
        before = absence.time.monotonic()
        gone.failed("unplugged")
        waits.append(round(gone.due - before, 2))
    assert waits == sorted(waits)
    assert waits[-1] == pytest.approx(absence.LONGEST, abs=0.1)


def test_never_in_a_run(engine: RunEngine, device: FakeDevice, plan: Plan) -> None:
    running(engine, plan(LONG))
    pull(device)
    outcome = engine.wait(10)
    assert outcome.trip is not None
    assert outcome.trip.code == "link"
    tried = device.calls.count("connect")
    device.unplugged = False
    with pytest.raises(WrongState):
        engine.connect()
    assert (engine.state, device.calls.count("connect")) == (State.TRIPPED, tried)


def test_another_instrument_on_the_same_link_is_not_taken_for_it(
    engine: RunEngine, device: FakeDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine.connect()
    pull(device)
    eventually(lambda: engine.away != "")
    monkeypatch.setattr(device, "connect", lambda: Identity("fake", "another", "1"))
    device.unplugged = False
    eventually(lambda: engine.state is State.FAILED)


@pytest.mark.parametrize("end", ["disconnect", "close", "stop"])
def test_a_person_ends_the_trying(engine: RunEngine, device: FakeDevice, end: str) -> None:
    engine.connect()
    pull(device)
    eventually(lambda: engine.state is State.IDLE)
    getattr(engine, end)()
    eventually(lambda: engine.away == "")
    tried = device.calls.count("connect")
    device.unplugged = False
    eventually(lambda: engine.state is not State.CONNECTING)
    assert device.calls.count("connect") <= tried + 1
    assert engine.state is not State.READY


def test_a_first_connection_that_fails_is_told_and_not_tried_again(engine: RunEngine, device: FakeDevice) -> None:
    device.raise_on["connect"] = LinkLost("fake: nobody there")
    with pytest.raises(LinkLost):
        engine.connect()
    assert (engine.state, engine.away) == (State.FAILED, "")
