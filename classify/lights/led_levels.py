"""Levels of four LEDs relative to each other, from the redundancy of their images.

With nul the left null vector of the light directions, sum_k nul_k i_k is zero at every pixel of a
matt surface without shadow, whatever its slope and albedo. If light k has another level than
assumed, sum_k w_k nul_k i_k is zero instead, with w_k the inverse of that level. The images of a
surface with relief span three of four dimensions, and so determine w up to a common factor.

There are two estimates. The first, from the redundancy, is exact to parts in a thousand, but only
for a surface that is matt to half a percent: gloss of a few percent makes it useless (2.4 instead
of 1.0 on icon_rti72). The second compares the brightness of the images. It is good to a few percent
for any surface, and is used where the first leaves a residual.
"""

import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from classify.base.arrays import FloatMap, Floats
from classify.images import SIGMA_PER_MAD
from classify.lighting import Lighting
from classify.shadow_rule import MAYBE_SHADOW

from .algebra import drop_one_constants

# Assumed departure of real surfaces from Lambert's law, as a share of their brightness. A smaller
# one mistakes their reflectance for unequal LEDs, a larger one hides weak LEDs
# (test_led_levels.py).
MATT = np.float32(0.005)

LEVEL_SAMPLES = 16_384
"""Pixels that `level_corrections` needs; a quarter of them is enough for `residual_spread`."""

# Number of fits, each without the outliers of the last one. With a tenth of the samples in gloss, a
# fifth fit changes the levels by 1e-5.
_ROUNDS = 4
# Residuals of more than this many standard deviations are shadow or gloss, not noise.
_OUTLIER = 3.0
# Variance that the surface adds to that of the residuals, in units of the noise of the images.
_SURFACE_VARIANCE = 0.05

# Constants of `level_corrections`; test_led_levels.py shows which levels it corrects.
_MIN_SAMPLES = 1_024
# Standard deviation of the levels of LEDs of one type.
_LEVEL_SPREAD = 0.05
# Largest correction of a level by the redundancy. A larger difference is gloss, a shadow or a wrong
# direction of a light.
_MAX_CORRECTION = 0.1
# Levels explain the residual if their correction divides its mean square by `_MIN_GAIN` or more,
# and leaves at most `_MAX_MEAN_SQUARE` times that of noise and a matt surface.
_MIN_GAIN = 1.25
_MAX_MEAN_SQUARE = 2.0
# Levels of five or more lights explain the residual if they divide it by `_MIN_MANY_GAIN`, as 14 on
# cat_lights12, and are the only ones if others leave `_MIN_MANY_MARGIN` times its mean square.
_MIN_MANY_GAIN, _MIN_MANY_MARGIN = 3.0, 10.0
# Standard deviation of the mean slope of a part: that of a flat part, which lies within a degree in
# a rig, and as a share of the spread of its slopes, for parts such as figurines.
_MEAN_SLOPE, _MEAN_SLOPE_OF_RELIEF = 0.02, 0.3
# Median absolute residual, in standard deviations, up to which the residuals count as noise; that
# of pure noise is 0.67.
_MEDIAN_OF_NOISE = 0.75


@dataclass(frozen=True, eq=False)
class _LevelFit:
    """Factors for the images of four lights that minimise the redundancy residual."""

    factors: Floats  # (4,) inverse levels, of mean 1
    error: float  # standard error of the least certain combination of factors
    typical_residual: float  # 1.48 times the median absolute residual, in sigma of noise
    agreeing: Floats  # (n,) 1 where the residual is within 3 times that, else 0


def fit_levels(terms: FloatMap, variances: FloatMap, level_spread: float) -> _LevelFit:
    """Fit the factors w of mean 1 that make w . terms noise of variance 1."""
    # Total least squares: `terms` (4, n) are nul_k i_k over the standard deviation of their sum,
    # `variances` their noise variances, and `level_spread` the prior standard deviation of levels.
    terms_64, variances_64 = terms.astype(np.float64), variances.astype(np.float64)
    # Weights of 0 or 1, because copying the samples that agree takes longer.
    agreeing = np.ones(terms.shape[1])
    for _ in range(_ROUNDS):
        # Second moments of the terms, less those of the noise.
        moments = (agreeing * terms_64) @ terms_64.T - np.diag(variances_64 @ agreeing)
        values, vectors = np.linalg.eigh(moments + np.eye(4) / level_spread**2)
        inverse = (vectors / np.maximum(values, 1.0)) @ vectors.T
        # The conditions for a minimum with a fixed sum: w = inverse (1 / spread^2 + multiplier).
        row_sums = inverse.sum(axis=1)
        factors = row_sums * (4.0 / row_sums.sum())
        variance = np.square(factors) @ variances_64 + _SURFACE_VARIANCE
        squares = np.square(factors @ terms_64) / variance
        typical = SIGMA_PER_MAD * math.sqrt(_median(squares))
        agreeing = (squares <= (_OUTLIER * max(1.0, typical)) ** 2).astype(np.float64)
    covariance = inverse - np.outer(row_sums, row_sums) / row_sums.sum()
    error = math.sqrt(max(float(np.linalg.eigvalsh(covariance)[-1]), 0.0))
    return _LevelFit(factors, error, typical, agreeing)


@dataclass(frozen=True, eq=False)
class LitSamples:
    """Pixels of N images that all lights reach, evenly spread over the frame."""

    raw: FloatMap  # (N, n) pixel values
    values: FloatMap  # (N, n) less the ambient image and times the gains

    @classmethod
    def of(cls, raw: FloatMap, values: FloatMap, saturation: float) -> Self:
        """The pixels of a sample that all lights reach and that are below `saturation`."""
        lit = np.flatnonzero(
            (values.min(axis=0) > MAYBE_SHADOW * values.max(axis=0))
            & (raw.max(axis=0) < saturation)
        )
        return cls(raw.take(lit, 1), values.take(lit, 1))


