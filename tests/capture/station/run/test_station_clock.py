"""The clock of a station: UTC of past instants, and steps of the clock."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import pytest

from capture.station.run.station_clock import StationClock

BEGIN = datetime(2026, 3, 1, 8, tzinfo=UTC)


@dataclass
class Clocks:
    """UTC and monotonic time that a test sets."""

    utc_s: float = 0.0
    monotonic_s: float = 100.0

    def station_clock(self) -> StationClock:
        return StationClock(lambda: BEGIN + timedelta(seconds=self.utc_s), lambda: self.monotonic_s)

    def pass_by(self, duration_s: float, *, slewed: float = 0.0) -> None:
        self.monotonic_s += duration_s
        self.utc_s += duration_s * (1.0 + slewed)


def test_an_instant_on_the_monotonic_clock_has_its_utc() -> None:
    clocks = Clocks()
    clock = clocks.station_clock()
    exposed_s = clocks.monotonic_s
    clocks.pass_by(1.25)
    assert clock.at(exposed_s) == "2026-03-01T08:00:00.000Z"
    assert clock.now() == clock.at(clocks.monotonic_s) == "2026-03-01T08:00:01.250Z"


@pytest.mark.parametrize("slewed", [-5e-4, 0.0, 5e-4])
def test_a_clock_that_a_time_server_slews_for_a_day_was_not_set(slewed: float) -> None:
    clocks = Clocks()
    clock = clocks.station_clock()
    clocks.pass_by(86_400.0, slewed=slewed)
    assert clock.note_if_set() is None


@pytest.mark.parametrize(
    ("step_s", "note"),
    [(-3600.0, "back by 3600 s"), (5.0, "forward by 5 s"), (1.0, None)],
)
def test_a_step_is_noted_once(step_s: float, note: str | None) -> None:
    clocks = Clocks()
    clock = clocks.station_clock()
    clocks.pass_by(10.0)
    clocks.utc_s += step_s
    found = clock.note_if_set()
    assert (note is None) == (found is None)
    assert note is None or (found is not None and note in found)
    assert clock.note_if_set() is None
