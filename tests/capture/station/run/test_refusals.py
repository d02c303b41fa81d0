"""Refused triggers that come while others are being recorded are counted too."""

from typing import Any

import pytest
from sqlalchemy import Table

from capture.station.results.database import ResultsUnavailable
from capture.station.run.events import TriggerRefused
from capture.station.run.refusals import MAX_WAITING, Refusals
from capture.station.run.triggers import Trigger
from tests.waiting import Gate

MORE = MAX_WAITING + 57


class BusyStore:
    """Takes the first rows only when the flood is over, and none if the database is away."""

    def __init__(self, *, is_away: bool) -> None:
        self.is_away = is_away
        self.gate = Gate()
        self.rows: list[dict[str, Any]] = []

    def append(self, _: Table, *rows: dict[str, Any]) -> None:
        self.gate.hold()
        if self.is_away:
            raise ResultsUnavailable("the database is away")
        self.rows += rows


@pytest.mark.parametrize("is_away", [False, True])
def test_what_comes_while_rows_are_written_is_counted(is_away: bool) -> None:
    events: list[TriggerRefused] = []
    waiting = Refusals(events.append, lambda _: None)
    store = BusyStore(is_away=is_away)
    for _ in range(MAX_WAITING):
        waiting.add(Trigger("modbus", "A-1"), "busy")
    with waiting.recording(store, lambda: False):  # type: ignore[arg-type]
        store.gate.until_reached()
        for _ in range(MORE - MAX_WAITING):
            waiting.add(Trigger("modbus", "A-1"), "busy")
        store.gate.open()
    assert sum(event.triggers for event in events) == MORE
    assert {event.recorded for event in events} == {not is_away}
    assert len(store.rows) == (0 if is_away else len(events))
    assert len(events) == MAX_WAITING + 1
