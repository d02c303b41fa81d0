"""The classifier of Varma and Zisserman: textons of the images of a set.

"A statistical approach to texture classification from single images", International Journal of
Computer Vision 62, 2005. The MR8 filter bank of section 3 has 38 filters with 8 responses, maxima
over orientations. They do not change when the image is rotated; when the surface is rotated under
fixed lights, the image itself changes. Textons are cluster centres of the responses of each class;
those of all classes are the dictionary. An image is the histogram of the nearest textons of its
pixels. The class is that of the nearest training histogram by chi-squared.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import scipy

from classify.base.arrays import FloatMap
from classify.base.errors import InputError
from classify.surface.estimate import SurfaceEstimate

from . import Classifier, Comparison, Observation, Parameters, Shape
from .thesis import first_light, images_of

FILTER_PX = 49
"""Side of the filters."""

_RESPONSES = 8
"""Edges at three scales, bars at three scales, Gaussian, Laplacian of Gaussian."""

_MIN_IMAGE_PX = 64
"""Shortest side of an image: 16 x 16 pixels then have a whole filter around them."""

# The filters of MR8, and the contrast of Weber's law in the normalisation of responses.
_SCALES_PX = (1.0, 2.0, 4.0)
_ELONGATION = 3.0
_ORIENTATIONS = 6
_ISOTROPIC_PX = 10.0
_WEBER = np.float32(0.03)
_MARGIN = FILTER_PX // 2
# Transforms of larger blocks do not fit into the caches.
_MAX_BLOCK_PX = 512


@lru_cache(maxsize=1)
def mr8_filters() -> FloatMap:
    """The filters, (38, 49, 49) float32, of mean 0 and L1 norm 1."""
    offsets = np.arange(FILTER_PX) - _MARGIN
    x, y = offsets[None, :], -offsets[:, None]
    edges, bars = [], []
    for sigma in _SCALES_PX:
        for angle in np.arange(_ORIENTATIONS) * (np.pi / _ORIENTATIONS):
            across = np.cos(angle) * x + np.sin(angle) * y
            along = np.cos(angle) * y - np.sin(angle) * x
            gaussian = np.exp(-0.5 * (across**2 + (along / _ELONGATION) ** 2) / sigma**2)
            edges.append(-across * gaussian)
            bars.append((across**2 - sigma**2) * gaussian)
    square = x**2 + y**2
    blob = np.exp(-0.5 * square / _ISOTROPIC_PX**2)
    filters = np.stack([*edges, *bars, blob, (square - 2.0 * _ISOTROPIC_PX**2) * blob])
    filters -= filters.mean(axis=(1, 2), keepdims=True)
    filters /= np.abs(filters).sum(axis=(1, 2), keepdims=True)
    filters = filters.astype(np.float32)
    filters.flags.writeable = False
    return filters


def mr8_responses(image: npt.NDArray[np.generic]) -> FloatMap:
    """(8, H - 48, W - 48) float32 MR8 responses to an (H, W) image."""
    # A response R is scaled to R log(1 + |R| / 0.03) / |R| (Weber's law).
    normal = _normalised(image)
    rows, columns = (side - 2 * _MARGIN for side in normal.shape)
    responses = np.empty((_RESPONSES, rows, columns), dtype=np.float32)
    for row in _blocks(normal.shape[0]):
        for column in _blocks(normal.shape[1]):
            valid = [slice(block.start, block.stop - 2 * _MARGIN) for block in (row, column)]
            responses[:, valid[0], valid[1]] = _block_responses(normal[row, column])
    magnitude = np.sqrt(np.einsum("ijk,ijk->jk", responses, responses))
    # log(1 + m / 0.03) / m tends to 1 / 0.03 where there is no response.
    safe = np.maximum(magnitude, np.float32(1e-12))
    responses *= np.log1p(safe / _WEBER) / safe
    return responses


def _normalised(image: npt.NDArray[np.generic]) -> FloatMap:
    if image.ndim != 2 or min(image.shape) < _MIN_IMAGE_PX:
        raise InputError(
            f"an image of shape {image.shape} for the filter bank; give (rows, columns) of at "
            f"least {_MIN_IMAGE_PX} each"
        )
    values = image.astype(np.float32)
    if not np.isfinite(values).all():
        raise InputError("the image for the filter bank contains NaN or infinity; replace them")
    mean, std = float(values.mean(dtype=np.float64)), float(values.std(dtype=np.float64))
    # Rounding gives a constant image of floats a standard deviation in the last bit.
    if std <= 1e-6 * abs(mean):
        raise InputError(
            f"the image for the filter bank is constant, {mean:g} throughout; "
            "check its light and its exposure"
        )
    values -= np.float32(mean)
    values *= np.float32(1.0 / std)
    return values


def _blocks(length: int) -> Iterator[slice]:
    """Equal slices of at most `_MAX_BLOCK_PX`; their valid parts cover the length."""
    valid = length - 2 * _MARGIN
    count = -(-valid // (_MAX_BLOCK_PX - 2 * _MARGIN))
    side = -(-valid // count) + 2 * _MARGIN
    for index in range(count):
        first = min(index * (side - 2 * _MARGIN), length - side)
        yield slice(first, first + side)


def _block_responses(block: FloatMap) -> FloatMap:
    """The 8 responses before Weber's law, (8, H - 48, W - 48)."""
    rows, columns = block.shape
    shape = scipy.fft.next_fast_len(rows), scipy.fft.next_fast_len(columns, real=True)
    spectrum = scipy.fft.rfft2(block, s=shape)
    valid_rows, valid_columns = (slice(_MARGIN, side - _MARGIN) for side in block.shape)

    def filtered(spectrum: npt.NDArray[np.complex64], bank: FloatMap) -> FloatMap:
        # Four times as fast as irfft2 of a stack.
        along_rows = scipy.fft.ifft(spectrum * bank, axis=1, overwrite_x=True)[:, valid_rows]
        images: FloatMap = scipy.fft.irfft(along_rows, shape[1], axis=2)
        return images[:, :, valid_columns]

    responses = np.empty((_RESPONSES, rows - 2 * _MARGIN, columns - 2 * _MARGIN), np.float32)
    edges, bars, isotropic = _transfer_functions(*shape)
    for index, (edge, bar) in enumerate(zip(edges, bars, strict=True)):
        np.abs(filtered(1j * spectrum, edge)).max(axis=0, out=responses[index])
        np.abs(filtered(spectrum, bar)).max(axis=0, out=responses[len(edges) + index])
    responses[-len(isotropic) :] = filtered(spectrum, isotropic)
    return responses


