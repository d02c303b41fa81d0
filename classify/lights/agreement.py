"""Whether pictures agree: four of a matt surface with one another, two of the same scene."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from classify.errors import InputError
from classify.images.noise import SensorNoise, noise_of_images
from classify.lighting import Lighting

from .algebra import drop_one_constants

__all__ = ["LightAgreement", "light_agreement", "like_signed", "picture_difference"]

FloatArray = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]

_MAX_COLUMNS = 256
# A light that gives less than this share of the brightest, each against its own mean, may be in
# shadow there.
_MAYBE_SHADOW = 0.2
_MIN_SAMPLES = 200
# By so many pixels strengths are known well enough; more take time.
_MAX_SAMPLES = 1 << 15
_MIN_SAMPLES_OF_A_ROW = 8
# Surfaces are matt to about this share of their brightness.
_MATT = 0.005
_ROUNDS = 4
_BEYOND = 3.0
# LEDs differ by so much, as far as nothing is known.
_SPREAD = 1.0
# Left-overs of so many times the noise are not explained by the strengths of the lights.
_EXPLAINED = 1.8
# Part of the variance of left-overs that is not noise of the images: the surface's.
_OTHER_NOISE = 0.05
# Strengths of parts of the frame are the same if they differ by no more than this and their errors.
_LIKE = 0.015
# Factors below this, or negative ones, are no strengths.
_WEAKEST = 0.05
# Of values between two pixel values, alike all over a picture, rounding makes more noise than of
# values anywhere: a variance of 1/4 instead of 1/12.
_ROUNDING = 1.0 / 4.0 - 1.0 / 12.0
# A band of rows counts when its mean square is above the noise by this and by so many standard
# errors.
_ABOVE_NOISE = 0.3
_STANDARD_ERRORS = 6.0


@dataclass(frozen=True)
class LightAgreement:
    """What four images say about their lights, if the surface is matt.

    Attributes
    ----------
    contradiction
        How much the images contradict one another beyond noise, with the `strengths` where they
        are known: the rms share of the brightness by which one of them would be wrong. 0 where
        noise explains all.
    strengths
        (4,) relative strengths of the lights, of median 1, that explain the images; None where
        no strengths do, or too few pixels are lit by all four.
    strength_error
        Standard error of the strength that is known least.
    seen
        Share of the rows in which enough pixels are lit by all four.
    """

    contradiction: float
    strengths: tuple[float, ...] | None
    strength_error: float
    seen: float


def like_signed(lighting: Lighting) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """The lights in two groups, those whose images add up in the comparison of all in one.

    Of a ring these are the opposite lights. Lights that are not four are halved as they come.
    """
    lights = range(len(lighting))
    try:
        null = drop_one_constants(lighting, "like_signed")[1]
    except InputError:
        half = (len(lighting) + 1) // 2
        return tuple(lights[:half]), tuple(lights[half:])
    like = tuple(light for light in lights if null[light] * null[0] > 0.0)
    return like, tuple(light for light in lights if light not in like)


def light_agreement(
    images: npt.NDArray[np.uint16],
    lighting: Lighting,
    ambient: npt.NDArray[np.uint16],
    full_scale: float,
    noise: SensorNoise | None,
) -> LightAgreement:
    """Compare the images of four lights with one another.

    With nul the left null vector of the light directions, sum_k nul_k i_k is zero at every pixel
    of a matt surface without shadow, whatever its slope and albedo; if light k has the strength
    g_k, sum_k nul_k i_k / g_k is. Rows and bands of rows in which the first is not zero tell
    frames that are torn, mixed, or of another light; the g that make the second zero over the
    whole frame tell lights that are weak. They are a total least squares solution, as the images
    that carry the strengths carry the noise as well.

    Parameters
    ----------
    images
        (4, H, W), in the order of the lighting.
    lighting
        Four lights in general position.
    ambient
        (H, W), subtracted.
    full_scale
        Pixel value of saturation.
    noise
        Of the images; None is estimated from them.

    Raises
    ------
    InputError
        For another number of lights, or three of them in one plane.
    """
    _, null = drop_one_constants(lighting, "light_agreement")
    step = max(1, -(-images.shape[2] // _MAX_COLUMNS))
    raw = images[:, :, ::step].astype(np.float32)
    values = raw - ambient[:, ::step].astype(np.float32)
    values /= lighting.intensities.astype(np.float32)[:, None, None]
    weights = null.astype(np.float32)[:, None, None]
    variance = _variance(raw, noise, images, ambient, lighting)
    means = np.maximum(values.mean(axis=(1, 2), keepdims=True), np.float32(1e-6))
    evened = values / means
    lit = evened.min(axis=0) > _MAYBE_SHADOW * evened.max(axis=0)
    lit &= raw.max(axis=0) < full_scale
    brightness = np.maximum(values.mean(axis=0), np.float32(1e-6))
    # Both as shares of the brightness: of one image that is wrong by a share, that share.
    scale = np.float32(1.0 / np.abs(null).mean()) / brightness
    noise_share = scale * np.sqrt((np.square(weights) * variance).sum(axis=0))
    spread = np.hypot(noise_share, np.float32(_MATT))
    terms = scale * weights * values
    noises = np.square(scale * weights / spread) * variance
    normed = terms / spread
    flat = (normed.reshape(4, -1), noises.reshape(4, -1))
    fits = [_fit(*(np.take(values, part, axis=1) for values in flat)) for part in _parts(lit)]
    whole = fits[0]
    if not all(fit is None or (whole is not None and fit.is_like(whole)) for fit in fits):
        whole = None
    seen = float((lit.sum(axis=1) >= _MIN_SAMPLES_OF_A_ROW).mean())
    if whole is None:
        return LightAgreement(_beyond_noise(terms.sum(axis=0), spread, lit), None, math.inf, seen)
    factors = (1.0 / whole.strengths).astype(np.float32)[:, None, None]
    noise_share = np.sqrt((np.square(factors * scale * weights) * variance).sum(axis=0))
    spread = np.hypot(noise_share, np.float32(_MATT))
    contradiction = _beyond_noise((factors * terms).sum(axis=0), spread, lit)
    strengths = tuple(float(strength) for strength in whole.strengths)
    return LightAgreement(contradiction, strengths, whole.error, seen)


def picture_difference(
    first: npt.NDArray[np.uint16],
    second: npt.NDArray[np.uint16],
    signal: float,
    noise: SensorNoise | None,
) -> float:
    """By what share of `signal`, rms over the frame, two pictures of one scene differ beyond noise.

    Parameters
    ----------
    first, second
        (H, W), linear in light.
    signal
        Pixel value above dark that counts as 1.
    noise
        Of both; None is estimated from how the difference of the two goes up and down from pixel to
        pixel, for pixels of like brightness.
    """
    step = max(1, -(-first.shape[1] // _MAX_COLUMNS))
    a, b = (image[:, ::step].astype(np.float32) for image in (first, second))
    if noise is None:
        variance = _variance_of_difference(a, b)
    else:
        offset, slope, black = (float(value) for value in noise.coefficients())
        variance = 2.0 * offset + slope * np.maximum(a + b - 2.0 * black, 0.0)
    everywhere = np.ones(a.shape, np.bool_)
    share = np.float32(1.0 / signal)
    return _beyond_noise(share * (a - b), share * np.sqrt(variance + 2.0 * _ROUNDING), everywhere)


def _variance_of_difference(a: FloatArray, b: FloatArray) -> FloatArray:
    """(H, W), from neighbours in a row; shot noise is another in the light than in the dark."""
    brightness = a + b
    steps = np.abs(np.diff(a - b, axis=1, append=(a - b)[:, -2:-1]))
    groups = np.searchsorted(np.quantile(brightness, (0.25, 0.5, 0.75)), brightness)
    variance = np.empty_like(a)
    for group in range(4):
        inside = groups == group
        typical = float(np.median(steps[inside])) if inside.any() else 0.0
        variance[inside] = max(1.0 / 6.0, (1.4826 * typical) ** 2 / 2.0)
    return variance


def _variance(
    raw: FloatArray,
    noise: SensorNoise | None,
    images: npt.NDArray[Any],
    ambient: npt.NDArray[Any],
    lighting: Lighting,
) -> FloatArray:
    gains = (1.0 / lighting.intensities).astype(np.float32)
    if noise is None:
        sigma = noise_of_images(images, ambient, gains, lighting)
        return np.full_like(raw, max(sigma**2, 1.0 / 12.0))
    offset, slope, black = noise.coefficients()
    variance: FloatArray = offset + slope * np.maximum(raw - black, np.float32(0.0))
    return variance * np.square(gains)[:, None, None]


def _beyond_noise(deviation: FloatArray, spread: FloatArray, counted: BoolArray) -> float:
    """Rms of what noise does not explain, from bands of rows of all heights, the worst of them."""
    rows = len(deviation)
    squares = np.where(counted, np.minimum(np.square(deviation / spread), _BEYOND**2), 0.0)
    worst = 0.0
    height = 1
    while True:
        starts = np.arange(0, rows, height)
        counts = np.add.reduceat(counted.sum(axis=1), starts)
        means = np.add.reduceat(squares.sum(axis=1), starts) / np.maximum(counts, 1)
        errors = _STANDARD_ERRORS * np.sqrt(2.0 / np.maximum(counts, 1))
        unlike = np.flatnonzero(
            (counts >= _MIN_SAMPLES_OF_A_ROW) & (means > 1.0 + _ABOVE_NOISE + errors)
        )
        total = 0.0
        for band in unlike:
            part = slice(int(starts[band]), int(starts[band]) + height)
            inside = counted[part]
            # The median, as a few glints are not a wrong light.
            size = 1.4826 * float(np.median(np.abs(deviation[part][inside])))
            noise = float(np.median(spread[part][inside]))
            total += max(0.0, size**2 - noise**2) * len(inside) / rows
        worst = max(worst, total)
        if height >= rows:
            return float(np.sqrt(worst))
        height *= 4


@dataclass(frozen=True)
class _Fit:
    """Strengths (4,) of median 1, the standard error of the worst of them."""

    strengths: npt.NDArray[np.float64]
    error: float

    def is_like(self, other: _Fit) -> bool:
        room = _LIKE + _STANDARD_ERRORS * math.hypot(self.error, other.error)
        return bool(np.abs(self.strengths - other.strengths).max() <= room)


def _parts(lit: BoolArray) -> Iterator[npt.NDArray[np.intp]]:
    """Lit pixels all over the frame, then in each half: strengths are the same everywhere, a near
    light is not.
    """
    rows, columns = (side // 2 for side in lit.shape)
    for part in np.s_[:, :], np.s_[:rows], np.s_[rows:], np.s_[:, :columns], np.s_[:, columns:]:
        inside = np.zeros_like(lit)
        inside[part] = lit[part]
        pixels = np.flatnonzero(inside)
        yield pixels[:: max(1, -(-len(pixels) // _MAX_SAMPLES))]


def _fit(terms: FloatArray, noises: FloatArray) -> _Fit | None:
    """Strengths that make the sum of `terms` (4, n) over them noise of variance 1, if any do.

    `noises` (4, n) is the part of each term's square that is noise.
    """
    if terms.shape[1] < _MIN_SAMPLES:
        return None
    exact, noise = terms.astype(np.float64), noises.astype(np.float64)
    # Weights 0 and 1, as to pick pixels out takes longer than to count those that disagree as 0.
    agree = np.ones(terms.shape[1])
    for _ in range(_ROUNDS):
        energy = (agree * exact) @ exact.T - np.diag(noise @ agree)
        values, vectors = np.linalg.eigh(energy + np.eye(4) / _SPREAD**2)
        inverse = (vectors / np.maximum(values, 1.0)) @ vectors.T
        towards = inverse.sum(axis=1)
        factors = towards * (4.0 / towards.sum())
        left_over = np.square(factors @ exact) / (np.square(factors) @ noise + _OTHER_NOISE)
        typical = 1.4826 * math.sqrt(_middle(left_over))
        agree = (left_over <= (_BEYOND * max(1.0, typical)) ** 2).astype(np.float64)
    covariance = inverse - np.outer(towards, towards) / towards.sum()
    error = math.sqrt(max(float(np.linalg.eigvalsh(covariance)[-1]), 0.0))
    if typical > _EXPLAINED or factors.min() < _WEAKEST:
        return None
    strengths = 1.0 / factors
    return _Fit(strengths / np.median(strengths), error)


def _middle(values: npt.NDArray[np.float64]) -> float:
    """The median; of an even number of values the upper one of the two, found in half the time."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])
