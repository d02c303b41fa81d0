"""Differences of fields and of maps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from capture.maps.comparison import field_differences, map_difference

ALL = np.ones((4, 5), np.bool_)
values = st.recursive(
    st.none() | st.integers(-3, 3) | st.text(max_size=2),
    lambda inner: st.dictionaries(st.sampled_from("abc"), inner, max_size=3),
    max_leaves=8,
)
facts = st.dictionaries(st.sampled_from("abc"), values, max_size=3)


def test_fields_are_compared_one_by_one() -> None:
    one = {"rig": {"camera": "a", "lights": [0, 90]}, "label": "oak", "note": None}
    other = {"rig": {"camera": "b", "lights": [0, 90]}, "label": "oak", "gain": 2}
    assert list(field_differences(one, other)) == [
        ("rig.camera", "a", "b"),
        ("gain", None, 2),
    ]


@given(facts, facts)
def test_both_ways_find_the_same_fields(one: dict, other: dict) -> None:
    assert list(field_differences(one, one)) == []
    there, back = list(field_differences(one, other)), list(field_differences(other, one))
    assert {field for field, *_ in there} == {field for field, *_ in back}
    assert all(first != second for _, first, second in there)


def test_a_map_that_is_higher_by_a_constant_differs_by_it() -> None:
    one = np.arange(20, dtype=np.float32).reshape(4, 5)
    found = map_difference(one, one + 2.0, ALL, "mm")
    assert found is not None
    assert (found.mean, found.rms, found.p95, found.largest) == (2.0, 2.0, 2.0, 2.0)
    assert found.correlation == pytest.approx(1.0)
    assert found.unit == "mm"


def test_invalid_pixels_and_nan_are_left_out() -> None:
    one, other = np.zeros((2, 4, 5), np.float32)
    other[0, 0], other[1, 1] = 100.0, np.nan
    valid = ALL.copy()
    valid[0, 0] = False
    found = map_difference(one, other, valid, "")
    assert found is not None
    assert found.largest == 0.0
    assert found.correlation == 0.0  # even maps
    assert map_difference(one, other, ~ALL, "") is None