@lru_cache(maxsize=4)
def _transfer_functions(rows: int, columns: int) -> tuple[FloatMap, FloatMap, FloatMap]:
    """Transfer functions of edges, of bars (3, 6, ...), and of the isotropic filters (2, ...)."""
    padded = np.zeros((len(mr8_filters()), rows, columns), np.float32)
    padded[:, :FILTER_PX, :FILTER_PX] = mr8_filters()
    centred = np.roll(padded, (-_MARGIN, -_MARGIN), axis=(1, 2))
    transforms = np.stack([scipy.fft.rfft2(image) for image in centred])
    oriented = (len(_SCALES_PX), _ORIENTATIONS, rows, columns // 2 + 1)
    count = len(_SCALES_PX) * _ORIENTATIONS
    edges = np.ascontiguousarray(transforms[:count].imag).reshape(oriented)
    bars = np.ascontiguousarray(transforms[count : 2 * count].real).reshape(oriented)
    return edges, bars, np.ascontiguousarray(transforms[2 * count :].real)


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
    pixels_per_image = -(-_SAMPLES // len(responses))
    samples = []
    for response in responses:
        pixels = _pixels(response)
        if len(pixels) > pixels_per_image:
            pixels = pixels[rng.choice(len(pixels), pixels_per_image, replace=False)]
        samples.append(pixels)
    points = np.concatenate(samples)
    if len(np.unique(points[:_SAMPLES], axis=0)) < count:
        raise InputError(
            f"the images of a class have fewer than {count} different filter responses; "
            "use larger images"
        )
    centres, _ = scipy.cluster.vq.kmeans2(points, count, iter=_ITERATIONS, minit="++", seed=rng)
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
    return np.ascontiguousarray(responses.reshape(_RESPONSES, -1).T, dtype=np.float32)


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
    return {"textons": (-1, _RESPONSES)}


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
