"""The states of a station: one table of transitions."""

import pytest

from capture.station.run.states import TRANSITIONS, Change, State, StateMachine


@pytest.mark.parametrize("change", Change)
@pytest.mark.parametrize("state", State)
def test_only_transitions_of_the_table_are_made(state: State, change: Change) -> None:
    seen: list[State] = []
    machine = StateMachine(lambda new, _: seen.append(new))
    for step in path_to(state):
        machine.change(step)
    assert machine.state is state
    seen.clear()
    expected = TRANSITIONS.get((state, change))
    if expected is None:
        with pytest.raises(ValueError, match="cannot change"):
            machine.change(change)
        assert machine.state is state
    else:
        assert machine.change(change) is expected
    assert seen == ([expected] if expected not in (None, state) else [])


def path_to(state: State) -> list[Change]:
    """Changes from the first state to `state`."""
    steps = [Change.OPENED, Change.TESTED, Change.TRIGGERED]
    order = [State.PREOPERATIONAL, State.INITIALIZED, State.READY, State.EXECUTING]
    return [Change.FAILED] if state is State.ERROR else steps[: order.index(state)]


def test_every_state_can_be_reached_and_left() -> None:
    for state in State:
        machine = StateMachine(lambda *_: None)
        for step in path_to(state):
            machine.change(step)
        assert machine.change(Change.STOPPED) is State.PREOPERATIONAL
