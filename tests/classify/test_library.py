"""Training and asking a library, on directional textures of known orientation."""

from dataclasses import replace

import numpy as np
import pytest

from classify import InputError, LibraryError, TextureLibrary

KINDS = ("ripple", "fine", "grain", "even")
DIRECTED = ("ripple", "fine", "grain")


@pytest.fixture(scope="module")
def library(texture) -> TextureLibrary:
    return TextureLibrary.train((kind, texture(kind, seed=1)) for kind in KINDS)


def off_deg(found: float, true: float) -> float:
    return abs((found - true + 90.0) % 180.0 - 90.0)


@pytest.mark.parametrize("turn_deg", [0.0, 17.0, 61.0, 90.0, 133.0, 179.0])
@pytest.mark.parametrize("kind", KINDS)
def test_the_same_patch_turned_is_recognised(library, texture, kind: str, turn_deg: float) -> None:
    match = library.classify(texture(kind, turn_deg, seed=1))
    assert match.label == match.nearest == kind
    assert 0.0 <= match.distance < match.runner_up_distance <= 1.0
    assert match.runner_up != kind
    assert match.margin == pytest.approx(1 - match.distance / match.runner_up_distance)
    assert 0.0 <= match.orientation_deg < 180.0
    if kind in DIRECTED:
        assert off_deg(match.orientation_deg, turn_deg) < 2.0


def test_an_unturned_set_lies_at_0_and_not_a_hair_below_180(library, texture) -> None:
    for kind in DIRECTED:
        assert library.classify(texture(kind, seed=1)).orientation_deg == 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_another_patch_of_the_class_is_recognised(library, texture, kind: str) -> None:
    """Other waves of the same distribution, so the class is what they share."""
    for seed, turn_deg in ((7, 25.0), (8, 100.0), (9, 158.0)):
        match = library.classify(texture(kind, turn_deg, seed=seed, side=192))
        assert match.label == kind
        if kind in DIRECTED:
            assert off_deg(match.orientation_deg, turn_deg) < 5.0


def test_a_frame_of_another_shape_is_asked_with_the_segments_of_the_library(
    library, texture
) -> None:
    assert library.segment_px == 64
    match = library.classify(texture("grain", 40.0, seed=1, side=300, rows=180))
    assert match.label == "grain"
    assert off_deg(match.orientation_deg, 40.0) < 4.0


def test_labels_stand_in_order_of_training(library) -> None:
    assert library.labels == KINDS


def test_the_smallest_training_frame_sets_the_segments(texture) -> None:
    library = TextureLibrary.train([
        ("a", texture("grain", side=256)), ("b", texture("fine", side=100))
    ])  # fmt: skip
    assert library.segment_px == 32


def test_later_sets_of_a_class_are_aligned_to_the_first(texture) -> None:
    library = TextureLibrary.train(
        ("grain", texture("grain", turn, seed=1)) for turn in (0.0, 50.0, 140.0)
    )
    assert library.labels == ("grain",)
    found = [reference.orientation_deg for reference in library.references]
    for orientation, turn in zip(found, (0.0, 50.0, 140.0), strict=True):
        assert off_deg(orientation, turn) < 1.0
    match = library.classify(texture("grain", 77.0, seed=1))
    assert off_deg(match.orientation_deg, 77.0) < 2.0


def test_a_given_training_orientation_is_what_answers_refer_to(texture) -> None:
    library = TextureLibrary.train([
        ("grain", texture("grain", 30.0, seed=1), 30.0),
        ("grain", texture("grain", 75.0, seed=2), 75.0 + 180.0),
        ("fine", texture("fine", 20.0, seed=1), None),
    ])  # fmt: skip
    orientations = [reference.orientation_deg for reference in library.references]
    assert orientations == [30.0, 75.0, 0.0]
    assert off_deg(library.classify(texture("grain", 100.0, seed=1)).orientation_deg, 100.0) < 2.0
    assert off_deg(library.classify(texture("fine", 50.0, seed=1)).orientation_deg, 30.0) < 2.0


def test_a_set_without_orientation_is_aligned_to_a_given_one(texture) -> None:
    library = TextureLibrary.train([
        ("grain", texture("grain", 30.0, seed=1), 30.0), ("grain", texture("grain", 65.0, seed=1)),
    ])  # fmt: skip
    assert off_deg(library.references[1].orientation_deg, 65.0) < 1.0


def test_more_sets_of_a_class_bring_its_new_patches_nearer(texture) -> None:
    one = TextureLibrary.train([("grain", texture("grain", seed=1))])
    four = TextureLibrary.train(("grain", texture("grain", seed=s)) for s in (1, 2, 3, 4))
    asked = [texture("grain", 45.0, seed=s) for s in range(10, 16)]
    assert all(four.classify(s).distance <= one.classify(s).distance for s in asked)
    assert any(four.classify(s).distance < one.classify(s).distance for s in asked)


def test_a_library_of_one_class_has_no_runner_up(texture) -> None:
    library = TextureLibrary.train([("grain", texture("grain", seed=1))] * 2)
    match = library.classify(texture("ripple", seed=1))
    assert match.label == match.nearest == "grain"
    assert match.runner_up is None
    assert match.runner_up_distance is None
    assert match.margin is None


def test_of_two_equal_classes_neither_is_named(texture) -> None:
    surface = texture("grain", seed=1)
    library = TextureLibrary.train([("a", surface), ("b", surface)])
    for asked in (surface, texture("grain", 20.0, seed=5)):
        match = library.classify(asked)
        assert match.label is None
        assert (match.nearest, match.runner_up) == ("a", "b")
        assert match.margin == 0.0


def test_answers_are_the_same_every_time(library, texture) -> None:
    surface = texture("grain", 33.0, seed=4)
    again = TextureLibrary.train((kind, texture(kind, seed=1)) for kind in KINDS)
    assert library.classify(surface) == library.classify(surface) == again.classify(surface)


def test_a_library_needs_samples_and_labels(texture) -> None:
    with pytest.raises(LibraryError, match="nothing to train on"):
        TextureLibrary.train([])
    with pytest.raises(LibraryError, match="at least one training set"):
        TextureLibrary((), 64)
    for label in ("", "  "):
        with pytest.raises(LibraryError, match="has no label"):
            TextureLibrary.train([(label, texture("grain"))])


@pytest.mark.parametrize("orientation_deg", [np.nan, np.inf])
def test_a_training_orientation_must_be_a_number(texture, orientation_deg: float) -> None:
    with pytest.raises(LibraryError, match="orientation of a training set of grain"):
        TextureLibrary.train([("grain", texture("grain"), orientation_deg)])


def test_surfaces_that_cannot_be_asked_about_are_named(library, texture) -> None:
    with pytest.raises(InputError, match="smaller than the 64 px segments"):
        library.classify(texture("grain", side=60))
    with pytest.raises(InputError, match="too small for a texture"):
        TextureLibrary.train([("grain", texture("grain", side=60))])
    surface = texture("grain")
    with pytest.raises(InputError, match="no pixel of this surface is valid"):
        library.classify(replace(surface, valid=np.zeros_like(surface.valid)))
