"""The states of a station: one table of transitions."""

import pytest

from capture.station.run.events import TRANSITIONS, Change, State, StateChanged
from capture.station.run.live_station import LiveStation


def station_in(state: State) -> LiveStation:
    """A station that was brought to a state."""
    steps = [Change.OPENED, Change.TESTED, Change.TRIGGERED]
    order = [State.PREOPERATIONAL, State.INITIALIZED, State.READY, State.EXECUTING]
    live = LiveStation("line-1", simulated=True)
    for step in [Change.FAILED] if state is State.ERROR else steps[: order.index(state)]:
        live.change(step)
    return live


@pytest.mark.parametrize("change", Change)
@pytest.mark.parametrize("state", State)
def test_only_transitions_of_the_table_are_made(state: State, change: Change) -> None:
    live = station_in(state)
    assert live.state.state is state
    before, expected = live.state.event_id, TRANSITIONS.get((state, change))
    if expected is None:
        with pytest.raises(ValueError, match="cannot change"):
            live.change(change)
        assert live.state.state is state
    else:
        live.change(change)
        assert live.state.state is expected
    events = [each.event for each in live.events_after(before) or ()]
    told = [] if expected in (None, state) else [StateChanged(expected, change)]
    assert events == told


def test_every_state_can_be_reached_and_left() -> None:
    for state in State:
        live = station_in(state)
        live.change(Change.STOPPED)
        assert live.state.state is State.PREOPERATIONAL
