"""Energy and anisotropy of the whitened fields around each cell."""

from functools import partial

import numpy as np

from classify.compiling import Array, kernel
from classify.surface.estimate import FloatMap
from classify.threads import run_on_rows

from .fields import HALF_CELL, gaussian_mean, resized

LEVELS = 4
"""Octaves of the local statistics."""
OCTAVE_STATISTICS = 2 * LEVELS
"""Statistics of a cell, or three times as many with anisotropies."""

# Cells over which local statistics are averaged: standard deviation of the Gaussian.
_STATISTICS_CELLS = 1.5
# Energies of a white field of variance 1 are of order 1; this floor keeps logarithms finite.
_ENERGY_FLOOR = np.float32(1e-3)


def octave_statistics(
    relief: list[FloatMap], albedo: list[FloatMap], weight: FloatMap, orientation_deg: float | None
) -> FloatMap:
    """(h, w, d) float32 statistics of every cell.

    The logarithm of the energy of the gradient in each octave of relief and then of albedo. Models
    of version 1 have its anisotropy in the frame of the texture beside each, as the cosine and sine
    of twice the direction; an `orientation_deg` asks for these.
    """
    rows, columns = (side // HALF_CELL for side in relief[0].shape)
    around = gaussian_mean(resized(weight * weight, rows, columns), _STATISTICS_CELLS)
    around += np.float32(1e-3)

    def mean(energy: FloatMap) -> FloatMap:
        return gaussian_mean(resized(energy, rows, columns), _STATISTICS_CELLS) / around

    values = []
    for number, level in enumerate((*relief[:LEVELS], *albedo[:LEVELS])):
        xx, yy, xy = _gradient_energies(level, HALF_CELL >> number % LEVELS or 1)
        total = mean(xx + yy) + 2 * _ENERGY_FLOOR
        values.append(np.log(total))
        if orientation_deg is not None:
            angle = np.radians(2.0 * orientation_deg)
            c, s = np.float32(np.cos(angle)), np.float32(np.sin(angle))
            even, odd = mean(xx - yy) / total, mean(2 * xy) / total
            values += [c * even + s * odd, c * odd - s * even]
    return np.stack(values, axis=-1)


def _gradient_energies(level: FloatMap, pixels: int) -> FloatMap:
    """(3, h, w) means of x^2, y^2 and x y of the gradient (y up) in squares."""
    rows, columns = (side // pixels for side in level.shape)
    energies = np.empty((3, rows, columns), np.float32)
    run_on_rows(partial(_sum_energies, level, pixels, energies), (rows, level[:pixels].size))
    return energies


@kernel
def _sum_energies(level: Array, pixels: int, energies: Array, first: int, stop: int) -> None:
    """Means of rows of squares; Sobel gradients, which are 0 at the border."""
    rows, columns = level.shape
    sums = np.empty((3, columns), np.float32)
    quarter, two = np.float32(0.25), np.float32(2.0)
    share = np.float32(1.0) / np.float32(pixels * pixels)
    for row in range(first, stop):
        sums[:] = np.float32(0.0)
        xx, yy, xy = sums[0], sums[1], sums[2]
        for r in range(max(row * pixels, 1), min((row + 1) * pixels, rows - 1)):
            above, here, below = level[r - 1], level[r], level[r + 1]
            for c in range(1, columns - 1):
                falling = above[c + 1] - below[c - 1]
                rising = above[c - 1] - below[c + 1]
                x = quarter * (falling - rising + two * (here[c + 1] - here[c - 1]))
                y = quarter * (falling + rising + two * (above[c] - below[c]))
                xx[c] += x * x
                yy[c] += y * y
                xy[c] += x * y
        for index in range(3):
            for column in range(energies.shape[2]):
                total = np.float32(0.0)
                for c in range(column * pixels, (column + 1) * pixels):
                    total += sums[index, c]
                energies[index, row, column] = share * total
