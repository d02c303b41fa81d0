"""The classifier of Varma and Zisserman on one image of a set, as a library's classifier."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from classify.surface.estimate import FloatMap, SurfaceEstimate
from classify.texture.filter_bank import mr8_responses
from classify.texture.textons import chi_squared, learn_textons, texton_histogram

from .classifier import Classifier, Comparison, Observation, Parameters
from .profiles import first_light

__all__ = ["VARMA_ZISSERMAN"]


def _observe(surface: SurfaceEstimate, _segment_px: int) -> Observation:
    index = first_light(surface)
    assert surface.images is not None
    return {"responses": mr8_responses(surface.images[index])[None]}


def _observe_training(surface: SurfaceEstimate, _segment_px: int) -> Observation:
    """Every image of a training set is a training image."""
    first_light(surface)
    assert surface.images is not None
    return {"responses": np.stack([mr8_responses(image) for image in surface.images])}


def _learn(observations: Sequence[Observation], labels: Sequence[str]) -> Parameters:
    by_class: dict[str, list[FloatMap]] = {}
    for label, observation in zip(labels, observations, strict=True):
        by_class.setdefault(label, []).extend(observation["responses"])
    textons = np.concatenate([learn_textons(responses) for responses in by_class.values()])
    return {"textons": textons.astype(np.float64)}


def _histograms(observation: Observation, parameters: Parameters) -> FloatMap:
    textons = parameters["textons"].astype(np.float32)
    return np.stack([texton_histogram(each, textons) for each in observation["responses"]])


def _histogram(observation: Observation, parameters: Parameters) -> FloatMap:
    histogram: FloatMap = _histograms(observation, parameters)[0]
    return histogram


def _compare(test: FloatMap, references: FloatMap, _: Parameters) -> Comparison:
    return Comparison(chi_squared(test, references).astype(np.float64))


VARMA_ZISSERMAN = Classifier(
    name="varma_zisserman",
    observe=_observe,
    observe_training=_observe_training,
    learn=_learn,
    signature=_histogram,
    references=_histograms,
    compare=_compare,
    from_images=True,
)
