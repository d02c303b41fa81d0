"""Tests of photographs by their shading: does it fit the lights, is it one scene, without shifts.

A capture is compared to a percent (`agreement`, `order`). Gloss, cast shadows, near lights and
errors of measured directions exceed that in photographs, so only their detail is compared. Divided
by its mean over the surroundings, image k of a matt surface has the contrast

    u_k = a - (1 + a) (p tx_k + q ty_k),    (tx, ty) = (lx, ly) / lz,

with the local contrast a of the albedo and slopes p, q relative to the surroundings. Fall-off and
vignetting cancel, and so do the intensities of the lights. Minus its mean over all lights, u has
two dimensions, those of p and q; the rest is the residual. And p, q are the slopes of a surface:
their curl is small against their divergence. Both hold for the true lights only.

A shift is tested without a division by the surroundings. On a matt surface the other images predict
image k. If it is shifted by d, it differs from their prediction by d . grad(i_k), besides a factor
of its light.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from classify.base.arrays import Array, BoolArray, FloatMap, Floats
from classify.images import SIGMA_PER_MAD
from classify.lighting import Lighting
from classify.shadow_rule import MAYBE_SHADOW

_Order = tuple[int, ...]
_Axes = Literal["y pointing down", "x and y exchanged", "a rotation by 90 degrees"]

# Errors of the axes of all lights; a rotation by 180 degrees fits as well as none.
_WRONG_AXES: dict[_Axes, Floats] = {
    "y pointing down": np.array([[1.0, 0.0], [0.0, -1.0]]),
    "x and y exchanged": np.array([[0.0, 1.0], [1.0, 0.0]]),
    "a rotation by 90 degrees": np.array([[0.0, 1.0], [-1.0, 0.0]]),
}

# tests/evidence/photograph_rates.py measures the rates of wrong and of missed refutations that the
# constants of this file give.

# Larger images are reduced so that their shorter side has at most twice this, to save time.
_SIDE_PX = 512
# Standard deviation of the surroundings, in shares of the shorter side. The rates differ little
# from half to twice this.
_SURROUNDINGS = 0.06
# Contrasts are compared at full, half, quarter ... resolution, at least at this many pixels.
_COARSEST_PX = 64
_MIN_SAMPLES = 2000
# Pixels darker than this share of the mean are mostly noise.
_MAYBE_NOISE = 0.1
# Contrasts beyond this many standard deviations are gloss and edges of shadows; they are clipped.
_OUTLIER = 3.0
# An order refutes the given one if its residual is this many times smaller than that of the given
# order and than that of chance. With the true order, 63 choices of four lights from photographs of
# four objects reach 1.9.
_CLEARLY_LESS = 2.0
# It also refutes it if its curl is this many times smaller. With the true order the same choices
# reach 1.12.
_CLEARLY_LESS_CURL = 1.25
# Largest curl of an order that refutes another; that of chance is 1. Random choices of 4 to 16
# lights of the gilded icon reach 0.74 to 1.1, those of a statue 0.3 to 0.7.
_LITTLE_CURL = 0.7
# An order that refutes the given one by residual or curl may have the other larger by this factor.
_MAX_OTHER_RATIO = 1.1
# Two lights of five or more count as exchanged if their exchange makes the residual of their images
# `_MIN_EXCHANGE_GAIN` times smaller, to at most `_MAX_EXCHANGED_RESIDUAL` of their contrast. With
# the true order, the photographs `icon_rti72` reach 1.26 and 0.77.
_MIN_EXCHANGE_GAIN, _MAX_EXCHANGED_RESIDUAL = 1.5, 0.6
# Number of lights with the largest residuals whose pairs are tried: all pairs would be N^2 / 2.
_SUSPECTS = 16
# An image has detail if its rms contrast is at least `_MIN_DETAIL` (less is noise of the
# compression), and its variance at least `_ABOVE_NOISE` times that of white noise.
_MIN_DETAIL, _ABOVE_NOISE = 0.02, 4.0
# Lights within 0.5 degrees have one direction. Their images are unlike if they differ by more than
# this share of the median difference of two images. Lights that are 2 to 5 degrees apart reach 0.09
# on the cat and 0.6 on the gilded icon; 40 to 70 degrees apart the median is 0.5 to 2.5.
_SAME_LIGHT, _UNLIKE = math.cos(math.radians(0.5)), 0.5
# From the second difference along rows and columns (Immerkaer, 1996) to the noise of a pixel.
_NOISE_KERNEL = np.outer((1.0, -2.0, 1.0), (1.0, -2.0, 1.0)) / 6.0
# Standard deviation of the Gaussian before the gradient of a shifted image, and width of the border
# that is not compared.
_SHIFT_BLUR_PX, _SHIFT_BORDER_PX = 2.0, 7
# A shift explains at least this share of the misfit, and is at least this long in reduced images.
# One of 1331 choices of four to eight photographs in tests/data reaches both, and three in four do
# if one photograph is shifted by 3 px (test_shading.py).
_MIN_EXPLAINED, _MIN_SHIFT_PX = 0.6, 1.5
# An image is predicted if the others contain at least this share of it.
_MIN_REDUNDANCY = 0.03


@dataclass(frozen=True, eq=False)
class _Shading:
    """Second moments of the contrasts of N images, at each scale from fine to coarse."""

    contrasts: tuple[Floats, ...]  # (N, N), at pixels lit by all
    noise_variances: tuple[Floats, ...]  # (N,) upper bounds of white noise
    shadings: tuple[Floats, ...]  # (N, N) of the shading: contrasts less their mean over the lights
    steps: tuple[Floats, ...]  # (2N, 2N) of differences of shading to the next pixel, right then up


@dataclass(frozen=True)
class ShadingOrder:
    """Whether the shading fits the order of the lights."""

    verdict: Literal["confirmed", "undecided", "refuted"]
    better: _Order | _Axes | None = None  # order or axes that fit, if refuted


def shading_of(
    images: Array,
    ambient: Array | None = None,
    full_scale: float = np.inf,
    mask: BoolArray | None = None,
) -> _Shading:
    """Compute the `_Shading` of images (N, H, W) that are linear in light."""
    u, usable, lit = _contrasts(images, ambient, full_scale, mask)
    contrasts, variances, shadings, steps = [], [], [], []
    variance = np.array([_noise_variance(plane, usable) for plane in u])
    while True:
        if np.count_nonzero(lit) >= _MIN_SAMPLES:
            contrasts.append(_moments(u[:, lit]))
            variances.append(variance)
            relief = u - u.mean(axis=0)
            shadings.append(_moments(relief[:, lit]))
            steps.append(_moments(_steps(relief, lit)))
        if min(usable.shape) < 2 * _COARSEST_PX:
            return _Shading(tuple(contrasts), tuple(variances), tuple(shadings), tuple(steps))
        variance = variance / 4.0  # of the mean of four pixels
        u, usable, lit = _halved(u, usable, lit)


def explained_detail(shading: _Shading) -> Floats:
    """(N,) squared multiple correlation of each image with the others; 1 without detail."""
    explained = []
    for moments, variance in zip(shading.contrasts, shading.noise_variances, strict=True):
        own = np.diag(moments)
        inverse = np.linalg.inv(moments + np.eye(len(own)) * (1e-6 * own.max() + 1e-12))
        shares = 1.0 - 1.0 / np.maximum(own * np.diag(inverse), 1.0)
        is_detail = own > np.maximum(_MIN_DETAIL**2, _ABOVE_NOISE * variance)
        explained.append(np.where(is_detail, shares, np.nan))
    if not explained:
        return np.ones(0)
    return np.asarray(np.nan_to_num(np.fmax.reduce(explained), nan=1.0))


def unlike_images_of_one_light(shading: _Shading, lighting: Lighting) -> list[tuple[int, int]]:
    """Pairs of images that have one light direction, and differ in their shading."""
    pairs = list(itertools.combinations(range(len(lighting)), 2))
    cosines = lighting.directions @ lighting.directions.T
    is_unlike = np.array([cosines[pair] > _SAME_LIGHT for pair in pairs])
    for moments, variance in zip(shading.contrasts, shading.noise_variances, strict=True):
        own = np.diag(moments)
        differences = np.array([own[i] + own[j] - 2.0 * moments[i, j] for i, j in pairs])
        noise = np.array([variance[i] + variance[j] for i, j in pairs])
        limit = max(_MIN_DETAIL**2, _UNLIKE * float(np.median(differences)))
        is_unlike &= differences - noise > limit
    return [pair for pair, unlike in zip(pairs, is_unlike, strict=True) if unlike]


def shading_order(shading: _Shading, lighting: Lighting) -> ShadingOrder:
    """Compare the given order of the lights with others, by residual and curl."""
    count = len(lighting)
    if not shading.shadings or count < 3:
        return ShadingOrder("undecided")
    tangents = lighting.directions[:, :2] / lighting.directions[:, 2:]
    # Residual of unrelated images: N - 3 of the N - 1 dimensions of their shading.
    chance = np.sqrt((count - 3.0) / (count - 1.0))
    orders = [*_candidates(count)]
    residual, curl = _misfits(shading, tangents, orders)
    is_acceptable = residual <= _MAX_OTHER_RATIO * residual[0]
    is_acceptable &= curl <= min(_LITTLE_CURL, _MAX_OTHER_RATIO * curl[0])
    explains = residual < chance / _CLEARLY_LESS
    better = explains & (residual < residual[0] / _CLEARLY_LESS)
    better |= curl < curl[0] / _CLEARLY_LESS_CURL
    better &= is_acceptable
    if better.any():
        best = orders[int(np.where(better, residual * curl, np.inf).argmin())]
        return ShadingOrder("refuted", best)
    exchanged = _exchanged(shading, tangents)
    if exchanged is not None and _misfits(shading, tangents, [exchanged])[1, 0] < _LITTLE_CURL:
        return ShadingOrder("refuted", exchanged)
    fits = (explains[0] or count == 3) and curl[0] < _LITTLE_CURL
    return ShadingOrder("confirmed" if fits else "undecided")


def _contrasts(
    images: Array,
    ambient: Array | None,
    full_scale: float,
    mask: BoolArray | None,
) -> tuple[FloatMap, BoolArray, BoolArray]:
    """(N, h, w) contrasts; (h, w) usable pixels, and those lit by all lights."""
    values = np.stack([_reduced(image) for image in images])
    if ambient is not None:
        values -= _reduced(ambient)
    values /= np.maximum(values.mean(axis=(1, 2), keepdims=True), np.float32(1e-6))
    typical = np.median(values, axis=0)
    usable = typical > _MAYBE_NOISE * typical.mean()
    usable &= _reduced(_excluded(images, full_scale, mask)) == 0.0
    lit = usable & (values.min(axis=0) > MAYBE_SHADOW * values.max(axis=0))
    inside = usable.astype(np.float32)
    sigma = _SURROUNDINGS * min(usable.shape)
    # Pixels that are not usable, and the border, have no weight in the mean.
    weight = np.maximum(_blurred(inside, sigma), np.float32(1e-6))
    for value in values:
        surroundings = _blurred(value * inside, sigma) / weight
        value /= np.maximum(surroundings, np.float32(1e-6))
    return np.where(usable, values - 1.0, 0.0).astype(np.float32), usable, lit


def _reduction(shape: tuple[int, ...]) -> int:
    """Number of pixels along the side of a block that is averaged to one pixel."""
    return max(1, min(shape) // _SIDE_PX)


def _reduced(image: Array) -> FloatMap:
    """(h, w) means of an image over square blocks."""
    step = _reduction(image.shape)
    rows, columns = (max(1, side // step) for side in image.shape)
    plane = np.asarray(image, np.float32)
    return np.asarray(cv2.resize(plane, (columns, rows), interpolation=cv2.INTER_AREA), np.float32)


def _excluded(images: Array, full_scale: float, mask: BoolArray | None) -> BoolArray:
    """(H, W) pixels that are saturated in an image, or outside the mask."""
    is_saturated = np.asarray(images.max(axis=0) >= full_scale)
    return is_saturated if mask is None else is_saturated | ~mask


def _blurred(image: FloatMap, sigma: float) -> FloatMap:
    blurred = cv2.GaussianBlur(image, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(blurred, np.float32)


def _halved(
    u: FloatMap, usable: BoolArray, lit: BoolArray
) -> tuple[FloatMap, BoolArray, BoolArray]:
    rows, columns = (side // 2 * 2 for side in usable.shape)

    def sums(planes: Array) -> FloatMap:
        whole_pairs = planes[..., :rows, :columns].astype(np.float32)
        across = whole_pairs[..., ::2] + whole_pairs[..., 1::2]
        return np.asarray(across[..., ::2, :] + across[..., 1::2, :], np.float32)

    counts = sums(usable)
    means = sums(u * usable) / np.maximum(counts, 1.0)
    return means.astype(np.float32), counts >= 2.0, sums(lit) == 4.0


def _steps(relief: FloatMap, lit: BoolArray) -> FloatMap:
    """(2N, n) differences to the right, then upwards, at pixels with lit neighbours."""
    inner = lit[1:-1, 1:-1] & lit[:-2, 1:-1] & lit[2:, 1:-1] & lit[1:-1, :-2] & lit[1:-1, 2:]
    right = (relief[:, 1:-1, 2:] - relief[:, 1:-1, :-2])[:, inner]
    upwards = (relief[:, :-2, 1:-1] - relief[:, 2:, 1:-1])[:, inner]
    return np.concatenate([right, upwards])


def _noise_variance(plane: FloatMap, usable: BoolArray) -> float:
    differences = cv2.filter2D(plane, -1, _NOISE_KERNEL)[usable]
    if differences.size == 0:
        return 0.0
    return float((SIGMA_PER_MAD * np.median(np.abs(differences))) ** 2)


def _moments(values: FloatMap) -> Floats:
    """Second moments of (M, n) values about their means, with outliers clipped."""
    if values.shape[1] == 0:
        return np.eye(len(values))
    limit = _OUTLIER * SIGMA_PER_MAD * np.median(np.abs(values), axis=1, keepdims=True)
    # A median of 0 gives no limit: more than half of the values are equal.
    bounded = np.where(limit > 0.0, np.clip(values, -limit, limit), values)
    bounded = (bounded - bounded.mean(axis=1, keepdims=True)).astype(np.float64)
    return np.asarray(bounded @ bounded.T / values.shape[1], np.float64)


def _misfit(moments: Floats, steps: Floats, tangents: Floats) -> tuple[float, float]:
    """Residual as a share of the shading, and curl over divergence."""
    centred = tangents - tangents.mean(axis=0)
    inverse = np.linalg.pinv(centred)
    residual_projection = np.eye(len(tangents)) - centred @ inverse
    to_p, to_q = -inverse
    curl, divergence = np.concatenate([-to_q, to_p]), np.concatenate([to_p, to_q])
    shaded = float(np.trace(moments))
    if shaded < 1e-12:  # images without any contrast fit all orders equally
        return 1.0, 1.0
    # The sum is the trace of the product, because the projection is symmetric.
    residual = float((residual_projection * moments).sum()) / shaded
    ratio = float(curl @ steps @ curl) / max(float(divergence @ steps @ divergence), 1e-12)
    return math.sqrt(max(residual, 1e-12)), math.sqrt(max(ratio, 1e-12))


def _misfits(shading: _Shading, tangents: Floats, orders: Sequence[_Order | _Axes]) -> Floats:
    """(2, orders) residual and curl, at the scale of the smallest residual."""
    misfits = np.array([
        [_misfit(*moments, _changed(tangents, order)) for order in orders]
        for moments in zip(shading.shadings, shading.steps, strict=True)
    ])  # fmt: skip
    return np.asarray(misfits[misfits[:, :, 0].min(axis=1).argmin()].T)


def _candidates(count: int) -> Iterator[_Order | _Axes]:
    """Orders and axes to compare, the given order first."""
    if count <= 4:
        yield from itertools.permutations(range(count))
    else:
        for shift in range(count):
            yield tuple(np.roll(range(count), shift).tolist())
        yield tuple(range(count))[::-1]
    yield from _WRONG_AXES


def _changed(tangents: Floats, change: _Order | _Axes) -> Floats:
    """Tangents (N, 2) of the lights in another order or in other axes."""
    if isinstance(change, str):
        return np.asarray(tangents @ _WRONG_AXES[change])
    return tangents[list(change)]


def _exchanged(shading: _Shading, tangents: Floats) -> _Order | None:
    """The order with two lights exchanged, if that explains the images much better."""
    count = len(tangents)
    if count < 5:
        return None
    centred = tangents - tangents.mean(axis=0)
    inverse = np.linalg.pinv(centred)
    light_residuals = [_light_residuals(moments, centred, inverse) for moments in shading.shadings]
    shares = sum(
        values / np.diag(moments)
        for moments, values in zip(shading.shadings, light_residuals, strict=True)
    )
    suspects = sorted(np.argsort(shares)[-_SUSPECTS:].tolist())
    best: tuple[float, _Order | None] = (_MIN_EXCHANGE_GAIN, None)
    for pair in itertools.combinations(suspects, 2):
        order = list(range(count))
        order[pair[0]], order[pair[1]] = pair[1], pair[0]
        logs = []
        for moments, before in zip(shading.shadings, light_residuals, strict=True):
            after = _light_residuals(moments, centred[order], inverse[:, order])
            sums = [values[list(pair)].sum() for values in (before, after, np.diag(moments))]
            logs.append(0.5 * np.log(np.maximum(sums, 1e-12)))
        before_log, after_log, own_log = np.mean(logs, axis=0)
        if np.exp(after_log - own_log) < _MAX_EXCHANGED_RESIDUAL:
            best = max(best, (float(np.exp(before_log - after_log)), tuple(order)))
    return best[1]


def _light_residuals(moments: Floats, tangents: Floats, inverse: Floats) -> Floats:
    """(N,) mean square residual of each image."""
    mixed = inverse @ moments
    fitted = ((tangents @ (mixed @ inverse.T)) * tangents).sum(axis=1)
    return np.asarray(np.diag(moments) - 2.0 * (tangents * mixed.T).sum(axis=1) + fitted)


def shift_of_one_image(
    images: Array,
    ambient: Array,
    lighting: Lighting,
    full_scale: float,
    mask: BoolArray | None = None,
) -> float | None:
    """Length in px of the shift of one of the images (N, H, W); None if no shift explains them."""

    def smoothed(image: Array) -> FloatMap:
        return np.asarray(cv2.GaussianBlur(_reduced(image), (0, 0), _SHIFT_BLUR_PX), np.float32)

    values = np.stack([smoothed(image) for image in images]) - smoothed(ambient)
    values /= lighting.intensities[:, None, None].astype(np.float32)
    usable = smoothed(_excluded(images, full_scale, mask)) == 0.0
    usable &= values.min(axis=0) > MAYBE_SHADOW * values.max(axis=0)
    inside = np.zeros_like(usable)
    border = slice(_SHIFT_BORDER_PX, -_SHIFT_BORDER_PX)
    inside[border, border] = True
    usable &= inside
    directions = lighting.directions
    # Projects the values of a pixel on their residuals from a matt surface.
    redundancy = np.eye(len(directions)) - directions @ np.linalg.pinv(directions)
    lit = values[:, usable]
    explained, shift_px = 0.0, 0.0
    for k, value in enumerate(values):
        if redundancy[k, k] < _MIN_REDUNDANCY:
            continue
        misfit = redundancy[k] @ lit / redundancy[k, k]
        slopes = (cv2.Sobel(value, cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1)))
        terms = np.stack([lit[k], *(slope[usable] for slope in slopes)]).astype(np.float64)
        moments, products = terms @ terms.T, terms @ misfit
        solution = np.linalg.pinv(moments, hermitian=True) @ products
        # The part that a factor of the light explains is no evidence of a shift.
        by_light = products[0] ** 2 / max(moments[0, 0], 1e-12)
        unexplained_by_light = max(float(misfit @ misfit) - by_light, 1e-12)
        share = float(products @ solution - by_light) / unexplained_by_light
        if share > explained:
            explained, shift_px = share, float(np.hypot(*solution[1:]))
    is_clear = explained > _MIN_EXPLAINED and shift_px > _MIN_SHIFT_PX
    return _reduction(images.shape[1:]) * shift_px if is_clear else None
