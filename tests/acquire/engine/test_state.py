"""Every transition of the state machine, allowed and not."""

from __future__ import annotations

import itertools

import pytest

from acquire.engine.state import TRANSITIONS, State, StateMachine, WrongState

S = State
ALLOWED = {
    ("connect", S.IDLE): S.CONNECTING,
    ("connected", S.CONNECTING): S.READY,
    ("arm", S.READY): S.ARMED,
    ("arm", S.COMPLETED): S.ARMED,
    ("arm", S.ABORTED): S.ARMED,
    ("start", S.ARMED): S.RUNNING,
    ("pause", S.RUNNING): S.PAUSED,
    ("resume", S.PAUSED): S.RUNNING,
    ("complete", S.RUNNING): S.COMPLETED,
    ("abort", S.CONNECTING): S.IDLE,
    ("abort", S.ARMED): S.ABORTED,
    ("abort", S.RUNNING): S.ABORTED,
    ("abort", S.PAUSED): S.ABORTED,
    **{("trip", s): S.TRIPPED for s in S if s not in (S.TRIPPED, S.FAILED)},
    **{("fail", s): S.FAILED for s in S if s not in (S.TRIPPED, S.FAILED)},
    ("reset", S.TRIPPED): S.IDLE,
    ("reset", S.FAILED): S.IDLE,
    ("lose", S.READY): S.IDLE,
    ("lose", S.COMPLETED): S.IDLE,
    ("lose", S.ABORTED): S.IDLE,
    ("disconnect", S.READY): S.IDLE,
    ("disconnect", S.COMPLETED): S.IDLE,
    ("disconnect", S.ABORTED): S.IDLE,
}


@pytest.mark.parametrize(("event", "state"), list(itertools.product(TRANSITIONS, State)))
def test_transition(event: str, state: State) -> None:
    heard: list[tuple[State, str]] = []
    machine = StateMachine(lambda s, e: heard.append((s, e)))
    machine._state = state
    assert machine.can(event) is ((event, state) in ALLOWED)
    if (event, state) in ALLOWED:
        assert machine.fire(event) is machine.state is ALLOWED[event, state]
        assert heard == [(machine.state, event)]
    else:
        with pytest.raises(WrongState, match=f"cannot {event} while {state}"):
            machine.fire(event)
        assert machine.state is state
        assert heard == []


def test_live_and_final_states() -> None:
    assert {s for s in State if s.live} == {S.ARMED, S.RUNNING, S.PAUSED}
    assert {s for s in State if s.final} == {S.COMPLETED, S.ABORTED, S.TRIPPED, S.FAILED}
