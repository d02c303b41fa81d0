"""The classifier of Varma and Zisserman: textons of the images of a set.

"A statistical approach to texture classification from single images", International Journal of
Computer Vision 62, 2005. Textons are cluster centres of the MR8 responses of each class; those of
all classes are the dictionary. An image is the histogram of the nearest textons of its pixels. The
class is that of the nearest training histogram by chi-squared.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.cluster.vq import kmeans2

from classify.base.arrays import FloatMap
from classify.base.errors import InputError
from classify.surface.estimate import SurfaceEstimate
from classify.texture.filter_bank import RESPONSES, mr8_responses

from .classifier import Classifier, Comparison, Observation, Parameters, Shape
from .thesis import first_light, images_of

TEXTONS_PER_CLASS = 10
"""As in the paper."""

# k-means on a sample of the pixels takes a second; test_varma_zisserman.py holds its accuracy.
_SAMPLES = 20_000
_ITERATIONS = 30
_SEED = 1
# Rows of the distance table, chosen so that they stay in the cache.
_CHUNK = 1024


def learn_textons(responses: Sequence[FloatMap]) -> FloatMap:
    """(10, 8) cluster centres by k-means++ of the (8, H, W) responses of one class, fixed seed."""
    count = TEXTONS_PER_CLASS
    rng = np.random.default_rng(_SEED)
    share = -(-_SAMPLES // len(responses))
    samples = []
    for response in responses:
        pixels = _pixels(response)
        if len(pixels) > share:
            pixels = pixels[rng.choice(len(pixels), share, replace=False)]
        samples.append(pixels)
    points = np.concatenate(samples)
    if len(np.unique(points[:_SAMPLES], axis=0)) < count:
        raise InputError(
            f"the images of a class have fewer than {count} different filter responses; "
            "use larger images"
        )
    centres, _ = kmeans2(points, count, iter=_ITERATIONS, minit="++", seed=rng)
    return np.ascontiguousarray(centres, dtype=np.float32)


def texton_histogram(responses: FloatMap, textons: FloatMap) -> FloatMap:
    """(T,) float32 shares of the pixels of (8, H, W) responses nearest to each texton."""
    pixels = _pixels(responses)
    # |x - t|^2 = |x|^2 - 2 (x . t - |t|^2 / 2), and |x|^2 is the same for all textons.
    directions = np.ascontiguousarray(textons.T, dtype=np.float32)
    half_square = 0.5 * np.einsum("kt,kt->t", directions, directions)
    counts = np.zeros(len(textons), dtype=np.int64)
    nearness = np.empty((_CHUNK, len(textons)), dtype=np.float32)
    for start in range(0, len(pixels), _CHUNK):
        chunk = pixels[start : start + _CHUNK]
        part = np.matmul(chunk, directions, out=nearness[: len(chunk)])
        part -= half_square
        counts += np.bincount(part.argmax(axis=1), minlength=len(textons))
    return (counts / len(pixels)).astype(np.float32)


def chi_squared(histogram: FloatMap, references: FloatMap) -> FloatMap:
    """(n,) distances 1/2 sum (a - b)^2 / (a + b) of (T,) and (n, T) histograms, 0 to 1."""
    total = references + histogram
    squares = np.square(references - histogram)
    distances = np.divide(squares, total, out=np.zeros_like(total), where=total > 0)
    return np.asarray(0.5 * distances.sum(axis=1), dtype=np.float32)


def _pixels(responses: FloatMap) -> FloatMap:
    """(H W, 8), one row per pixel."""
    return np.ascontiguousarray(responses.reshape(RESPONSES, -1).T, dtype=np.float32)


@dataclass(frozen=True, eq=False)
class _FilterResponses(Observation):
    """(images, 8, H, W) MR8 responses, to one image of a test or all of a training set."""

    responses: FloatMap


def _observe(surface: SurfaceEstimate, _segment_px: int) -> _FilterResponses:
    image = images_of(surface)[first_light(surface)]
    return _FilterResponses(mr8_responses(image)[None])


def _observe_training(surface: SurfaceEstimate, _segment_px: int) -> _FilterResponses:
    return _FilterResponses(np.stack([mr8_responses(image) for image in images_of(surface)]))


def _learn(observations: Sequence[_FilterResponses], labels: Sequence[str]) -> Parameters:
    by_class: dict[str, list[FloatMap]] = {}
    for label, observation in zip(labels, observations, strict=True):
        by_class.setdefault(label, []).extend(observation.responses)
    textons = np.concatenate([learn_textons(responses) for responses in by_class.values()])
    return {"textons": textons.astype(np.float64)}


def _parameter_shapes(_segment_px: int) -> Mapping[str, Shape]:
    return {"textons": (-1, RESPONSES)}


def _histograms(observation: _FilterResponses, parameters: Parameters) -> FloatMap:
    textons = parameters["textons"].astype(np.float32)
    return np.stack([texton_histogram(response, textons) for response in observation.responses])


def _histogram(observation: _FilterResponses, parameters: Parameters) -> FloatMap:
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
