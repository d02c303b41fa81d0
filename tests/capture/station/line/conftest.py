"""A captured set for stations whose triggers come from a PLC."""

import pytest

from capture.sets.captured_set import CapturedSet
from tests.capture.station.stations import small_set


@pytest.fixture(scope="session")
def captured() -> CapturedSet:
    return small_set()
