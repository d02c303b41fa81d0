"""Images of a set with their ambient image, read strip by strip, and the noise in them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from classify.base.arrays import Array, BoolArray, FloatMap, Indices
from classify.base.errors import InputError
from classify.lighting import Lighting
from classify.shadow_rule import MAYBE_SHADOW

_DTYPES = (np.dtype(np.uint8), np.dtype(np.uint16), np.dtype(np.float32))

# Squares of larger values, times gains, are out of reach of float32.
_MAX_VALUE = 1e12

Images = Array | Sequence[Array]


@dataclass(frozen=True, eq=False)
class ImageStack:
    """The images of one frame, as kernels read them."""

    images: Array  # (N, H, W) contiguous uint8, uint16 or finite float32
    ambient: Array | None  # (H, W) of the same type, subtracted from each image

    @classmethod
    def checked(cls, images: Images, lights: int, ambient: Array | None = None) -> ImageStack:
        """Check images and ambient image, and make them contiguous."""
        stack = _checked_stack(images, lights)
        return cls(stack, None if ambient is None else _checked_ambient(ambient, stack))

    @property
    def shape(self) -> tuple[int, int]:
        rows, columns = self.images.shape[1:]
        return rows, columns

    @property
    def dark_rows(self) -> Array:
        """(H, W) ambient image, or (1, W) zeros: kernels are compiled for one form."""
        if self.ambient is None:
            return np.zeros((1, self.shape[1]), self.images.dtype)
        return self.ambient

    def raw_at(self, pixels: Indices) -> FloatMap:
        """(N, n) values of pixels with these flat indices."""
        return self.images.reshape(len(self.images), -1).take(pixels, 1).astype(np.float32)

    def dark_at(self, pixels: Indices) -> FloatMap:
        """(n,) values of the ambient image, or (1,) 0."""
        if self.ambient is None:
            return np.zeros(1, np.float32)
        return self.ambient.ravel().take(pixels).astype(np.float32)

    def values_at(self, pixels: Indices) -> FloatMap:
        """(N, n) values less ambient light of pixels with these flat indices."""
        return self.raw_at(pixels) - self.dark_at(pixels)

    def sample(self, max_count: int, gains: FloatMap) -> tuple[FloatMap, FloatMap]:
        """(N, n) values of `sample_pixels`, and the same less ambient light and times the gains."""
        pixels = sample_pixels(self.shape, max_count)
        raw = self.raw_at(pixels)
        return raw, (raw - self.dark_at(pixels)) * gains[:, None]

    def materialised(self) -> ImageStack:
        """Return the images as plain arrays; a `DividedStack`, which divides on access, divides."""
        return self

    def rows(self, first: int, last: int) -> ImageStack:
        """Some rows of the frame, as contiguous float32."""
        images, dark = self.float_rows(first, last)
        return ImageStack(images, None if self.ambient is None else dark)

    def float_rows(self, first: int, last: int) -> tuple[FloatMap, FloatMap]:
        """(N, last - first, W) images and `dark_rows`, as float32: kernels compile once."""
        dark = self.dark_rows if self.ambient is None else self.ambient[first:last]
        images = self.images[:, first:last].astype(np.float32, order="C")
        return images, dark.astype(np.float32)


def _checked_stack(images: Images, lights: int) -> Array:
    """(N, H, W) contiguous uint8, uint16 or finite float32, one image per light."""
    if not isinstance(images, np.ndarray):
        if len(images) == 0:
            raise InputError("no images are given; give one for each light")
        shapes = {np.shape(image) for image in images}
        if len(shapes) > 1:
            sizes = ", ".join(" x ".join(map(str, shape)) for shape in sorted(shapes))
            raise InputError(f"the images differ in size ({sizes}); all must show the same frame")
        # np.stack would convert all to the widest type, so that 255 of 255 became 255 of 65535.
        dtypes = {str(np.asarray(image).dtype) for image in images}
        if len(dtypes) > 1:
            raise InputError(
                f"the images differ in type ({', '.join(sorted(dtypes))}); all must have the same"
            )
        images = np.stack(images)
    if images.ndim != 3 or 0 in images.shape:
        raise InputError(f"images have shape {images.shape}; give (lights, rows, columns)")
    if images.dtype not in _DTYPES:
        raise InputError(f"images are {images.dtype}; give uint8, uint16 or float32")
    if len(images) != lights:
        raise InputError(f"{len(images)} images for {lights} lights; give one image each")
    if len(images) > 255:
        raise InputError(f"{len(images)} lights; give at most 255")
    if images.dtype == np.float32:
        for index, image in enumerate(images):
            _check_values(image, f"image {index}")
    return np.ascontiguousarray(images)


def _checked_ambient(ambient: Array, stack: Array) -> Array:
    """(H, W) contiguous, of the shape and type of the images of `stack`."""
    if ambient.shape != stack.shape[1:] or ambient.dtype != stack.dtype:
        raise InputError(
            f"the ambient image is {ambient.shape} {ambient.dtype}, the light images are "
            f"{stack.shape[1:]} {stack.dtype}; they must agree"
        )
    if ambient.dtype == np.float32:
        _check_values(ambient, "the ambient image")
    return np.ascontiguousarray(ambient)


def _check_values(image: FloatMap, name: str) -> None:
    largest = max(float(image.max()), -float(image.min()))
    if not np.isfinite(largest):
        raise InputError(f"{name} contains NaN or infinity; mask or replace them")
    if largest > _MAX_VALUE:
        raise InputError(
            f"{name} contains a value beyond {_MAX_VALUE:g}; divide all images by a number"
        )


@lru_cache(maxsize=32)
def sample_pixels(shape: tuple[int, int], max_count: int, margin: int = 0) -> Indices:
    """Flat indices of about `max_count` pixels, even and symmetric, `margin` px from the sides."""
    rows, columns = (max(0, side - 2 * margin) for side in shape)
    step = max(1, math.ceil(math.sqrt(rows * columns / max_count)))
    grid = (margin + symmetric_samples(rows, step)), (margin + symmetric_samples(columns, step))
    return (grid[0][:, None] * shape[1] + grid[1]).ravel()


@lru_cache(maxsize=32)
def symmetric_samples(size: int, step: int) -> Indices:
    """Indices below `size` at distances of `step`, symmetric about (size - 1) / 2."""
    middle = (size - 1) // 2
    first = middle if size % 2 else min(middle, max(0, middle - (step - 1) // 2))
    lower = np.arange(first, -1, -step)
    return np.union1d(lower, size - 1 - lower)


_MAX_SAMPLES = 16_384
# Number of groups of samples by brightness: the least variance of a group counts.
_GROUPS = 4
# Least number of samples in a group: fewer do not determine their variance.
_GROUP_SAMPLES = 256
# Least numbers of levels, and of values for each, that determine the step of the rounding.
_MIN_LEVELS, _MIN_VALUES_OF_A_LEVEL = 32, 4
# One pixel in this many, the flattest, counts as level. In the flattest tenth of a rock slopes
# reach 0.3, and highlights no longer cancel (test_gloss_is_not_taken_for_noise).
_LEVEL_PIXEL_DIVISOR = 32
# Least distance of two pixels between which demosaicing and compression do not correlate the noise.
_APART_PX = 2
# Standard normal deviates: of the tenth with the smallest residuals, and 3 sigma of chi-squared
# with one degree of freedom (9.0 in `chi_squared`), beyond which a residual is not noise.
_TENTH, BEYOND_NOISE = -1.2816, 2.76
# Squares of larger values, and their products with gains, are out of reach of float32.
_MAX_NOISE = 1e9

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
        if not (1.0 / _MAX_NOISE <= gain < math.inf and 0.0 <= read_noise <= _MAX_NOISE):
            raise InputError(
                f"sensor noise of {gain:g} e per DN and {read_noise:g} DN read noise; give a gain "
                f"of {1.0 / _MAX_NOISE:g} or more and a read noise of 0 to {_MAX_NOISE:g}"
            )
        if not abs(black) <= _MAX_NOISE:
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
    """Standard deviation of a pixel times gains.

    It is from the smallest residuals of the N - 3 combinations of lights that a Lambertian surface
    cancels, and at least that of the rounding. Three lights leave no combination.
    """
    rounding = 0.0
    if stack.images.dtype.kind != "f":
        rounding = float(gains.max()) * math.sqrt(ROUNDING_VARIANCE) * _rounding_step(stack.images)
    freedom = len(lighting) - 3
    if freedom < 1:
        return rounding
    # The left null space of L, as orthonormal rows.
    cancelling = np.linalg.svd(lighting.directions.T)[2][3:].astype(np.float32)

    def sampled(pixels: Indices) -> tuple[FloatMap, BoolArray]:
        values = stack.values_at(pixels)
        values *= gains[:, None]
        return values, values.min(axis=0) > MAYBE_SHADOW * values.max(axis=0)

    values, in_light = sampled(sample_pixels(stack.shape, _MAX_SAMPLES))
    energies = np.square(cancelling @ values).sum(axis=0)
    groups = _brightness_groups(energies, values.sum(axis=0), in_light)
    flattest = _flattest(values[:, in_light], lighting)
    if flattest is not None:
        groups.append(energies[in_light][flattest])
    # Differences of pairs of pixels on both sides of a sample, in its row and in its column, have
    # twice the variance of the noise.
    middles = sample_pixels(stack.shape, _MAX_SAMPLES // 2, _APART_PX // 2)
    offsets = np.repeat(np.array([1, stack.shape[1]]) * (_APART_PX // 2), middles.size)
    middles = np.tile(middles, 2)
    values, in_light = sampled(middles - offsets)
    others, others_in_light = sampled(middles + offsets)
    if middles.size >= _GROUP_SAMPLES:
        energies = 0.5 * np.square(cancelling @ (values - others)).sum(axis=0)
        brightness = (values + others).sum(axis=0)
        groups += _brightness_groups(energies, brightness, in_light & others_in_light)
    return math.sqrt(min(_variance(group, freedom, rounding**2) for group in groups))


def _brightness_groups(
    energies: FloatMap, brightness: FloatMap, in_light: BoolArray
) -> list[FloatMap]:
    """Split (n,) energies by brightness; of enough lit samples, only these count."""
    if np.count_nonzero(in_light) >= _GROUP_SAMPLES:
        energies, brightness = energies[in_light], brightness[in_light]
    count = min(_GROUPS, max(1, energies.size // _GROUP_SAMPLES))
    # Equal brightness is one group, whatever the order of the pixels.
    ends = energies.size * np.arange(1, count + 1) // count - 1
    edges = [-math.inf, *np.sort(brightness)[ends].tolist()]
    groups = [energies[(low < brightness) & (brightness <= high)] for low, high in pairwise(edges)]
    largest = max(group.size for group in groups)
    return [group for group in groups if group.size >= max(largest // 2, 1)]


def _rounding_step(images: Array) -> float:
    """Median distance of the values of integer images: 257 for 8 bits that were stretched to 16."""
    pixels = sample_pixels(images.shape[1:], _MAX_SAMPLES)
    counts = np.bincount(images.reshape(len(images), -1).take(pixels, axis=1).ravel())
    levels = np.flatnonzero(counts)
    is_measure = _MIN_LEVELS <= levels.size <= counts.sum() // _MIN_VALUES_OF_A_LEVEL
    return float(np.median(np.diff(levels))) if is_measure else 1.0


def _flattest(values: FloatMap, lighting: Lighting) -> BoolArray | None:
    """Which of the pixels (N, n) have the smallest slopes; None if there are too few pixels."""
    count = max(values.shape[1] // _LEVEL_PIXEL_DIVISOR, _GROUP_SAMPLES)
    if values.shape[1] <= count:
        return None
    x, y, z = np.linalg.pinv(lighting.directions).astype(np.float32) @ values
    squares = (np.square(x) + np.square(y)) / np.square(z)
    return np.asarray(squares <= np.partition(squares, count)[count])


def _variance(energies: FloatMap, freedom: int, min_variance: float) -> float:
    """Variance of the Gaussian part of `energies`, each the sum of `freedom` squares."""
    ordered = np.sort(energies)
    sums = np.cumsum(ordered, dtype=np.float64)
    tenth = float(ordered[len(ordered) // 10])
    variance = max(min_variance, tenth / chi_squared(freedom, _TENTH))
    # Iterate to a fixed point, at most 30 times.
    for _ in range(30):
        limit = chi_squared(freedom, BEYOND_NOISE) * variance
        count = int(np.searchsorted(ordered, limit, "right"))
        if count == 0:
            break
        before, variance = variance, max(min_variance, float(sums[count - 1]) / count / freedom)
        if variance == before:
            break
    return variance


def chi_squared(freedom: int, deviate: float) -> float:
    """Chi-squared at a standard normal deviate (Wilson and Hilferty, 1931)."""
    spread = 2.0 / (9.0 * freedom)
    return freedom * (1.0 - spread + deviate * math.sqrt(spread)) ** 3
