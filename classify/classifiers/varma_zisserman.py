"""The classifier of Varma and Zisserman (2005): textons of the images of a set."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from classify.base.arrays import FloatMap
from classify.surface.estimate import SurfaceEstimate
from classify.texture.filter_bank import RESPONSES, mr8_responses
from classify.texture.textons import chi_squared, learn_textons, texton_histogram

from .classifier import Classifier, Comparison, Observation, Parameters, Shape
from .thesis import first_light, images_of


@dataclass(frozen=True, eq=False)
class FilterResponses(Observation):
    """(images, 8, H, W) MR8 responses, to one image of a test or all of a training set."""

    responses: FloatMap


def _observe(surface: SurfaceEstimate, _segment_px: int) -> FilterResponses:
    image = images_of(surface)[first_light(surface)]
    return FilterResponses(mr8_responses(image)[None])


def _observe_training(surface: SurfaceEstimate, _segment_px: int) -> FilterResponses:
    return FilterResponses(np.stack([mr8_responses(image) for image in images_of(surface)]))


def _learn(observations: Sequence[FilterResponses], labels: Sequence[str]) -> Parameters:
    by_class: dict[str, list[FloatMap]] = {}
    for label, observation in zip(labels, observations, strict=True):
        by_class.setdefault(label, []).extend(observation.responses)
    textons = np.concatenate([learn_textons(responses) for responses in by_class.values()])
    return {"textons": textons.astype(np.float64)}


def _parameter_shapes(_segment_px: int) -> Mapping[str, Shape]:
    return {"textons": (-1, RESPONSES)}


def _histograms(observation: FilterResponses, parameters: Parameters) -> FloatMap:
    textons = parameters["textons"].astype(np.float32)
    return np.stack([texton_histogram(each, textons) for each in observation.responses])


def _histogram(observation: FilterResponses, parameters: Parameters) -> FloatMap:
    histogram: FloatMap = _histograms(observation, parameters)[0]
    return histogram


def _compare(test: FloatMap, references: FloatMap, _: Parameters) -> Comparison:
    return Comparison(chi_squared(test, references).astype(np.float64))


VARMA_ZISSERMAN = Classifier(
    name="varma_zisserman",
    observe=_observe,
    observe_training=_observe_training,
    signature=_histogram,
    references=_histograms,
    compare=_compare,
    learn=_learn,
    parameter_shapes=_parameter_shapes,
    from_images=True,
)
