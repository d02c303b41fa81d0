"""Levels of four LEDs relative to each other, from the redundancy of their images.

With nul the left null vector of the light directions, sum_k nul_k i_k is zero at every pixel of a
matt surface without shadow, whatever its slope and albedo. If light k has another level than
assumed, sum_k w_k nul_k i_k is zero instead, with w_k the inverse of that level. The images of a
surface with relief span three of four dimensions, and so determine w up to a common factor.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from classify.images.sampling import sample_pixels
from classify.shadow_rule import MAYBE_SHADOW

FloatArray = npt.NDArray[np.float32]

# Real surfaces are taken to be matt to this share of their brightness. A smaller share takes
# their reflectance for unequal LEDs, a larger one hides weak LEDs (test_led_levels.py).
MATT = np.float32(0.005)

_ROUNDS = 4
# Residuals of more than this many standard deviations are shadow or gloss, not noise.
_OUTLIER = 3.0
# Part of the variance of the residuals that is not noise of the images but of the surface.
_SURFACE_VARIANCE = 0.05

# Constants of `level_corrections`; test_led_levels.py shows which levels it corrects.
_MAX_SAMPLES = 16_384
_MIN_SAMPLES = 1_024
# Standard deviation of the levels of LEDs of one type.
_LEVEL_SPREAD = 0.05
# A larger difference is gloss, a shadow or another direction.
_MAX_CORRECTION = 0.1
# The correction must reduce the mean squared residual by this factor at least, to no more than so
# many times that of noise and a matt surface. Else the levels are not to blame.
_MIN_GAIN = 1.25
_MAX_MEAN_SQUARE = 2.0
# Half of all residuals of pure noise are below this: 0.67 standard deviations, with a margin.
_MEDIAN_OF_NOISE = 0.75


@dataclass(frozen=True, eq=False)
class LevelFit:
    """Factors for the images of four lights that minimise the redundancy residual.

    Attributes
    ----------
    factors
        (4,) inverse levels, of mean 1.
    error
        Standard error of the combination of factors that is known least.
    typical_residual
        1.48 times the median absolute residual, in standard deviations of the noise.
    agreeing
        (n,) 1 for samples whose residual is within three times that, else 0.
    """

    factors: npt.NDArray[np.float64]
    error: float
    typical_residual: float
    agreeing: npt.NDArray[np.float64]


def fit_levels(terms: FloatArray, noises: FloatArray, level_spread: float) -> LevelFit:
    """Fit the factors w of mean 1 that make w . terms noise of variance 1.

    Total least squares, as the images that carry the levels carry the noise as well; samples that
    do not agree are left out.

    Parameters
    ----------
    terms
        (4, n) nul_k i_k of the samples, divided by the standard deviation of their sum.
    noises
        (4, n) part of the square of each term that is noise.
    level_spread
        Standard deviation of levels that is assumed where the images determine nothing.
    """
    exact, noise = terms.astype(np.float64), noises.astype(np.float64)
    # Weights 0 and 1: to copy the samples that agree takes longer.
    agreeing = np.ones(terms.shape[1])
    for _ in range(_ROUNDS):
        energy = (agreeing * exact) @ exact.T - np.diag(noise @ agreeing)
        values, vectors = np.linalg.eigh(energy + np.eye(4) / level_spread**2)
        inverse = (vectors / np.maximum(values, 1.0)) @ vectors.T
        # The conditions for a minimum with a fixed sum: w = inverse (1 / spread^2 + multiplier).
        towards = inverse.sum(axis=1)
        factors = towards * (4.0 / towards.sum())
        residual = np.square(factors @ exact) / (np.square(factors) @ noise + _SURFACE_VARIANCE)
        typical = 1.4826 * math.sqrt(_median(residual))
        agreeing = (residual <= (_OUTLIER * max(1.0, typical)) ** 2).astype(np.float64)
    covariance = inverse - np.outer(towards, towards) / towards.sum()
    error = math.sqrt(max(float(np.linalg.eigvalsh(covariance)[-1]), 0.0))
    return LevelFit(factors, error, typical, agreeing)


def level_corrections(
    images: npt.NDArray[Any],
    ambient: npt.NDArray[Any] | None,
    gains: FloatArray,
    saturation: float,
    variance: FloatArray,
    null: npt.NDArray[np.float64],
) -> FloatArray:
    """Find factors of mean 1 for the images of four lights of which each differs by a few percent.

    The factors (4,) are all 1 where the images agree as well without a correction, or not even
    with one. They multiply the known `gains` (4,) of the images (4, H, W).

    Parameters
    ----------
    saturation
        Pixel value from which on a pixel is saturated.
    variance
        (3,) a, b and black of the variance a + b (value - black) of a pixel value.
    null
        (4,) left null vector of the light directions, of length 1.
    """
    equal = np.ones(4, np.float32)
    pixels = sample_pixels(images.shape[1:], _MAX_SAMPLES)
    raw = images.reshape(4, -1).take(pixels, 1).astype(np.float32)
    dark = np.float32(0.0) if ambient is None else ambient.ravel()[pixels].astype(np.float32)
    values = (raw - dark) * gains[:, None]
    brightest = values.max(axis=0)
    lit = np.flatnonzero(
        (values.min(axis=0) > MAYBE_SHADOW * brightest) & (raw.max(axis=0) < saturation)
    )
    if len(lit) < _MIN_SAMPLES:
        return equal
    raw, values, brightest = raw.take(lit, 1), values.take(lit, 1), brightest.take(lit)
    a, b, black = variance
    noises = np.square(null * gains).astype(np.float32)[:, None] * (
        a + b * np.maximum(raw - black, np.float32(0.0))
    )
    spread = np.sqrt(noises.sum(axis=0) + np.square(MATT * brightest))
    terms = null.astype(np.float32)[:, None] * values / spread
    if np.count_nonzero(np.abs(terms.sum(axis=0)) < _MEDIAN_OF_NOISE) > len(lit) // 2:
        return equal
    fit = fit_levels(terms, noises / np.square(spread), _LEVEL_SPREAD)
    if np.abs(fit.factors - 1.0).max() > _MAX_CORRECTION:
        return equal
    before, after = (
        float(np.average(np.square(factors @ terms), weights=fit.agreeing))
        for factors in (equal, fit.factors)
    )
    if after > _MAX_MEAN_SQUARE or before < _MIN_GAIN * after:
        return equal
    return fit.factors.astype(np.float32)


def _median(values: npt.NDArray[np.float64]) -> float:
    """Upper median, found in half the time that numpy takes for the mean of the middle two."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])
