"""From distances to a match: the class, or unknown and the reason."""

from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from classify.classifiers import Comparison
from classify.library.match import Match, match_of
from classify.texture.uniformity import Uniformity

LABELS = ("a", "b", "a", "c")


def matched(
    distances: list[float],
    labels: tuple[str, ...] = LABELS,
    found_deg: list[float] | None = None,
    references_deg: list[float] | None = None,
    sharpness: list[float] | None = None,
    blurs_px: list[float] | None = None,
    blurred_px: float = 0.0,
    uniformity: Mapping[str, Uniformity] | None = None,
    **limits: float,
) -> Match:
    found = Comparison(
        np.array(distances),
        None if found_deg is None else np.array(found_deg),
        None if sharpness is None else np.array(sharpness),
        blurs_px=None if blurs_px is None else np.array(blurs_px),
    )
    references = np.array(references_deg or [0.0] * len(labels))
    return match_of(found, labels, references, limits, uniformity or {}, blurred_px=blurred_px)


@given(
    st.lists(st.tuples(st.sampled_from("abcd"), st.floats(0, 1e6)), min_size=1, max_size=30),
    st.dictionaries(st.sampled_from("abcd"), st.floats(0, 1e6)),
)
def test_a_match_follows_its_definition(
    references: list[tuple[str, float]], limits: dict[str, float]
) -> None:
    labels, distances = zip(*references, strict=True)
    match = matched(list(distances), labels, **limits)
    by_class = {label: min(d for which, d in references if which == label) for label in labels}
    assert match.distance == by_class[match.nearest] == min(distances)
    others = {label: d for label, d in by_class.items() if label != match.nearest}
    if not others:
        assert match.runner_up is match.runner_up_distance is match.margin is None
    else:
        assert match.runner_up_distance == others[match.runner_up] == min(others.values())
        assert 0.0 <= match.margin <= 1.0
        if match.runner_up_distance > 0.0:
            ratio = match.distance / match.runner_up_distance
            assert match.margin == pytest.approx(1.0 - ratio, abs=1e-9)
    tied = match.distance in others.values()
    beyond = match.distance > limits.get(match.nearest, float("inf"))
    undecided = match.limit is not None and match.margin is not None and match.margin < 0.15
    assert match.label == (None if tied or beyond or undecided else match.nearest)
    assert match.limit == limits.get(match.nearest)
    assert match.nearest in match.reason


def test_a_surface_about_as_near_to_two_classes_is_unknown() -> None:
    match = matched([2.4, 2.8, 4.0, 9.0], a=3.0)
    assert (match.label, match.nearest) == (None, "a")
    assert match.reason.endswith("too close to decide")
    assert matched([2.3, 2.8, 4.0, 9.0], a=3.0).label == "a", "the margin is large enough"
    assert matched([2.4, 2.8, 4.0, 9.0]).label == "a", "a classifier without limits"


@pytest.mark.parametrize(
    ("reference_deg", "relative_deg", "expected"),
    [(0.0, 30.0, 30.0), (170.0, 30.0, 20.0), (90.0, 90.0, 0.0), (0.0, 179.9999999, 0.0),
     (0.0, -1e-12, 0.0), (0.0, 180.0, 0.0)],
)  # fmt: skip
def test_the_orientation_is_relative_to_that_of_the_reference(
    reference_deg: float, relative_deg: float, expected: float
) -> None:
    match = matched(
        [0.5, 0.1, 0.7, 0.9],
        found_deg=[77.0, relative_deg, 77.0, 77.0],
        references_deg=[11.0, reference_deg, 11.0, 11.0],
        sharpness=[0.0, 0.8, 0.0, 0.0],
    )
    assert match.orientation_deg == expected
    assert match.sharpness == 0.8


def test_a_match_contains_plain_numbers() -> None:
    """They are written as JSON."""
    match = matched([0.5, 0.1, 0.7, 0.9], found_deg=[1.0] * 4, sharpness=[0.5] * 4, b=2.0)
    for value in (match.distance, match.runner_up_distance, match.margin, match.limit,
                  match.orientation_deg, match.sharpness):  # fmt: skip
        assert type(value) is float


@pytest.mark.parametrize(
    ("blur_px", "said"),
    [(0.0, ""), (0.2, ""), (-0.9, ", 0.9 px sharper"), (1.4, ", 1.4 px blurrier")],
)
def test_the_blur_against_the_nearest_reference_is_said(blur_px: float, said: str) -> None:
    match = matched([0.5, 0.4, 0.1, 0.9], blurs_px=[1.1, 1.2, blur_px, 1.3], a=1.0)
    assert match.label == "a"
    assert match.blur_px == pytest.approx(blur_px)
    assert match.reason == f"distance 0.10 to a, limit 1.00{said}; next is b at 0.40"


def test_the_blur_of_a_surface_that_was_blurred_first_is_that_of_the_surface() -> None:
    """Variances add up: 0.6^2 - 1^2 = -0.8^2."""
    assert matched([0.1], ("a",), blurs_px=[0.6], blurred_px=1.0).blur_px == pytest.approx(-0.8)
    assert matched([0.1], ("a",), blurs_px=[-0.6], blurred_px=0.8).blur_px == pytest.approx(-1.0)


@pytest.mark.parametrize(("blur_px", "said"), [(2.0, "2.0 px blurrier"), (-1.3, "1.3 px sharper")])
def test_a_blur_at_its_bound_makes_a_surface_unknown(blur_px: float, said: str) -> None:
    match = matched([0.5, 0.4, 0.1, 0.9], blurs_px=[0.0, 0.0, blur_px, 0.0], a=1.0)
    assert match.label is None
    assert match.reason.startswith(f"out of focus: {said}")


def test_a_match_says_what_the_nearest_class_is() -> None:
    uniformity: dict[str, Uniformity] = {"a": "no texture", "b": "varied"}
    accepted, refused = (
        matched([0.5, 0.9], ("a", "b"), uniformity=uniformity, a=limit) for limit in (1.0, 0.1)
    )
    assert (accepted.label, accepted.class_uniformity) == ("a", "no texture")
    assert "a is no texture" in accepted.reason
    assert (refused.label, refused.class_uniformity) == (None, "no texture")
    assert "no texture" not in refused.reason
    varied = matched([0.9, 0.5], ("a", "b"), uniformity=uniformity)
    assert varied.class_uniformity == "varied"
    assert "texture" not in varied.reason
    assert matched([0.9, 0.5], ("a", "b")).class_uniformity is None
