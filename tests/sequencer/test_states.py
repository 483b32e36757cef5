"""The state machine allows only valid transitions."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calstation.sequencer import State
from calstation.sequencer.control import ENDED, TRANSITIONS, IllegalTransitionError, transition


@given(st.lists(st.sampled_from(State)))
def test_every_transition_sequence_follows_the_state_table(wishes: list[State]) -> None:
    state = State.IDLE
    for wish in wishes:
        allowed = wish in TRANSITIONS[state]
        if allowed:
            state = transition(state, wish)
        else:
            with pytest.raises(IllegalTransitionError):
                transition(state, wish)


def test_every_state_can_be_entered_and_left() -> None:
    reached, front = {State.IDLE}, [State.IDLE]
    while front:
        for following in TRANSITIONS[front.pop()]:
            if following not in reached:
                reached.add(following)
                front.append(following)
    assert reached == set(State)
    assert all(TRANSITIONS[state] for state in State)


def test_a_run_in_progress_can_always_stop_or_fault() -> None:
    for state in set(State) - ENDED - {State.IDLE, State.STOPPING}:
        assert {State.STOPPING, State.FAULT} <= TRANSITIONS[state]


def test_a_fault_is_latched() -> None:
    assert TRANSITIONS[State.FAULT] == {State.IDLE}


def test_done_is_reached_only_from_running() -> None:
    assert {s for s in State if State.DONE in TRANSITIONS[s]} == {State.RUNNING}
