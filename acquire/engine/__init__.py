"""The run engine: state machine, link threads, interlock and recorder of one instrument."""

from acquire.engine.engine import RunEngine
from acquire.engine.interlock import Rules, Tracking, Trip
from acquire.engine.plan import Outcome, Progress, RunPlan
from acquire.engine.state import State, WrongState

__all__ = ["Outcome", "Progress", "Rules", "RunEngine", "RunPlan", "State", "Tracking", "Trip", "WrongState"]
