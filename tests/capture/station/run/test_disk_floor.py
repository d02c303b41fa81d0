from pathlib import Path
from unittest.mock import Mock, patch

from hypothesis import given
from hypothesis import strategies as st

from capture.station.domain.fault import Fault
from capture.station.domain.verdict import Cause
from capture.station.run.self_test import disk_fault


def floor_fault(free_bytes: int, sets_bytes: int, floor_mb: int) -> Fault | None:
    with patch("shutil.disk_usage", lambda _: Mock(free=free_bytes)):
        return disk_fault(Path(), floor_mb, sets_bytes)


@given(st.integers(0, 10**15), st.integers(0, 10**11), st.integers(1, 10**7))
def test_triggers_are_refused_exactly_where_a_set_would_reach_the_floor(
    free_bytes: int, sets_bytes: int, floor_mb: int
) -> None:
    left_bytes = free_bytes - sets_bytes
    assert (floor_fault(free_bytes, sets_bytes, floor_mb) is None) == (
        left_bytes >= floor_mb * 1_000_000
    )


def test_the_fault_has_device_value_and_limit() -> None:
    fault = floor_fault(510_000_000, 20_000_000, 500)
    assert (fault.cause, fault.device) == (Cause.STORAGE, "disk")
    assert (fault.measured, fault.limit) == (510.0, 500.0)
    assert "20 MB" in str(fault)
