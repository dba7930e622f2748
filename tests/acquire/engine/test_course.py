"""The command in device time, as screens draw it: a pause shifts what is left of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from acquire.engine.course import Course
from acquire.engine.feeder import Feeder
from drivers.device import Status
from drivers.signals import FloatArray
from protocols.setpoints import Segment, Setpoints

HOLD = Setpoints(
    (
        Segment(1.0, {"pressure": 0.0}, {"pressure": 0.0}),
        Segment(10.0, {"pressure": -10.0}, {"pressure": -10.0}),
        Segment(2.0, {"pressure": -10.0}, {"pressure": 0.0}),
    )
)


def test_a_pause_cuts_the_course_and_a_resume_shifts_the_rest() -> None:
    feeder = Feeder(HOLD, 8, {"pressure": 0.0}, {"pressure": 5.0})
    feeder.feed()
    feeder.follow(Status(100.0, "running", 0, 0, "", 100.0))
    whole = Course(tuple(feeder.done), feeder.began, feeder.remaining(), feeder.rest)
    assert drawn(whole, 100.5, 105.0, 112.0) == pytest.approx([0, -10, -5])
    feeder.follow(Status(101.0, "running", 1, 0, "", 101.0))
    feeder.interrupt(104.0)
    paused = Course(tuple(feeder.done), math.nan, Setpoints(()), feeder.rest)
    assert paused.table()[0][-1] == 104.0  # nobody knows when it goes on
    assert paused.table()[1]["pressure"][-1] == 0.0
    feeder.feed()
    feeder.follow(Status(120.0, "running", 0, 0, "", 120.0))
    on = Course(tuple(feeder.done), feeder.began, feeder.remaining(), feeder.rest)
    # Done, at rest, led in for 2 s, held for the whole 10 s again, and released.
    assert drawn(on, 103.0, 110.0, 121.0, 131.0, 133.0) == pytest.approx([-10, 0, -5, -10, -5])
    assert on.table()[0][-1] == 134.0


def test_before_anything_was_executed_there_is_nothing_to_draw() -> None:
    time, values = Course((), math.nan, Setpoints(()), {"pressure": 0.0}).table()
    assert len(time) == len(values["pressure"]) == 0


def drawn(course: Course, *moments: float) -> FloatArray:
    time, values = course.table()
    assert np.all(np.diff(time) >= 0)
    return np.interp(moments, time, values["pressure"])
