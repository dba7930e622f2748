"""The run engine: state machine, link threads, interlock and recorder of one instrument."""

from acquire.engine.course import Course
from acquire.engine.engine import RunEngine
from acquire.engine.plan import Outcome, Progress, RunPlan
from acquire.engine.rest import Rest, bring_to_rest
from acquire.engine.rules import Rules, Tracking, Trip
from acquire.engine.state import Aborted, State, Tripped, WrongState

__all__ = [
    "Aborted",
    "Course",
    "Outcome",
    "Progress",
    "Rest",
    "Rules",
    "RunEngine",
    "RunPlan",
    "State",
    "Tracking",
    "Trip",
    "Tripped",
    "WrongState",
    "bring_to_rest",
]
