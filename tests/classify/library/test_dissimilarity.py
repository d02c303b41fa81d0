"""Dissimilarities of classes, their dendrogram, and the map of sets."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist, pdist

from classify import Lighting, TextureLibrary, photometric_stereo
from classify.base.errors import InputError
from classify.library.dissimilarity import class_dissimilarities, dendrogram, embedding


@given(st.integers(2, 8), st.integers(0, 10**6))
def test_points_of_a_plane_come_back_in_their_distances(classes: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    landmarks, points = rng.normal(size=(classes + 1, 2)), rng.normal(size=(20, 2))
    placed = embedding(cdist(points, landmarks), cdist(landmarks, landmarks))
    np.testing.assert_allclose(pdist(placed), pdist(points), atol=1e-6)


def test_two_classes_are_mapped_to_a_line() -> None:
    distances = np.array([[0.0, 2.0], [2.0, 0.0], [1.0, 1.0]])
    placed = embedding(distances, np.array([[0.0, 2.0], [2.0, 0.0]]))
    assert np.allclose(placed[:, 1], 0.0)
    assert abs(placed[0, 0] - placed[1, 0]) == pytest.approx(2.0)
    assert placed[2, 0] == pytest.approx(0.0)


def test_dissimilarities_are_medians_of_both_ways() -> None:
    distances = np.array([[0.1, 4.0], [0.2, 6.0], [0.3, 50.0], [8.0, 0.1]])
    found = class_dissimilarities(distances, [0, 0, 0, 1])
    np.testing.assert_allclose(found, [[0.0, 7.0], [7.0, 0.0]])


def test_a_dendrogram_joins_the_nearest_first() -> None:
    places = np.array([0.0, 10.0, 1.0, 12.0])
    tree = dendrogram(abs(places[:, None] - places))
    # Each pair stands side by side, and the pairs are joined last.
    assert {frozenset(tree.order[:2]), frozenset(tree.order[2:])} == {
        frozenset({0, 2}), frozenset({1, 3}),
    }  # fmt: skip
    heights = sorted(tree.branches[:, 1, 0].tolist())
    assert heights == pytest.approx([1.0, 2.0, 10.5])
    assert sorted({place for branch in tree.branches for _, place in branch})[0] == 0.0


def test_one_class_has_no_dendrogram() -> None:
    with pytest.raises(InputError, match="one class"):
        dendrogram(np.zeros((1, 1)))


def test_distances_to_classes_are_those_of_the_match() -> None:
    rng = np.random.default_rng(1)
    lighting = Lighting.ring(45.0)
    surfaces = [
        photometric_stereo(
            (rng.uniform(50.0, 200.0, (4, 96, 96)) * scale).astype(np.uint8), lighting, "ps4"
        )
        for scale in (1.0, 0.9, 0.8)
    ]
    library = TextureLibrary.train([("a", surfaces[0]), ("b", surfaces[1])], "spectra_2d")
    found = library.distances(surfaces[2])
    match = library.classify(surfaces[2])
    assert found[match.nearest] == pytest.approx(match.distance)
    assert match.runner_up is not None
    assert found[match.runner_up] == pytest.approx(match.runner_up_distance)
