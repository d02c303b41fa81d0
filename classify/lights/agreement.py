"""Agreement of light images: four of a matt surface, or two of the same scene."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
import numpy.typing as npt

from classify.base.arrays import BoolArray, FloatMap, Floats, Indices
from classify.base.compiling import kernel
from classify.base.errors import InputError
from classify.base.threads import map_in_threads
from classify.images import (
    ROUNDING_VARIANCE,
    SIGMA_PER_MAD,
    ImageStack,
    SensorNoise,
    noise_of_images,
    symmetric_samples,
)
from classify.lighting import Lighting
from classify.shadow_rule import MAYBE_SHADOW

from .algebra import drop_one_constants
from .led_levels import MATT, fit_levels

# The constants of this file balance the smallest fault that is detected against false alarms on
# clean sets. tests/classify/lights/test_agreement.py tests the first, tests/capture/acquisition/
# test_clean_sets.py and test_fault_matrix.py test both.

# Number of columns compared in every row, because a camera mixes frames by rows; and of rows
# compared in every column, because rotated images must give the same result.
_MAX_COLUMNS = 256
_MIN_SAMPLES = 200
# This number of pixels determines levels to 0.3 % (test_a_matt_surface_agrees_with_itself).
_MAX_SAMPLES = 1 << 15
_MIN_SAMPLES_OF_A_ROW = 8
# Prior standard deviation of LED levels: so wide that the images alone decide.
_LEVEL_SPREAD = 1.0
# Larger residuals, in standard deviations of the noise, are not explained by LED levels.
_MAX_TYPICAL_RESIDUAL = 1.8
# Least factor of an LED; a smaller one means an image 20 times too bright, or a negative one.
_MIN_FACTOR = 0.05
# Levels of parts of the frame are equal if they differ by no more than this and their errors.
_EQUAL_LEVELS = 0.015
# Deviations of a pixel are clipped at this many standard deviations.
_OUTLIER = 3.0
# A band of rows deviates if its mean square exceeds the noise by the sum of this share and this
# many standard errors.
_ABOVE_NOISE = 0.3
_STANDARD_ERRORS = 6.0
# Rounding has a variance of 1/12 on average, and of 1/4 where all values lie halfway between two
# integers.
_EXTRA_ROUNDING = 1.0 / 4.0 - ROUNDING_VARIANCE


@dataclass(frozen=True)
class LightAgreement:
    """LED levels and consistency of four light images, if the surface is matt."""

    redundancy_residual: float  # beyond noise, rms share of the brightness
    levels: tuple[float, ...] | None  # (4,) of median 1; None if no levels explain the images
    level_error: float  # standard error of the least certain level
    compared_rows: float  # share of the rows with enough pixels lit by all four


def split_by_redundancy_sign(lighting: Lighting) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Split the lights by the sign of their redundancy weight; halve them if not four."""
    lights = range(len(lighting))
    try:
        null = drop_one_constants(lighting, "split_by_redundancy_sign")[1]
    except InputError:
        half = (len(lighting) + 1) // 2
        return tuple(lights[:half]), tuple(lights[half:])
    same_sign = tuple(light for light in lights if null[light] * null[0] > 0.0)
    return same_sign, tuple(light for light in lights if light not in same_sign)


