"""The feeder alone: what is sent, when, and what is written down."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquire.engine.feeder import Feeder
from drivers.device import Status
from protocols.setpoints import Segment, Setpoints, Until


def seg(duration: float, a: float, b: float, until: Until | None = None) -> Segment:
    return Segment(duration, {"pressure": a}, {"pressure": b}, until=until)


def status(executed: int, began: float, time: float | None = None, state: str = "running") -> Status:
    return Status(began if time is None else time, state, executed, 0, "", began)


UNTIL = Until("pressure", "<", -40.0)


def test_never_more_than_the_queue_holds() -> None:
    feeder = Feeder(Setpoints(tuple(seg(1, 0, 0) for _ in range(5))), 2, {}, {})
    assert len(feeder.feed()) == 2
    assert feeder.feed() == []
    feeder.follow(status(1, 11.0))
    assert len(feeder.feed()) == 1


def test_nothing_is_sent_behind_an_until_before_it_has_ended() -> None:
    feeder = Feeder(Setpoints((seg(1, 0, -10), seg(10, -10, -110, UNTIL), seg(1, -110, 0))), 8, {}, {})
    assert len(feeder.feed()) == 2
    feeder.follow(status(1, 1.0))
    assert feeder.watched is not None
    feeder.skipped()
    assert feeder.watched is None
    feeder.follow(status(2, 4.0))  # cut short after 3 of 10 s
    (rest,) = feeder.feed()
    assert rest.start["pressure"] == pytest.approx(-40.0)
    feeder.follow(status(3, 5.0))
    assert feeder.finished
    made = feeder.executed(0.0, 6.0)
    assert made.duration == pytest.approx(6.0)
    assert made.at([0.5, 2.5, 3.999, 4.5, 5.5])["pressure"] == pytest.approx([-5, -25, -40, -20, 0], abs=0.02)


def test_a_pause_repeats_the_segment_and_leads_in_at_the_allowed_rate() -> None:
    feeder = Feeder(Setpoints((seg(1, 0, -10), seg(10, -10, -10), seg(1, -10, 0))), 8, {}, {"pressure": 5.0})
    feeder.feed()
    feeder.follow(status(0, 100.0))
    feeder.follow(status(1, 101.0))
    feeder.interrupt(104.0)
    assert feeder.index == 1
    lead, hold, end = feeder.feed()
    assert (lead.duration, lead.start["pressure"], lead.end["pressure"]) == (2.0, 0.0, -10.0)
    assert (hold.duration, end.duration) == (10, 1)
    feeder.follow(status(0, 110.0))
    feeder.follow(status(3, 123.0))
    assert feeder.finished
    commanded = feeder.executed(99.0, 124.0)
    got = commanded.at(np.array([99.5, 103.0, 105.0, 111.0, 115.0, 123.5]) - 99.0)["pressure"]
    assert got == pytest.approx([0, -10, 0, -5, -10, 0])


def test_a_pause_in_the_lead_in_does_not_lose_the_segment() -> None:
    feeder = Feeder(Setpoints((seg(1, 0, -10), seg(10, -10, 0))), 8, {}, {"pressure": 1.0})
    feeder.feed()
    feeder.follow(status(0, 0.0))
    feeder.follow(status(1, 1.0))
    feeder.interrupt(2.0)
    feeder.feed()
    feeder.follow(status(0, 5.0))
    feeder.interrupt(7.0)
    assert feeder.index == 1
    assert [s.duration for s in feeder.feed()] == [10.0, 10.0]


def test_a_device_that_executed_more_than_it_got_is_a_fault() -> None:
    feeder = Feeder(Setpoints((seg(1, 0, 0),)), 8, {}, {})
    feeder.feed()
    with pytest.raises(ValueError, match="executed 2 segments but got 1"):
        feeder.follow(status(2, 1.0))


def test_empty_protocols_and_queues_are_refused() -> None:
    with pytest.raises(ValueError, match="no segments"):
        Feeder(Setpoints(()), 8, {}, {})
    with pytest.raises(ValueError, match="queue of 0"):
        Feeder(Setpoints((seg(1, 0, 0),)), 0, {}, {})


@settings(max_examples=40, deadline=None)
@given(
    durations=st.lists(st.sampled_from([0.0, 0.1, 0.5, 2.0]), min_size=1, max_size=8),
    capacity=st.integers(1, 5),
    statuses=st.integers(1, 4),
)
def test_an_undisturbed_run_executes_exactly_what_was_compiled(
    durations: list[float], capacity: int, statuses: int
) -> None:
    values = [float(-10 * k) for k in range(len(durations) + 1)]
    setpoints = Setpoints(tuple(seg(d, values[k], values[k + 1]) for k, d in enumerate(durations)))
    feeder = Feeder(setpoints, capacity, {}, {})
    sent = len(feeder.feed())
    done, began = 0, 50.0
    while not feeder.finished:
        for _ in range(min(statuses, sent - done)):
            began += durations[done]
            done += 1
        feeder.follow(status(done, began))
        sent += len(feeder.feed())
    assert [piece.index for piece in feeder.done] == list(range(len(durations)))
    assert feeder.done[-1].end == pytest.approx(50.0 + setpoints.duration)
    inside = np.linspace(0.001, setpoints.duration, 50, endpoint=False)
    if setpoints.duration:
        got = feeder.executed(50.0, 50.0 + setpoints.duration).at(inside)["pressure"]
        assert got == pytest.approx(setpoints.at(inside)["pressure"])
