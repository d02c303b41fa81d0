from hypothesis import given
from hypothesis import strategies as st

from capture.station.run.self_test import floor_fault


@given(st.integers(0, 10**15), st.integers(0, 10**11), st.integers(1, 10**7))
def test_triggers_are_refused_exactly_where_a_set_would_reach_the_floor(
    free_bytes: int, sets_bytes: int, floor_mb: int
) -> None:
    left_bytes = free_bytes - sets_bytes
    assert (floor_fault(free_bytes, sets_bytes, floor_mb) is None) == (
        left_bytes >= floor_mb * 1_000_000
    )


def test_the_reason_has_all_sizes() -> None:
    assert floor_fault(510_000_000, 20_000_000, 500) == (
        "disk: 510 MB free, the floor is 500 MB, the next sets need 20 MB; make room"
    )
    assert floor_fault(490_000_000, 0, 500) == ("disk: 490 MB free, the floor is 500 MB; make room")
