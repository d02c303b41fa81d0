"""Accuracy, confusion and orientation errors of trials."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from classify import InputError, Match, Trial, evaluate
from classify.library.evaluation import (
    nearest_accuracy,
)

ANGLES = st.floats(-720, 720)


def answer(label: str | None, orientation_deg: float | None = 0.0) -> Match:
    return Match(label, label or "a", orientation_deg, 0.1, "z", 0.2, 0.5)


@given(ANGLES, ANGLES)
def test_orientation_error_is_the_angle_between_two_lines(found: float, true: float) -> None:
    error = Trial("a", true, answer("a", found)).orientation_error_deg
    assert error is not None
    assert 0.0 <= error <= 90.0
    cosine = abs(np.cos(np.radians(found - true)))
    assert np.cos(np.radians(error)) == pytest.approx(cosine, abs=1e-9)


def test_a_rejected_trial_counts_by_its_nearest_class_too() -> None:
    trials = [
        Trial("a", 10.0, answer("a", 12.0)),
        Trial("a", 10.0, answer(None, 14.0)),
        Trial("b", 10.0, answer(None, 10.0)),
        Trial("b", 10.0, answer("a", 10.0)),
    ]
    assert evaluate(trials, "ab").accuracy == 0.25
    assert nearest_accuracy(trials) == 0.5
    assert evaluate(trials, "ab").orientation_error_deg.median == 2.0
    assert [trial.nearest_orientation_error_deg for trial in trials] == [2.0, 4.0, None, None]
    assert nearest_accuracy([]) is None


def test_no_orientation_error_without_truth_or_with_the_wrong_class() -> None:
    assert Trial("a", None, answer("a", 5.0)).orientation_error_deg is None
    assert Trial("a", 5.0, answer("a", None)).orientation_error_deg is None
    assert Trial("a", 5.0, answer("b", 5.0)).orientation_error_deg is None
    assert Trial("a", 5.0, answer(None, 5.0)).orientation_error_deg is None


def test_results_are_counted_by_class() -> None:
    trials = [
        Trial("b", 10.0, answer("b", 12.0)),
        Trial("b", 20.0, answer("b", 16.0)),
        Trial("b", 30.0, answer("a", 30.0)),
        Trial("a", None, answer("a", 90.0)),
        Trial("a", 0.0, answer(None)),
        Trial("c", 0.0, answer("b")),
    ]
    result = evaluate(trials, "abc")
    assert (result.sets, result.correct, result.unknown) == (6, 3, 1)
    assert result.accuracy == 0.5
    assert list(result.per_class) == ["a", "b", "c"]
    assert result.per_class["b"].accuracy == pytest.approx(2 / 3)
    assert result.per_class["c"].accuracy == 0.0
    assert result.confusion == {"b": {"b": 2, "a": 1}, "a": {"a": 1, None: 1}, "c": {"b": 1}}
    assert result.orientation_error_deg.median == pytest.approx(3.0)
    assert result.orientation_error_deg.p95 == pytest.approx(3.9)
    assert result.per_class["c"].orientation_error_deg.median is None
    assert result.per_class["a"].orientation_error_deg.p95 is None


@given(st.lists(st.tuples(st.sampled_from("abc"), st.sampled_from(["a", "b", "c", None])),
                min_size=1), st.sampled_from(["abc", "ab", ""]))  # fmt: skip
def test_a_confusion_holds_every_trial_once(
    pairs: list[tuple[str, str | None]], taught: str
) -> None:
    result = evaluate([Trial(true, None, answer(found)) for true, found in pairs], taught)
    assert set(result.confusion) <= set(taught)
    assert not set(result.untaught) & set(taught)
    counted = sum(sum(row.values()) for row in result.confusion.values())
    right = sum(row.get(true, 0) for true, row in result.confusion.items())
    assert counted == result.sets
    assert counted + sum(sum(row.values()) for row in result.untaught.values()) == len(pairs)
    assert right == result.correct
    assert result.unknown == sum(row.get(None, 0) for row in result.confusion.values())
    assert sum(group.sets for group in result.per_class.values()) == result.sets


def test_an_evaluation_needs_trials() -> None:
    with pytest.raises(InputError, match="nothing to evaluate"):
        evaluate([], "a")


def test_sets_of_untaught_classes_are_counted_for_themselves() -> None:
    """Unknown is the right answer to them, and any class a wrong one."""
    blurred = replace(answer(None), blur_px=1.5, heading_deg=10.0)
    trials = [
        Trial("oak", 10.0, blurred),
        Trial("oak", 0.0, answer(None)),
        Trial("b", 0.0, answer("a")),
    ]
    result = evaluate(trials, ("a",))
    assert result.untaught == {"oak": {None: 2}, "b": {"a": 1}}
    assert (result.untaught_rejected, result.untaught_accepted) == (2, 1)
    assert (result.sets, result.correct, result.unknown, result.accuracy) == (0, 0, 0, None)
    assert (result.per_class, result.confusion) == ({}, {})
    assert (result.headings, result.blur_px, result.orientation_error_deg.median) == (0, None, None)


@given(ANGLES, st.floats(-89, 89), st.booleans(), st.integers(-3, 3))
def test_a_heading_is_reversed_beyond_a_right_angle(
    true: float, off: float, around: bool, circles: int
) -> None:
    match = replace(answer("a"), heading_deg=true + off + 180.0 * around + 360.0 * circles)
    assert Trial("a", true, match).is_reversed == around


def test_headings_are_counted_where_there_are_any() -> None:
    told = replace(answer("a"), heading_deg=170.0)
    trials = [
        Trial("a", 175.0, told),
        Trial("a", 355.0, told),
        Trial("a", None, told),
        Trial("b", 175.0, told),
        Trial("a", 175.0, answer("a")),
    ]
    result = evaluate(trials, "ab")
    assert (result.headings, result.reversed) == (2, 1)


def test_the_median_blur_is_that_of_the_trials_that_have_one() -> None:
    def trial(blur_px: float | None) -> Trial:
        return Trial("a", None, replace(answer("a"), blur_px=blur_px))

    assert evaluate([trial(blur_px) for blur_px in (0.2, None, 1.0, 0.9)], "a").blur_px == 0.9
    assert evaluate([trial(None)], "a").blur_px is None
