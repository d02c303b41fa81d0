"""The heading of a texture: its orientation over 360 degrees, by third moments.

Spectra are equal after a rotation by 180 degrees. Odd moments of the gradient change their sign, as
on ripples that are steep on one side. They rotate with the surface like vectors: where the
orientation is known modulo 180 degrees, their sign tells it modulo 360. A surface whose slopes are
as likely one way as the other has no heading.
"""

import numpy as np
import numpy.typing as npt

from classify.base.arrays import Array, FloatMap, Floats
from classify.base.compiling import kernel

MIN_SCORE = 4.0
"""Least score of a heading, in standard deviations; test_heading.py tests for false ones."""

HEADING_SUMS = 13
"""Number of sums of `add_row`: |g|^2, and real and imaginary parts of the moments."""

TILE = 128
"""Number of columns whose sums are stored side by side."""

MOMENTS = 6
"""Number of moments of a level; `heading_moments` names them."""
_MAX_LEVELS = 4  # of segments of 256 px, without the finest level
HEADING_FLOATS = 3 * MOMENTS * _MAX_LEVELS
"""Length of `heading_features`: real and imaginary parts of the moments, and their weights."""

# Multiple of the surface's rotation by which the angle of each moment changes.
_SPINS = np.tile([1.0, 1.0, 1.0, 1.0, 1.0, 3.0], _MAX_LEVELS)
# Mean ratio of squared moments to their variance from which a surface has a heading: noise gives 1.
_MIN_SIGNIFICANCE = 2.0

_Complex = npt.NDArray[np.complex128]


@kernel
def add_row(x_row: Array, y_row: Array, z_row: Array, a_row: Array, sums: Array) -> None:
    """Add |g|^2 and the moments of g = x + i y, relief z and albedo a to the sums of each column.

    Sums of `TILE` columns have fixed distances in memory, so that the compiler vectorises.
    """
    three = np.float32(3.0)
    for tile in range(len(x_row) // TILE):
        offset = tile * HEADING_SUMS * TILE
        for c in range(TILE):
            x, y = x_row[tile * TILE + c], y_row[tile * TILE + c]
            z, a = z_row[tile * TILE + c], a_row[tile * TILE + c]
            x_square, y_square = x * x, y * y
            square, z_square, a_square, product = x_square + y_square, z * z, a * a, a * z
            sums[offset + c] += square
            sums[offset + TILE + c] += square * x
            sums[offset + 2 * TILE + c] += square * y
            sums[offset + 3 * TILE + c] += z_square * x
            sums[offset + 4 * TILE + c] += z_square * y
            sums[offset + 5 * TILE + c] += a * x
            sums[offset + 6 * TILE + c] += a * y
            sums[offset + 7 * TILE + c] += a_square * x
            sums[offset + 8 * TILE + c] += a_square * y
            sums[offset + 9 * TILE + c] += product * x
            sums[offset + 10 * TILE + c] += product * y
            # The cube of x + i y.
            sums[offset + 11 * TILE + c] += x * (x_square - three * y_square)
            sums[offset + 12 * TILE + c] += y * (three * x_square - y_square)


@kernel
def sum_tiles(sums: Array, begin: int, end: int, totals: Array) -> None:
    """Totals of the sums of columns `begin` to `end`, which are stored as those of `add_row`."""
    totals[:] = 0.0
    for c in range(begin, end):
        offset = c // TILE * len(totals) * TILE + c % TILE
        for index in range(len(totals)):
            totals[index] += sums[offset + index * TILE]


def heading_moments(sums: Floats, counts: Floats, variances: Floats) -> _Complex:
    """(..., 6) complex moments without unit, from (..., 13) sums of `add_row`."""
    # With g = p + i q minus its mean, z and a the responses of relief and albedo, these are the
    # means of |g|^2 g, z^2 g, a g, a^2 g, a z g and g^3 divided by the rms of each factor. A
    # rotation by t multiplies the first five by exp(i t), the last by exp(3 i t).
    means = sums / counts[..., None]
    tiny = 1e-12
    g = np.sqrt(means[..., 0] + tiny)
    z, a = np.moveaxis(np.sqrt(variances + tiny), -1, 0)
    moments = means[..., 1::2] + 1j * means[..., 2::2]
    units = np.stack([g**3, z * z * g, a * g, a * a * g, a * z * g, g**3], axis=-1)
    return np.asarray(moments / units, np.complex128)


def heading_variances(moments: _Complex) -> Floats:
    """(levels, 6) variance of a frame's moments, from (5, levels, 6) of it and its quarters."""
    quarters = moments[1:]
    deviations = np.abs(quarters - quarters.mean(axis=0))
    variances: Floats = np.square(deviations).sum(axis=0) / (len(quarters) - 1) / len(quarters)
    return variances


def heading_features(moments: _Complex, typical: Floats) -> FloatMap:
    """(72,) float32: (5, levels, 6) moments, and the weights they have in a reference."""
    padded = np.zeros((_MAX_LEVELS, MOMENTS), np.complex128)
    weights = np.zeros((_MAX_LEVELS, MOMENTS))
    levels = len(typical)
    padded[:levels] = moments[0]
    weights[:levels] = 2.0 / (heading_variances(moments) + typical + 1e-12)
    significance = (np.square(np.abs(padded)) * weights).sum() / max(levels * MOMENTS, 1)
    if significance < _MIN_SIGNIFICANCE:
        weights[:] = 0.0
    return np.stack([padded.real, padded.imag, weights]).astype(np.float32).ravel()


def heading_scores(test: FloatMap, references: FloatMap, orientations_deg: Floats) -> Floats:
    """(n,) scores of orientations against the opposite ones, in standard deviations; 0 for none."""
    size = MOMENTS * _MAX_LEVELS
    test_moments = test[:size] + 1j * test[size : 2 * size]
    moments = references[:, :size] + 1j * references[:, size : 2 * size]
    weights = references[:, 2 * size :]
    rotated = test_moments * np.exp(-1j * np.radians(orientations_deg)[:, None] * _SPINS)
    agreement = (weights * (rotated * moments.conj()).real).sum(axis=1)
    energy = (weights * np.square(np.abs(moments))).sum(axis=1)
    noise = np.sqrt(0.5 * np.maximum(energy, 0.0))
    scores: Floats = np.divide(agreement, noise, out=np.zeros(len(noise)), where=noise > 0.0)
    return scores
