"""How strong four lights are among themselves, from the four images of any surface with relief."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["light_balance"]

FloatArray = npt.NDArray[np.float32]

_MAX_SAMPLES = 16_384
_MIN_SAMPLES = 1_024
# A light that gives less than this share of the brightest may be in shadow.
_MAYBE_SHADOW = 0.2
# LEDs differ by so much, as far as nothing is known.
_SPREAD = 0.05
# Beyond this it is no light of another strength, but gloss, a shadow, or another direction.
_MAX_DIFFERENCE = 0.1
# Surfaces are matt to about this share of their brightness.
_MATT = np.float32(0.005)
# Squared contradictions must become smaller by this factor at least, and must not be more than so
# many times what is expected of noise and a matt surface. Else it is not the lights that are wrong.
_WORTH_IT = 1.25
_EXPLAINED = 2.0
# Half of all contradictions are below this where there is nothing but noise, and some room.
_NOISE = 0.75
_ROUNDS = 3
_BEYOND = 3.0


def light_balance(
    images: npt.NDArray[Any],
    ambient: npt.NDArray[Any] | None,
    gains: npt.NDArray[np.float32],
    saturation: float,
    variance: npt.NDArray[np.float32],
    null: npt.NDArray[np.float64],
) -> npt.NDArray[np.float32]:
    """Factors of mean 1 for the images of four lights, with which they contradict each other least.

    With nul the left null vector of the light directions, sum_k nul_k i_k is zero at every pixel of
    a matt surface without shadow, whatever its slope and albedo. Where light k has another strength
    than it is taken for, it is sum_k w_k nul_k i_k that is zero, w_k the inverse of that strength.
    The images of a surface with relief span three of four dimensions, and so leave one w: the least
    squares over many lit pixels, with w_k taken for 1 within some per cent where they do not tell.

    Parameters
    ----------
    images
        (4, H, W) as they are given.
    ambient
        (H, W), subtracted, or None.
    gains
        (4,) factors that are known.
    saturation
        Pixel value from which on a pixel is saturated.
    variance
        (3,) a, b and black of the variance a + b (value - black) of a pixel value.
    null
        (4,) left null vector of the light directions, of length 1.

    Returns
    -------
    (4,) float32, all 1 where the lights agree as well without, or not even with them.
    """
    equal = np.ones(4, np.float32)
    step = max(1, math.ceil(math.sqrt(images[0].size / _MAX_SAMPLES)))
    grid = np.s_[::step, ::step]
    raw = images[(slice(None), *grid)].reshape(4, -1).astype(np.float32)
    dark = np.float32(0.0) if ambient is None else ambient[grid].ravel().astype(np.float32)
    values = (raw - dark) * gains[:, None]
    brightest = values.max(axis=0)
    lit = np.flatnonzero(
        (values.min(axis=0) > _MAYBE_SHADOW * brightest) & (raw.max(axis=0) < saturation)
    )
    if len(lit) < _MIN_SAMPLES:
        return equal
    raw, values, brightest = raw.take(lit, 1), values.take(lit, 1), brightest.take(lit)
    a, b, black = variance
    noise = np.square(null * gains).astype(np.float32) @ (
        a + b * np.maximum(raw - black, np.float32(0.0))
    )
    terms = (
        null.astype(np.float32)[:, None] * values / np.sqrt(noise + np.square(_MATT * brightest))
    )
    if np.count_nonzero(np.abs(terms.sum(axis=0)) < _NOISE) > len(lit) // 2:
        return equal
    factors = equal
    agree = np.ones(terms.shape[1], np.bool_)
    for _ in range(_ROUNDS):
        factors = _least_contradiction(terms[:, agree])
        left_over = np.abs(factors @ terms)
        agree = left_over <= _BEYOND * max(1.0, 1.4826 * float(np.median(left_over)))
    if np.abs(factors - 1.0).max() > _MAX_DIFFERENCE:
        return equal
    before, after = (float(np.square(w @ terms[:, agree]).mean()) for w in (equal, factors))
    if after > _EXPLAINED or before < _WORTH_IT * after:
        return equal
    return factors


def _least_contradiction(terms: FloatArray) -> FloatArray:
    """(4,) w of mean 1 with the least |w terms|^2 + |w - 1|^2 / spread^2."""
    prior = np.eye(4) / _SPREAD**2
    # In single precision the sums would drown what tells a level surface's lights apart.
    exact = terms.astype(np.float64)
    inverse = np.linalg.inv(exact @ exact.T + prior)
    # Of the conditions for a minimum with a fixed sum: w = inverse (1 / spread^2 + multiplier).
    towards = inverse.sum(axis=1)
    factors: FloatArray = (towards * (4.0 / towards.sum())).astype(np.float32)
    return factors
