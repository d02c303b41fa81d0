"""Which of two ways a texture lies: spectra are the same after half a turn, surfaces need not be.

A ripple that is steep on one side, a tile with its joint in shadow paint on the left: what is odd
in the gradient changes its sign when the surface makes half a turn. Means of such products turn
with the surface like vectors, so that once the turn is known modulo 180 degrees their sign says
which of the two turns it is. Surfaces whose slopes are as likely one way as the other have none.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from classify.compiling import kernel
from classify.surface.estimate import FloatMap

__all__ = [
    "HEADING_FLOATS",
    "HEADING_SUMS",
    "LEAST_SCORE",
    "MOMENTS",
    "add_row",
    "heading_moments",
    "heading_numbers",
    "heading_scores",
    "heading_variances",
]

LEAST_SCORE = 4.0
"""Standard deviations by which one of the two ways must be the better to be told."""

HEADING_SUMS = 13
MOMENTS = 6
_MAX_LEVELS = 4
HEADING_FLOATS = 3 * MOMENTS * _MAX_LEVELS
"""Real and imaginary parts of the moments, and a weight of each."""

# How many times its angle each moment turns when the surface turns.
_SPINS = np.tile([1.0, 1.0, 1.0, 1.0, 1.0, 3.0], _MAX_LEVELS)
# Squared moments must be so many times their variance, in the mean, for a surface to have a way.
_LEAST_SIGNIFICANCE = 2.0

Array = npt.NDArray[Any]
Complex = npt.NDArray[np.complex128]
Floats = npt.NDArray[np.float64]


@kernel
def add_row(
    p: Array, q: Array, z: Array, a: Array, p_mean: np.float32, q_mean: np.float32,
    begin: int, end: int, sums: Array,
) -> None:  # fmt: skip
    """Sums over a part of a row: |g|^2, then the real and imaginary parts of the moments."""
    zero = np.float32(0.0)
    energy, g1, g2, z1, z2, a1, a2 = zero, zero, zero, zero, zero, zero, zero
    aa1, aa2, az1, az2, c1, c2 = zero, zero, zero, zero, zero, zero
    for c in range(begin, end):
        x, y = p[c] - p_mean, q[c] - q_mean
        square = x * x + y * y
        z_square, a_square, product = z[c] * z[c], a[c] * a[c], a[c] * z[c]
        energy += square
        g1 += square * x
        g2 += square * y
        z1 += z_square * x
        z2 += z_square * y
        a1 += a[c] * x
        a2 += a[c] * y
        aa1 += a_square * x
        aa2 += a_square * y
        az1 += product * x
        az2 += product * y
        # The cube of x + i y.
        c1 += x * (x * x - np.float32(3.0) * y * y)
        c2 += y * (np.float32(3.0) * x * x - y * y)
    found = (energy, g1, g2, z1, z2, a1, a2, aa1, aa2, az1, az2, c1, c2)
    for index in range(len(found)):
        sums[index] = found[index]


def heading_moments(sums: Floats, counts: Floats, variances: Floats) -> Complex:
    """(..., 6) complex moments without unit, from sums over pixels.

    With g = p + i q less its mean, z and a the responses of relief and albedo, these are the means
    of |g|^2 g, z^2 g, a g, a^2 g, a z g and g^3 over the rms of each factor. Turned anticlockwise
    by t the first five take the factor exp(i t), the last exp(3 i t).

    Parameters
    ----------
    sums
        (..., 13) as from `add_row`, of `counts` (...) pixels.
    variances
        (..., 2) of relief and of albedo responses.
    """
    means = sums / counts[..., None]
    tiny = 1e-12
    g = np.sqrt(means[..., 0] + tiny)
    z, a = np.moveaxis(np.sqrt(variances + tiny), -1, 0)
    moments = means[..., 1::2] + 1j * means[..., 2::2]
    units = np.stack([g**3, z * z * g, a * g, a * a * g, a * z * g, g**3], axis=-1)
    return np.asarray(moments / units, np.complex128)


def heading_variances(moments: Complex) -> Floats:
    """(levels, 6) variance of the moments of a frame, from those of its quarters.

    `moments` is (5, levels, 6), the frame first.
    """
    quarters = moments[1:]
    deviations = np.abs(quarters - quarters.mean(axis=0))
    variances: Floats = np.square(deviations).sum(axis=0) / (len(quarters) - 1) / len(quarters)
    return variances


def heading_numbers(moments: Complex, typical: Floats) -> FloatMap:
    """(72,) float32: moments, and their weights as those of a reference.

    Parameters
    ----------
    moments
        (5, levels, 6), the frame first.
    typical
        (levels, 6) `heading_variances`, the mean over all training sets: four quarters tell those
        of one set only roughly, and half of either is believed.
    """
    found = np.zeros((_MAX_LEVELS, MOMENTS), np.complex128)
    weights = np.zeros((_MAX_LEVELS, MOMENTS))
    levels = len(typical)
    found[:levels] = moments[0]
    weights[:levels] = 2.0 / (heading_variances(moments) + typical + 1e-12)
    significance = (np.square(np.abs(found)) * weights).sum() / max(levels * MOMENTS, 1)
    if significance < _LEAST_SIGNIFICANCE:
        weights[:] = 0.0
    return np.concatenate(
        [found.real.ravel(), found.imag.ravel(), weights.ravel()],
        dtype=np.float32,
        casting="same_kind",
    )


def heading_scores(test: FloatMap, references: FloatMap, turns_deg: Floats) -> Floats:
    """(n,) standard deviations by which a test, turned back, lies as a reference does.

    Negative where it lies the other way round, and the turn is half a turn more; 0 where the
    reference has no way to lie.

    Parameters
    ----------
    test, references
        (72,) and (n, 72) of `heading_numbers`.
    turns_deg
        (n,) from the reference to the test, modulo 180.
    """
    size = MOMENTS * _MAX_LEVELS
    own = test[:size] + 1j * test[size : 2 * size]
    others = references[:, :size] + 1j * references[:, size : 2 * size]
    weights = references[:, 2 * size :]
    turned = own * np.exp(-1j * np.radians(turns_deg)[:, None] * _SPINS)
    agreement = (weights * (turned * others.conj()).real).sum(axis=1)
    energy = (weights * np.square(np.abs(others))).sum(axis=1)
    noise = np.sqrt(0.5 * np.maximum(energy, 0.0))
    scores: Floats = np.divide(agreement, noise, out=np.zeros(len(noise)), where=noise > 0.0)
    return scores
