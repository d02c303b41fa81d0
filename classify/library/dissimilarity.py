"""Dissimilarities of trained textures or of two surfaces, their grouping, and a map of sets."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.cluster import hierarchy
from scipy.spatial.distance import squareform

from classify.base.arrays import Floats
from classify.base.errors import InputError
from classify.classifiers import Observation, classifier_named
from classify.methods import DEFAULT_CLASSIFIER
from classify.surface.estimate import SurfaceEstimate
from classify.texture.spectra import segment_for

from .match import Match
from .texture_library import TextureLibrary
from .training import TrainingRow, observe


def class_dissimilarities(distances: Floats, classes: Sequence[int]) -> Floats:
    """(C, C) median distances of the sets of one class to another, the mean of both directions."""
    members = np.asarray(classes)
    one_way = np.stack(
        [np.median(distances[members == index], axis=0) for index in range(distances.shape[1])]
    )
    return _symmetric(one_way)


def _symmetric(one_way: Floats) -> Floats:
    """Mean of both directions of (n, n) distances; 0 from a class or set to itself."""
    symmetric: Floats = 0.5 * (one_way + one_way.T)
    np.fill_diagonal(symmetric, 0.0)
    return symmetric


def own_scatter_limits(library: TextureLibrary) -> dict[str, float]:
    """Limit of each class by its own scatter: it may exceed the distance to another class."""
    limits, labels = classifier_named(library.classifier).limits, np.array(library.labels)
    limit_of_class: dict[str, float] = {}
    for label in library.classes:
        is_member = labels == label
        # As if trained alone: no other class caps the limit. All references count as one set, so
        # that no distances between sets raise it.
        names, sets = labels[is_member].tolist(), [0] * int(is_member.sum())
        signatures = library.signatures[is_member]
        limit_of_class |= limits(names, sets, signatures, library.parameters, library.uniformity)
    return limit_of_class


class Dendrogram(NamedTuple):
    """A tree of C classes."""

    order: list[int]  # from top to bottom, so that no branches cross
    branches: Floats  # (C - 1, 4, 2) corners of each branch: dissimilarity, and place in `order`


def dendrogram(dissimilarities: Floats) -> Dendrogram:
    """Group two or more classes by average linkage (UPGMA, Sokal and Michener 1958)."""
    if len(dissimilarities) < 2:
        raise InputError("one class cannot be grouped; give two or more")
    tree = hierarchy.linkage(squareform(dissimilarities, checks=False), method="average")
    layout = hierarchy.dendrogram(tree, no_plot=True)
    # scipy places leaf n at 10 n + 5.
    places = (np.array(layout["icoord"]) - 5.0) / 10.0
    return Dendrogram(layout["leaves"], np.stack([np.array(layout["dcoord"]), places], axis=-1))


def embedding(set_to_class: Floats, class_to_class: Floats) -> Floats:
    """(n, 2) map of sets by landmark multidimensional scaling (de Silva and Tenenbaum 2004).

    The landmarks are the classes: the distances are (n, C) and (C, C).
    """
    squares = np.square(class_to_class)
    means = squares.mean(axis=0)
    centred = -0.5 * (squares - means - means[:, None] + squares.mean())
    values, vectors = np.linalg.eigh(centred)
    places = np.zeros((len(set_to_class), 2))
    for axis, index in enumerate(np.argsort(values)[::-1][:2]):
        if values[index] > 1e-9 * abs(values).max():
            axis_weights = vectors[:, index] / np.sqrt(values[index])
            places[:, axis] = -0.5 * (np.square(set_to_class) - means) @ axis_weights
    return places


def texture_groups(
    rows: Sequence[TrainingRow], tests: Sequence[Observation], segment_px: int, max_distance: float
) -> list[int]:
    """Group of each of two or more sets, by average linkage up to the distance `max_distance`."""
    names = [str(number) for number in range(len(rows))]
    library = TextureLibrary.from_observations(
        [row._replace(label=name) for row, name in zip(rows, names, strict=True)], segment_px
    )
    classifier, labels = classifier_named(library.classifier), np.array(library.labels)
    one_way = np.empty((len(rows), len(rows)))
    for number, test in enumerate(tests):
        signature = classifier.signature(test, library.parameters)
        distances = classifier.compare(signature, library.signatures, library.parameters).distances
        one_way[number] = [distances[labels == name].min() for name in names]
    tree = hierarchy.linkage(squareform(_symmetric(one_way)), method="average")
    return [int(group) for group in hierarchy.fcluster(tree, max_distance, "distance")]


@dataclass(frozen=True)
class TexturePair:
    """The difference of two textures."""

    distance: float  # mean of both directions; 0: equal, 1: as two quarters of one frame
    angle_deg: float  # from the first to the second, anticlockwise, [-90, 90)
    sharpness: float  # of the angle: 0 not determined, 1 exactly
    blur_px: float  # sigma of the Gaussian by which the second is blurrier; negative: sharper


def compare_textures(first: SurfaceEstimate, second: SurfaceEstimate) -> TexturePair:
    """Compare two surfaces as the joint classifier does, without any training."""
    first, second = first.inscribed, second.inscribed
    segment_px = min(segment_for(first.shape), segment_for(second.shape))
    forward, backward = _match(first, second, segment_px), _match(second, first, segment_px)
    return TexturePair(
        distance=0.5 * (forward.distance + backward.distance),
        angle_deg=((forward.orientation_deg or 0.0) + 90.0) % 180.0 - 90.0,
        sharpness=forward.sharpness or 0.0,
        blur_px=forward.blur_px or 0.0,
    )


def _match(known: SurfaceEstimate, test: SurfaceEstimate, segment_px: int) -> Match:
    """Match a surface with a library of one other surface."""
    row = TrainingRow("known", observe(known, segment_px, DEFAULT_CLASSIFIER), 0.0)
    library = TextureLibrary.from_observations([row], segment_px, planar=known.planar)
    return library.match(library.observe(test))