def light_agreement(
    images: npt.NDArray[np.uint16],
    lighting: Lighting,
    ambient: npt.NDArray[np.uint16],
    full_scale: float,
    noise: SensorNoise | None,
) -> LightAgreement:
    """Compare (4, H, W) images by the redundancy residual sum_k nul_k i_k.

    The LED levels are fitted first. A residual beyond noise in some rows or columns shows torn,
    mixed or wrong frames.
    """
    _, null = drop_one_constants(lighting, "light_agreement")
    rows, columns = images.shape[1:]
    sigma = 0.0
    if noise is None:
        gains = (1.0 / lighting.intensities).astype(np.float32)
        sigma = noise_of_images(ImageStack(images, ambient), gains, lighting)
    compare = partial(_compare, images, ambient, lighting, null, full_scale, noise or sigma)
    step = max(1, math.ceil(math.sqrt(rows * columns / _MAX_SAMPLES)))
    grid = compare(symmetric_samples(rows, step), symmetric_samples(columns, step))
    terms, variances = grid.normalised()
    frame_levels, *half_levels = map_in_threads(
        lambda part: _fit(terms.take(part, axis=1), variances.take(part, axis=1)),
        [*_parts(grid.lit)],
    )
    determined = [levels for levels in half_levels if levels is not None]
    if frame_levels is not None and not all(map(frame_levels.agrees_with, determined)):
        frame_levels = None
    levels = np.ones(4) if frame_levels is None else frame_levels.levels
    by_rows = compare(np.arange(rows), _spread_indices(columns))
    by_columns = compare(_spread_indices(rows), np.arange(columns))
    deviation, variance = by_columns.corrected(levels)
    return LightAgreement(
        redundancy_residual=max(
            _beyond_noise(*by_rows.corrected(levels), by_rows.lit),
            _beyond_noise(deviation.T, variance.T, by_columns.lit.T),
        ),
        levels=None if frame_levels is None else tuple(frame_levels.levels.tolist()),
        level_error=math.inf if frame_levels is None else frame_levels.error,
        compared_rows=float((by_rows.lit.sum(axis=1) >= _MIN_SAMPLES_OF_A_ROW).mean()),
    )


@dataclass(frozen=True, eq=False)
class _Comparison:
    """Terms of the redundancy residual at some pixels, in shares of the brightness."""

    terms: FloatMap  # (4, R, C) weighted values
    variances: FloatMap  # (4, R, C) noise variance of the terms
    lit: BoolArray  # (R, C) whether all four lights reach a pixel

    def normalised(self) -> tuple[FloatMap, FloatMap]:
        """(4, R C) terms and variances for `fit_levels`."""
        total = self.variances.sum(axis=0) + MATT**2
        return (
            (self.terms / np.sqrt(total)).reshape(4, -1),
            (self.variances / total).reshape(4, -1),
        )

    def corrected(self, levels: Floats) -> tuple[FloatMap, FloatMap]:
        """(R, C) residual after correction for the levels, and its variance."""
        factors = (1.0 / levels).astype(np.float32)
        residual, variance = (
            (weights @ values.reshape(4, -1)).reshape(self.lit.shape)
            for weights, values in ((factors, self.terms), (np.square(factors), self.variances))
        )
        variance += MATT**2
        return residual, variance


def _compare(
    images: npt.NDArray[np.uint16],
    ambient: npt.NDArray[np.uint16],
    lighting: Lighting,
    null: Floats,
    full_scale: float,
    noise: SensorNoise | float,
    rows: Indices,
    columns: Indices,
) -> _Comparison:
    """Compare some rows and columns; a float `noise` is the standard deviation of all values."""
    raw, dark = (_subset(planes, rows, columns).astype(np.float32) for planes in (images, ambient))
    gains = (1.0 / lighting.intensities).astype(np.float32)
    if isinstance(noise, SensorNoise):
        factors, coefficients = np.square(gains), noise.coefficients()
    else:
        factors = np.ones(4, np.float32)
        coefficients = np.array([max(noise**2, ROUNDING_VARIANCE), 0.0, 0.0], np.float32)
    means = gains * (raw.mean(axis=(1, 2)) - dark.mean())
    variances, lit = np.empty_like(raw), np.empty(dark.shape, np.bool_)
    _weigh(
        raw, dark, gains, np.maximum(means, np.float32(1e-6)),
        (null / np.abs(null).mean()).astype(np.float32), factors, coefficients,
        np.float32(full_scale), variances, lit,
    )  # fmt: skip
    return _Comparison(raw, variances, lit)


