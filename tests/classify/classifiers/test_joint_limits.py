"""Limits of classes, on references that are points of a line."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from classify.classifiers.joint_learning import (
    class_limits,
    limit_of_sets,
    scatter_factor,
    unit_limit,
)


def limits_of(positions: np.ndarray, labels: list[str], single: float) -> dict[str, float]:
    def distances(index: int, others: np.ndarray) -> np.ndarray:
        return np.abs(positions[others] - positions[index])

    return class_limits(
        labels,
        range(len(labels)),
        np.full(len(labels), single, np.float32),
        distances,
        lambda index, others: float(distances(index, others).min()),
    )


@pytest.mark.parametrize("count", [1, 2, 300])
def test_no_limit_exceeds_the_distance_to_the_nearest_other_class(count: int) -> None:
    """Also where only references of the lowest bounds are compared."""
    positions = np.concatenate([-0.001 * np.arange(count), 1.5 + 0.001 * np.arange(count)])
    labels = ["near"] * count + ["far"] * count
    for limit in limits_of(positions, labels, 2.0).values():
        assert limit == pytest.approx(1.5)
    assert max(limits_of(positions, labels, 1.0).values()) == pytest.approx(1.0)


def test_sets_far_apart_do_not_raise_a_limit() -> None:
    """Not above that of one set, nor above the distance to a class between them."""
    limits = limits_of(np.array([0.0, 50.0, 20.0]), ["apart", "apart", "between"], 2.0)
    assert limits["between"] == pytest.approx(2.0)
    assert limits["apart"] < 2.0
    limits = limits_of(np.array([0.0, 5.0, 1.0]), ["apart", "apart", "between"], 2.0)
    assert limits == {"apart": pytest.approx(1.0), "between": pytest.approx(1.0)}


@given(st.floats(0.1, 10.0), st.lists(st.floats(1e-6, 100.0), max_size=20))
def test_a_limit_of_sets_is_between_a_third_and_the_whole_of_that_of_one(
    limit: float, distances: list[float]
) -> None:
    assert 0.3 * limit < limit_of_sets(limit, distances) <= 1.001 * limit


@given(st.floats(0.1, 10.0), st.integers(1, 20))
def test_more_sets_at_the_expected_distance_tighten_a_limit(limit: float, count: int) -> None:
    median = 0.36 * limit
    assert limit_of_sets(limit, [median] * (count + 1)) < limit_of_sets(limit, [median] * count)
    assert limit_of_sets(limit, [0.01 * limit] * count) == pytest.approx(limit)


def test_sets_far_apart_have_the_limit_of_the_nearest_of_as_many() -> None:
    """The 99th percentile of the distance to the nearest, drawn from 100,000 classes."""
    rng = np.random.default_rng(1)
    classes, patches = rng.normal(0.0, 0.34, (100_000, 1)), rng.normal(0.0, 0.26, (100_000, 3))
    drawn = [np.quantile((classes + patches[:, :count]).min(axis=1), 0.99) for count in (1, 2, 3)]
    found = [limit_of_sets(2.0, [50.0] * count) for count in (1, 2, 3, 4)]
    assert found[0] == pytest.approx(2.0)
    assert found[1:3] == pytest.approx(2.0 * np.exp(np.subtract(drawn[1:], drawn[0])), rel=0.02)
    assert found[3] == found[2]


def test_small_frames_have_smaller_limits() -> None:
    assert unit_limit(128 * 128) < unit_limit(256 * 256) == unit_limit(1024 * 1024)


def test_a_class_of_little_scatter_has_three_quarters_of_the_usual_limit() -> None:
    """Differences from one day to the next do not depend on the scatter."""
    of_none, of_little, usual = (scatter_factor(np.full(6, each)) for each in (0.0, 0.3, 1.0))
    assert of_none == of_little == pytest.approx(0.75 * usual, rel=0.02)
