"""Times for people, on the clock of a machine in Berlin."""

import time
from collections.abc import Iterator

import pytest

from capture.base.utc_time import local_time, local_zone
from capture.station.results.history import utc_bound


@pytest.fixture(autouse=True)
def _berlin(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("TZ", "Europe/Berlin")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


def test_a_time_names_its_zone_in_winter_and_in_summer() -> None:
    assert local_time("2026-11-22T17:08:13.042Z") == "2026-11-22 18:08 CET"
    assert local_time("2026-07-01T17:08:13Z", "seconds") == "2026-07-01 19:08:13 CEST"
    assert local_zone() in ("CET, UTC+01:00", "CEST, UTC+02:00")


@pytest.mark.parametrize(
    ("since", "until", "begin", "end"),
    [
        ("2026-11-22", "2026-11-22", "2026-11-21T23:00:00.000Z", "2026-11-22T22:59:59.999Z"),
        # The clock is set forward on the one day, and back on the other.
        ("2026-03-29", "2026-03-29", "2026-03-28T23:00:00.000Z", "2026-03-29T21:59:59.999Z"),
        ("2026-10-25T02:30", "2026-10-25T02:30", "2026-10-25T00:30:00.000Z",
         "2026-10-25T01:30:59.999Z"),
        ("2026-11-22T18:00Z", "2026-11-22T18:00+05:00", "2026-11-22T18:00:00.000Z",
         "2026-11-22T13:00:00.000Z"),
    ],
)  # fmt: skip
def test_bounds_are_on_the_local_clock_unless_they_name_another(
    since: str, until: str, begin: str, end: str
) -> None:
    assert utc_bound("since", since, is_local=True) == begin
    assert utc_bound("until", until, is_end=True, is_local=True) == end


def test_bounds_of_programs_are_utc() -> None:
    assert utc_bound("since", "2026-11-22") == "2026-11-22T00:00:00.000Z"
    assert utc_bound("until", "2026-11-22", is_end=True) == "2026-11-22T23:59:59.999Z"