def _subset(
    planes: npt.NDArray[np.uint16], rows: Indices, columns: Indices
) -> npt.NDArray[np.uint16]:
    """Pick rows and columns of (..., H, W); rows first, which are contiguous."""
    if len(rows) < planes.shape[-2]:
        planes = planes.take(rows, axis=-2)
    return planes.take(columns, axis=-1) if len(columns) < planes.shape[-1] else planes


@kernel
def _weigh(
    values: FloatMap, dark: FloatMap, gains: FloatMap, means: FloatMap, null: FloatMap,
    factors: FloatMap, coefficients: FloatMap, full_scale: np.float32,
    variances: FloatMap, lit: BoolArray,
) -> None:  # fmt: skip
    """Replace `values` (4, R, C) by the terms of the residual; write their variances and `lit`."""
    # The variance of a value is `factors` (4,) times a + b (value - black); `coefficients` are a, b
    # and black.
    rows, columns = dark.shape
    a, b, black = coefficients
    zero, quarter, tiny = np.float32(0.0), np.float32(0.25), np.float32(1e-6)
    shadow = np.float32(MAYBE_SHADOW)
    low, high, total = np.empty((3, columns), np.float32)
    for r in range(rows):
        low[:], high[:], total[:], lit[r] = np.inf, -np.inf, zero, True
        for k in range(4):
            gain, relative_gain = gains[k], gains[k] / means[k]
            for c in range(columns):
                value = values[k, r, c]
                variances[k, r, c] = factors[k] * (a + b * max(value - black, zero))
                lit[r, c] &= value < full_scale
                value -= dark[r, c]
                values[k, r, c] = gain * value
                relative = relative_gain * value
                low[c], high[c] = min(low[c], relative), max(high[c], relative)
                total[c] += gain * value
        for c in range(columns):
            lit[r, c] &= low[c] > shadow * high[c]
            # Relative to the brightness: an image that is wrong by 5 % gives a residual of 5 %.
            total[c] = np.float32(1.0) / max(quarter * total[c], tiny)
        for k in range(4):
            for c in range(columns):
                weight = null[k] * total[c]
                values[k, r, c] *= weight
                variances[k, r, c] *= weight * weight


def image_difference(
    first: npt.NDArray[np.uint16],
    second: npt.NDArray[np.uint16],
    signal: float,
    noise: SensorNoise | None,
) -> float:
    """Rms difference beyond noise of two images of one scene, as a share of `signal`."""
    columns = _spread_indices(first.shape[1])
    a, b = (image.take(columns, axis=1).astype(np.float32) for image in (first, second))
    if noise is None:
        variance = _variance_of_difference(a, b)
    else:
        offset, slope, black = (float(value) for value in noise.coefficients())
        variance = 2.0 * offset + slope * np.maximum(a + b - 2.0 * black, 0.0)
    variance += np.float32(2.0 * _EXTRA_ROUNDING)
    share = np.float32(1.0 / signal)
    everywhere = np.ones(a.shape, np.bool_)
    return _beyond_noise(share * (a - b), share * share * variance, everywhere)


def _variance_of_difference(a: FloatMap, b: FloatMap) -> FloatMap:
    """(H, W) variance from row neighbours, in four groups of brightness (shot noise)."""
    brightness = a + b
    difference = a - b
    # The last column has no right neighbour: it gets the step from its left one.
    steps = np.abs(np.diff(difference, axis=1, append=difference[:, -2:][:, :1]))
    groups = np.searchsorted(np.quantile(brightness, (0.25, 0.5, 0.75)), brightness)
    variance = np.empty_like(a)
    for group in range(4):
        inside = groups == group
        typical = float(np.median(steps[inside])) if inside.any() else 0.0
        # At least the rounding variance of a difference; a step has twice the variance of a value.
        variance[inside] = max(2.0 * ROUNDING_VARIANCE, (SIGMA_PER_MAD * typical) ** 2 / 2.0)
    return variance


