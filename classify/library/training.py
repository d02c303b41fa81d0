"""Training: from observed sets to references, parameters and limits."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from classify.base.arrays import FloatMap, Floats
from classify.base.errors import LibraryError
from classify.classifiers import Classifier, Observation, Parameters, classifier_named
from classify.lighting import Lighting
from classify.methods import DEFAULT_CLASSIFIER, checked_label
from classify.surface.estimate import SurfaceEstimate
from classify.texture.heading import MIN_SCORE
from classify.texture.uniformity import Uniformity, uniformity_of

SAME_LIGHT_DEG = 1.0
"""Lights that differ by less count as the same (test_classifiers.py tries 0.5 and 5 degrees)."""


class TrainingRow(NamedTuple):
    """One training set: its class, observation, and orientation in degrees if known."""

    label: str
    observation: Observation
    orientation_deg: float | None = None


class _Learned(NamedTuple):
    """Result of a training; see `TextureLibrary`."""

    labels: tuple[str, ...]
    oriented: tuple[str, ...]
    orientations_deg: Floats
    signatures: FloatMap
    parameters: Parameters
    uniformity: dict[str, Uniformity]
    limits: dict[str, float]


def observe(
    surface: SurfaceEstimate, segment_px: int, classifier: str = DEFAULT_CLASSIFIER
) -> Observation:
    """Observe one training surface, for `TextureLibrary.from_observations`."""
    observation: Observation = classifier_named(classifier).observe_training(surface, segment_px)
    return observation


def learn_references(rows: Sequence[TrainingRow], classifier: Classifier[Any, Any]) -> _Learned:
    """Learn from sets; orientations and errors as in `TextureLibrary.train`."""
    if not rows:
        raise LibraryError("nothing to train on; give at least one set")
    for label, _, orientation_deg in rows:
        if not label.strip():
            raise LibraryError("a training set has no label; give each set its class")
        checked_label(label)
        if orientation_deg is not None and not math.isfinite(orientation_deg):
            raise LibraryError(
                f"the orientation of a training set of {label} is {orientation_deg}; "
                "give degrees, or leave it out"
            )
    parameters = classifier.learn([row.observation for row in rows], [row.label for row in rows])
    # Sets of known orientation come first, so that they define the orientations of their class.
    order = sorted(range(len(rows)), key=lambda number: rows[number].orientation_deg is None)
    first_of_class: dict[str, tuple[FloatMap, float]] = {}
    learned: dict[int, tuple[FloatMap, float]] = {}
    for number in order:
        label, observation, orientation_deg = rows[number]
        references = classifier.references(observation, parameters)
        if orientation_deg is None and label in first_of_class:
            first, first_deg = first_of_class[label]
            references, relative_deg = _aligned(references, first, classifier, parameters)
            orientation_deg = first_deg + relative_deg
        # Rounded first: -1e-12 is 0, not 360 - 1e-12.
        learned[number] = references, round(orientation_deg or 0.0, 6) % 360.0
        first_of_class.setdefault(label, (references[0], learned[number][1]))
    ordered = [learned[number] for number in range(len(rows))]
    counts = [len(references) for references, _ in ordered]
    labels = tuple(np.repeat([row.label for row in rows], counts).tolist())
    sets = np.repeat(np.arange(len(rows)), counts).tolist()
    signatures = np.concatenate([references for references, _ in ordered])
    uniformity = _uniformity(rows, classifier)
    return _Learned(
        labels=labels,
        oriented=tuple(dict.fromkeys(row.label for row in rows if row.orientation_deg is not None)),
        orientations_deg=np.repeat([degrees for _, degrees in ordered], counts),
        signatures=signatures,
        parameters=parameters,
        uniformity=uniformity,
        limits=classifier.limits(labels, sets, signatures, parameters, uniformity),
    )


def _uniformity(
    rows: Sequence[TrainingRow], classifier: Classifier[Any, Any]
) -> dict[str, Uniformity]:
    if classifier.unevenness is None:
        return {}
    of_class: dict[str, list[float]] = {}
    for row in rows:
        of_class.setdefault(row.label, []).append(classifier.unevenness(row.observation))
    return {label: uniformity_of(values) for label, values in of_class.items()}


def common_lighting(lightings: Sequence[Lighting | None]) -> Lighting | None:
    """The lighting of all to within a degree; None if they differ or one is unknown."""
    first = lightings[0]
    if first is None:
        return None
    all_same = all(other is not None and first.within(SAME_LIGHT_DEG, other) for other in lightings)
    return first if all_same else None


def _aligned(
    references: FloatMap, first: FloatMap, classifier: Classifier[Any, Any], parameters: Parameters
) -> tuple[FloatMap, float]:
    """References of a set, and its orientation in degrees from the first set."""
    comparison = classifier.compare(references[0], first[None], parameters)
    if comparison.orientations_deg is None:
        return references, 0.0
    scores = comparison.heading_scores
    score = 0.0 if scores is None else float(scores[0])
    if abs(score) < MIN_SCORE:
        # Its orientation may be off by 180 degrees: it must not give headings.
        references = classifier.without_heading(references)
    return references, float(comparison.orientations_deg[0]) + 180.0 * (score < 0.0)
