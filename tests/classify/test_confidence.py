"""Tests of exact bounds and tolerance limits."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from classify.base.errors import InputError
from classify.confidence import share_at_least, share_at_most, tolerance_factor, trials_to_show


def tail(events: int, trials: int, share: float) -> float:
    """Probability of at most `events` in `trials`, summed term by term."""
    return math.fsum(
        math.comb(trials, k) * share**k * (1.0 - share) ** (trials - k) for k in range(events + 1)
    )


@given(st.integers(1, 200).flatmap(lambda n: st.tuples(st.integers(0, n - 1), st.just(n))))
def test_at_most_so_many_events_have_five_percent_chance_at_the_bound(
    counts: tuple[int, int],
) -> None:
    events, trials = counts
    assert tail(events, trials, share_at_most(events, trials)) == pytest.approx(0.05, rel=1e-6)


@given(st.integers(0, 100), st.integers(0, 100))
def test_the_bounds_enclose_the_share(events: int, others: int) -> None:
    trials = events + others
    assert 0.0 <= share_at_least(events, trials) <= share_at_most(events, trials) <= 1.0
    if trials:
        assert share_at_least(events, trials) <= events / trials <= share_at_most(events, trials)


def test_149_parts_without_a_miss_bound_the_misses_at_two_percent() -> None:
    assert trials_to_show(0.02) == 149
    assert share_at_most(0, 149) <= 0.02 < share_at_most(0, 148)
    assert share_at_most(0, 0) == 1.0


@pytest.mark.parametrize(("count", "factor"), [(3, 10.553), (10, 3.981), (30, 3.064)])
def test_tolerance_factors_are_those_of_published_tables(count: int, factor: float) -> None:
    # NIST Handbook 1 / ISO 16269-6, one-sided, coverage 99 %, confidence 95 %.
    assert tolerance_factor(count) == pytest.approx(factor, abs=0.002)


def test_counts_and_values_that_show_nothing_are_refused() -> None:
    with pytest.raises(InputError, match="3 events in 2 trials"):
        share_at_most(3, 2)
    with pytest.raises(InputError, match="1 values have no spread"):
        tolerance_factor(1)
    with pytest.raises(InputError, match="between 0 and 1"):
        trials_to_show(0.0)
