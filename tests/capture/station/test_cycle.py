"""The cycle: order, overlap, commit order, refusals, and no way from an exception to PASS."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from capture.sets.captured_set import CapturedSet
from capture.station.events import PartAnnounced, StationStopped
from capture.station.verdict import Decision

from .stations import Bench, bench, one_after_the_other, small_set


@pytest.fixture(scope="module")
def captured() -> CapturedSet:
    return small_set()


@pytest.fixture
def station(tmp_path: Path, captured: CapturedSet) -> Iterator[Bench]:
    with bench(tmp_path / "line-1", captured) as made:
        yield made


def test_parts_are_announced_in_the_order_of_their_triggers(station: Bench) -> None:
    station.run(one_after_the_other(5), count=5)
    ids = [f"part-{number:06d}" for number in range(1, 6)]
    assert station.announced() == station.rows() == [(each, Decision.PASS) for each in ids]
    assert all(
        (station.folder.path / e.result.set_file).is_file() for e in station.of(PartAnnounced)
    )
    assert station.of(StationStopped)[-1].announced == {Decision.PASS: 5}