def _spread_indices(size: int) -> Indices:
    """Indices of about `_MAX_COLUMNS` rows or columns, symmetric about the middle."""
    return symmetric_samples(size, max(1, -(-size // _MAX_COLUMNS)))


def _beyond_noise(deviation: FloatMap, variance: FloatMap, is_counted: BoolArray) -> float:
    """Rms deviation beyond noise, the largest over bands of 1, 4, 16, ... rows."""
    rows = len(deviation)
    squares = np.square(deviation)
    squares /= variance
    np.minimum(squares, np.float32(_OUTLIER**2), out=squares)
    np.copyto(squares, 0.0, where=~is_counted)
    counts_of_rows, sums_of_rows = is_counted.sum(axis=1), squares.sum(axis=1)
    worst = 0.0
    height = 1
    while True:
        edges = _band_edges(rows, height)
        starts = edges[:-1]
        counts = np.add.reduceat(counts_of_rows, starts)
        means = np.add.reduceat(sums_of_rows, starts) / np.maximum(counts, 1)
        errors = _STANDARD_ERRORS * np.sqrt(2.0 / np.maximum(counts, 1))
        excessive_bands = np.flatnonzero(
            (counts >= _MIN_SAMPLES_OF_A_ROW) & (means > 1.0 + _ABOVE_NOISE + errors)
        )
        total = 0.0
        for band in excessive_bands:
            part = slice(int(edges[band]), int(edges[band + 1]))
            inside = is_counted[part]
            # The median, because a few glints do not show a wrong light.
            typical = SIGMA_PER_MAD * float(np.median(np.abs(deviation[part][inside])))
            noise = float(np.median(variance[part][inside]))
            total += max(0.0, typical**2 - noise) * len(inside) / rows
        worst = max(worst, total)
        if height >= rows:
            return float(np.sqrt(worst))
        height *= 4


@lru_cache(maxsize=32)
def _band_edges(rows: int, height: int) -> Indices:
    """First rows of bands of about equal height, symmetric, and the end."""
    count = -(-rows // height)
    # An odd number of rows has no edge in the middle.
    count += rows % 2 * (1 - count % 2)
    first_half = np.arange(count // 2 + 1) * rows // count
    return np.union1d(first_half, rows - first_half)


@dataclass(frozen=True, eq=False)
class _Levels:
    """LED levels (4,) of median 1, and the standard error of the least certain one."""

    levels: Floats
    error: float

    def agrees_with(self, other: _Levels) -> bool:
        """Whether all levels are equal to within their errors."""
        limit = _EQUAL_LEVELS + _STANDARD_ERRORS * math.hypot(self.error, other.error)
        return bool(np.abs(self.levels - other.levels).max() <= limit)


def _parts(lit: BoolArray) -> Iterator[Indices]:
    """Lit pixels of the frame and of its halves, in which levels of a near light would differ."""
    rows, columns = lit.shape
    top, left = (rows + 1) // 2, (columns + 1) // 2
    halves = np.s_[:top], np.s_[rows - top :], np.s_[:, :left], np.s_[:, columns - left :]
    for part in np.s_[:, :], *halves:
        inside = np.zeros_like(lit)
        inside[part] = lit[part]
        yield np.flatnonzero(inside)


def _fit(terms: FloatMap, variances: FloatMap) -> _Levels | None:
    """Levels that reduce the residual to noise, or None; arguments as of `fit_levels`."""
    if terms.shape[1] < _MIN_SAMPLES:
        return None
    fit = fit_levels(terms, variances, _LEVEL_SPREAD)
    if fit.typical_residual > _MAX_TYPICAL_RESIDUAL or fit.factors.min() < _MIN_FACTOR:
        return None
    levels = 1.0 / fit.factors
    return _Levels(levels / np.median(levels), fit.error)
