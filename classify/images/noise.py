"""Noise of a set of images, from its sensor or from the images alone."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from classify.base.arrays import Array, BoolArray, FloatMap, Indices
from classify.base.errors import InputError
from classify.images.stack import sample_pixels
from classify.lighting import Lighting
from classify.shadow_rule import MAYBE_SHADOW

from .stack import ImageStack

_MAX_SAMPLES = 16_384
_GROUPS = 4
# Fewer samples do not determine their variance.
_GROUP_SAMPLES = 256
# One pixel in this many counts as level. In the flattest tenth of a rock slopes reach 0.3, and
# highlights no longer cancel (test_gloss_is_not_taken_for_noise).
_FLATTEST = 32
# At this distance demosaicing and image compression do not correlate the noise.
_APART_PX = 2
# Standard normal deviates: of the tenth with the smallest residuals, and 3 sigma of chi-squared
# with one degree of freedom (9.0 in `chi_squared`), beyond which a residual is not noise.
_TENTH, BEYOND_NOISE = -1.2816, 2.76
# Squares of larger values, and their products with gains, are out of reach of float32.
_LARGEST = 1e9

ROUNDING_VARIANCE = 1.0 / 12.0
"""Variance of the error of rounding to whole numbers."""
SIGMA_PER_MAD = 1.4826
"""Standard deviation of normal noise over its median absolute deviation."""


@dataclass(frozen=True)
class SensorNoise:
    """Shot and read noise of a camera, in the pixel values of the images.

    The variance of a value v is read_noise_dn^2 + (v - black_level_dn) / gain_e_per_dn + 1/12,
    the last from rounding (EMVA 1288, linear camera model).

    Attributes
    ----------
    gain_e_per_dn
        Electrons per step of pixel value.
    read_noise_dn
        rms noise of a pixel without light, in pixel values.
    black_level_dn
        Pixel value without light.

    Raises
    ------
    InputError
        For a gain below 1e-9, a read noise below 0 or beyond 1e9, a black level beyond 1e9, or
        NaN.
    """

    gain_e_per_dn: float
    read_noise_dn: float
    black_level_dn: float = 0.0

    def __post_init__(self) -> None:
        gain, read_noise, black = self.gain_e_per_dn, self.read_noise_dn, self.black_level_dn
        if not (1.0 / _LARGEST <= gain < math.inf and 0.0 <= read_noise <= _LARGEST):
            raise InputError(
                f"sensor noise of {gain:g} e per DN and {read_noise:g} DN read noise; give a gain "
                f"of {1.0 / _LARGEST:g} or more and a read noise of 0 to {_LARGEST:g}"
            )
        if not abs(black) <= _LARGEST:
            raise InputError(f"sensor noise with a black level of {black:g} DN; give a pixel value")

    def coefficients(self) -> FloatMap:
        """(3,) a, b and black of the variance a + b (v - black)."""
        a = self.read_noise_dn**2 + ROUNDING_VARIANCE
        return np.array([a, 1.0 / self.gain_e_per_dn, self.black_level_dn], dtype=np.float32)


def noise_of_sensor(sensor: SensorNoise, ambient: Array | None, gains: FloatMap) -> float:
    """Standard deviation of a pixel without light, in units of images times gains."""
    frames = 1.0 if ambient is None else 2.0
    variance = float(sensor.coefficients()[0]) * frames
    return math.sqrt(variance * float(np.mean(np.square(gains, dtype=np.float64))))


def noise_of_images(stack: ImageStack, gains: FloatMap, lighting: Lighting) -> float:
    """Standard deviation of a pixel, in units of images times gains.

    N lights leave N - 3 combinations in which a Lambertian surface cancels out; shadow, gloss and
    unequal LEDs only increase their residual, so the smallest of several estimates, for groups of
    pixels of similar brightness, is taken. Of three lights only the rounding is known.
    """
    rounding = 0.0
    if stack.images.dtype.kind != "f":
        rounding = float(gains.max()) * math.sqrt(ROUNDING_VARIANCE)
    freedom = len(lighting) - 3
    if freedom < 1:
        return rounding
    # The left null space of L, as orthonormal rows.
    cancelling = np.linalg.svd(lighting.directions.T)[2][3:].astype(np.float32)
    shape = stack.shape

    def sampled(pixels: Indices) -> tuple[FloatMap, BoolArray]:
        values = stack.values_at(pixels)
        values *= gains[:, None]
        return values, values.min(axis=0) > MAYBE_SHADOW * values.max(axis=0)

    def least_variance(energies: FloatMap, brightness: FloatMap, in_light: BoolArray) -> float:
        if np.count_nonzero(in_light) >= _GROUP_SAMPLES:
            energies, brightness = energies[in_light], brightness[in_light]
        groups = min(_GROUPS, max(1, energies.size // _GROUP_SAMPLES))
        # Equal brightness is one group, whatever the order of the pixels.
        ends = energies.size * np.arange(1, groups + 1) // groups - 1
        edges = [-math.inf, *np.sort(brightness)[ends].tolist()]
        members = [(low < brightness) & (brightness <= high) for low, high in pairwise(edges)]
        sizes = [int(np.count_nonzero(group)) for group in members]
        return min(
            _variance(energies.compress(group), freedom, rounding**2)
            for group, size in zip(members, sizes, strict=True)
            if size >= max(max(sizes) // 2, 1)
        )

    values, in_light = sampled(sample_pixels(shape, _MAX_SAMPLES))
    energies = np.square(cancelling @ values).sum(axis=0)
    variance = least_variance(energies, values.sum(axis=0), in_light)
    flattest = _flattest(values[:, in_light], lighting)
    if flattest is not None:
        variance = min(variance, _variance(energies[in_light][flattest], freedom, rounding**2))
    # Pairs of pixels on both sides of a sample, in its row and in its column.
    middles = sample_pixels(shape, _MAX_SAMPLES // 2, _APART_PX // 2)
    offsets = np.repeat(np.array([1, shape[1]]) * (_APART_PX // 2), middles.size)
    middles = np.tile(middles, 2)
    values, in_light = sampled(middles - offsets)
    others, others_in_light = sampled(middles + offsets)
    if middles.size >= _GROUP_SAMPLES:
        energies = 0.5 * np.square(cancelling @ (values - others)).sum(axis=0)
        brightness = (values + others).sum(axis=0)
        variance = min(variance, least_variance(energies, brightness, in_light & others_in_light))
    return math.sqrt(variance)


def _flattest(values: FloatMap, lighting: Lighting) -> BoolArray | None:
    """Which of the pixels (N, n) have the smallest slopes; None if there are too few pixels."""
    count = max(values.shape[1] // _FLATTEST, _GROUP_SAMPLES)
    if values.shape[1] <= count:
        return None
    x, y, z = np.linalg.pinv(lighting.directions).astype(np.float32) @ values
    squares = (np.square(x) + np.square(y)) / np.square(z)
    return np.asarray(squares <= np.partition(squares, count)[count])


def _variance(energies: FloatMap, freedom: int, least: float) -> float:
    """Variance of the Gaussian part of `energies`, each the sum of `freedom` squares."""
    ordered = np.sort(energies)
    sums = np.cumsum(ordered, dtype=np.float64)
    variance = max(least, float(ordered[len(ordered) // 10]) / chi_squared(freedom, _TENTH))
    for _ in range(30):
        within = int(
            np.searchsorted(ordered, chi_squared(freedom, BEYOND_NOISE) * variance, "right")
        )
        if within == 0:
            break
        before, variance = variance, max(least, float(sums[within - 1]) / within / freedom)
        if variance == before:
            break
    return variance


def chi_squared(freedom: int, deviate: float) -> float:
    """Chi-squared at a standard normal deviate (Wilson and Hilferty, 1931)."""
    spread = 2.0 / (9.0 * freedom)
    return freedom * (1.0 - spread + deviate * math.sqrt(spread)) ** 3