def residual_spread(values: FloatMap, null: Floats) -> float:
    """Robust deviation of the redundancy residual from 0, as a share of brightness."""
    if values.shape[1] < _MIN_SAMPLES // 4:
        return 0.0
    residual = np.abs(null.astype(np.float32) @ values) / values.mean(axis=0)
    return SIGMA_PER_MAD * _median(residual)


def level_corrections(
    lit: LitSamples, gains: FloatMap, noise_coefficients: FloatMap, lighting: Lighting
) -> FloatMap:
    """Factors (4,) of mean 1 that correct images of LEDs of unknown levels.

    They are of `fit_levels` if its factors explain the residual, else of `_levels_by_brightness`.
    `noise_coefficients` (3,) are a, b and black of the variance a + b (value - black).
    """
    no_correction = np.ones(4, np.float32)
    values, count = lit.values, lit.values.shape[1]
    if count < _MIN_SAMPLES:
        return no_correction
    pinv, null = drop_one_constants(lighting, "level_corrections")
    a, b, black = noise_coefficients
    variances = np.square(null * gains).astype(np.float32)[:, None] * (
        a + b * np.maximum(lit.raw - black, np.float32(0.0))
    )
    spread = np.hypot(np.sqrt(variances.sum(axis=0)), MATT * values.max(axis=0))
    terms = null.astype(np.float32)[:, None] * values / spread
    if np.count_nonzero(np.abs(terms.sum(axis=0)) < _MEDIAN_OF_NOISE) > count // 2:
        return no_correction
    fit = fit_levels(terms, variances / spread / spread, _LEVEL_SPREAD)
    before, after = (
        float(np.average(np.square(factors @ terms), weights=fit.agreeing))
        for factors in (no_correction, fit.factors)
    )
    is_explained = after <= _MAX_MEAN_SQUARE and before >= _MIN_GAIN * after
    if is_explained and np.abs(fit.factors - 1.0).max() <= _MAX_CORRECTION:
        return np.asarray(fit.factors, np.float32)
    factors = 1.0 / _levels_by_brightness(values, pinv, null, lighting.directions)
    return np.asarray(factors / factors.mean(), np.float32)


def levels_of_many(values: FloatMap, lighting: Lighting) -> Floats | None:
    """Levels (N,) of median 1 of five or more lights; None if they do not explain the residual.

    The inverse levels w minimise the mean square of null @ (w i) over the images i of `values`
    (N, n), with null the left null space of the directions.
    """
    if values.shape[1] < _MIN_SAMPLES:
        return None
    null = np.linalg.svd(lighting.directions.T)[2][3:]
    shares = (values / values.mean(axis=0)).astype(np.float64)
    agreeing = np.ones(values.shape[1], np.bool_)
    for _ in range(_ROUNDS):
        used = shares[:, agreeing]
        squares, vectors = np.linalg.eigh((null.T @ null) * (used @ used.T))
        factors = vectors[:, 0] / vectors[:, 0].mean()
        residual = np.linalg.norm(null @ (factors[:, None] * shares), axis=0)
        agreeing = residual <= _OUTLIER * np.median(residual)
    before = np.median(np.linalg.norm(null @ shares, axis=0))
    is_explained = before >= _MIN_MANY_GAIN * np.median(residual) and factors.min() > 0.0
    if not is_explained or squares[1] < _MIN_MANY_MARGIN * squares[0]:
        return None
    return np.asarray(np.median(factors) / factors)


def _levels_by_brightness(
    values: FloatMap,
    pinv: Floats,
    null: Floats,
    directions: Floats,
) -> Floats:
    """Levels (4,) of the LEDs, if the mean slope of the part is about 0.

    The median log ratios are g + A t with A = -l_xy / l_z, log levels g and mean slopes t. Both
    have normal priors. The levels are those of the posterior mean of g.
    """
    vertical = directions[:, 2]
    logarithms = np.log(values / vertical.astype(np.float32)[:, None])
    ratios = np.median(logarithms - logarithms.mean(axis=0), axis=1).astype(np.float64)
    equalised = values * np.exp(-ratios).astype(np.float32)[:, None]
    explained_variance = residual_spread(values, null) ** 2 - residual_spread(equalised, null) ** 2
    if explained_variance <= 0.0:
        return np.ones(4)
    variance = explained_variance / float(np.square(null * vertical / vertical.mean()).sum())
    bx, by, bz = pinv.astype(np.float32) @ values
    slopes = np.stack([bx, by]) / bz
    slopes -= np.median(slopes, axis=1, keepdims=True)
    relief = SIGMA_PER_MAD * np.median(np.abs(slopes), axis=1)
    slope_variance = _MEAN_SLOPE**2 + _MEAN_SLOPE_OF_RELIEF**2 * float(np.square(relief).mean())
    horizontal = directions[:, :2] / vertical[:, None]
    slope_covariance = slope_variance * horizontal @ horizontal.T
    # The last term leaves a common factor of all levels open, which the images do not determine.
    covariance = variance * np.eye(4) + slope_covariance + np.full((4, 4), 1e3)
    levels: Floats = np.exp(variance * np.linalg.solve(covariance, ratios))
    return levels


def _median(values: npt.NDArray[np.floating[Any]]) -> float:
    """Upper median, in half the time of `np.median`."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])
