"""Statistics of slopes and log albedo in and around each cell: octaves and windows."""

from functools import partial

import cv2
import numpy as np
import numpy.typing as npt
import scipy.fft

from classify.base.compiling import Array, kernel
from classify.base.threads import map_in_threads, run_on_rows
from classify.surface.estimate import FloatMap

from .fields import COARSEST, HALF_CELL, gaussian_mean, resized
from .whitening import HalfSpectrum

_LEVELS = 4
"""Octaves of the local statistics."""
OCTAVE_STATISTICS = 2 * _LEVELS
"""Statistics of a cell: of relief and of albedo."""
assert 2**_LEVELS == COARSEST

# Cells over which local statistics are averaged: standard deviation of the Gaussian.
_STATISTICS_CELLS = 1.5
# Energies of a white field of variance 1 are of order 1; this floor keeps logarithms finite.
_ENERGY_FLOOR = np.float32(1e-3)


def octave_statistics(white: tuple[HalfSpectrum, HalfSpectrum], weight: FloatMap) -> FloatMap:
    """(h, w, OCTAVE_STATISTICS) log energies of the gradient of white fields in each octave."""
    rows, columns = (side // HALF_CELL for side in weight.shape)
    around = gaussian_mean(resized(weight * weight, rows, columns), _STATISTICS_CELLS)
    around += np.float32(1e-3)

    def statistics(spectrum: HalfSpectrum) -> list[FloatMap]:
        level = np.asarray(scipy.fft.irfft2(spectrum, s=weight.shape), np.float32)
        values = []
        for number in range(_LEVELS):
            energy = resized(_gradient_energies(level, HALF_CELL >> number or 1), rows, columns)
            energy = gaussian_mean(energy, _STATISTICS_CELLS) / around
            values.append(np.log(energy + 2 * _ENERGY_FLOOR))
            # Not pyrDown: its pixels are not in the middle of those that they stand for.
            blurred = np.asarray(cv2.GaussianBlur(level, (3, 3), 0), np.float32)
            level = resized(blurred, level.shape[0] // 2, level.shape[1] // 2)
        return values

    relief, albedo = map_in_threads(statistics, white)
    return np.stack(relief + albedo, axis=-1)


def _gradient_energies(level: FloatMap, pixels: int) -> FloatMap:
    """(h, w) means of the squared gradient in squares."""
    rows, columns = (side // pixels for side in level.shape)
    energies = np.empty((rows, columns), np.float32)
    run_on_rows(partial(_sum_energies, level, pixels, energies), (rows, level[:pixels].size))
    return energies


@kernel
def _sum_energies(level: Array, pixels: int, energies: Array, first: int, stop: int) -> None:
    """Means of rows of squares; Sobel gradients, which are 0 at the border."""
    rows, columns = level.shape
    sums = np.empty(columns, np.float32)
    quarter, two = np.float32(0.25), np.float32(2.0)
    share = np.float32(1.0) / np.float32(pixels * pixels)
    for row in range(first, stop):
        sums[:] = np.float32(0.0)
        for r in range(max(row * pixels, 1), min((row + 1) * pixels, rows - 1)):
            above, here, below = level[r - 1], level[r], level[r + 1]
            for c in range(1, columns - 1):
                falling = above[c + 1] - below[c - 1]
                rising = above[c - 1] - below[c + 1]
                x = quarter * (falling - rising + two * (here[c + 1] - here[c - 1]))
                y = quarter * (falling + rising + two * (above[c] - below[c]))
                sums[c] += x * x + y * y
        for column in range(energies.shape[1]):
            total = np.float32(0.0)
            for c in range(column * pixels, (column + 1) * pixels):
                total += sums[c]
            energies[row, column] = share * total


# Sides of the windows in cells.
_WINDOWS = (1, 3)
WINDOW_STATISTICS = 5 * len(_WINDOWS)
"""Number of window statistics of a cell."""
DEVIATIONS = [0, 3]
"""Window statistics that are low where texture is missing: log deviations, smallest window."""

# Cells over which squared distances are averaged: standard deviation of the Gaussian.
_SMOOTHING_CELLS = 1.0
# Least variance of slopes and of log albedo; rounding to 8 bit has a variance of 1e-6.
_LEAST_VARIANCE = np.float32(1e-6)
_LEAST_SHARE = np.float32(1e-3)


def window_statistics(moments: FloatMap, orientation_deg: float) -> FloatMap:
    """(h, w, WINDOW_STATISTICS) statistics around every cell, in the frame of the texture.

    For each window: the log deviation of the slopes, its anisotropy as cosine and sine of twice the
    direction, the log deviation of the log albedo, and its mean.
    """
    angle = np.radians(2.0 * orientation_deg)
    c, s = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    half = np.float32(0.5)
    values: list[Array] = []
    for side in _WINDOWS:
        sums: Array = cv2.blur(moments, (side, side), borderType=cv2.BORDER_CONSTANT)
        means: Array = np.moveaxis(sums / np.maximum(sums[..., :1], _LEAST_SHARE), -1, 0)
        _, p, q, a, pp, qq, pq, aa = means
        xx, yy, xy = pp - p * p, qq - q * q, pq - p * q
        total = np.maximum(xx + yy, _LEAST_VARIANCE)
        even, odd = (xx - yy) / total, (xy + xy) / total
        values += [
            half * np.log(total), c * even + s * odd, c * odd - s * even,
            half * np.log(np.maximum(aa - a * a, _LEAST_VARIANCE)), a,
        ]  # fmt: skip
    return np.stack(values, axis=-1)


def smoothed(squares: FloatMap, valid: npt.NDArray[np.bool_]) -> FloatMap:
    """Gaussian mean of the squared distances of the valid cells around every cell."""
    share = valid.astype(np.float32)
    around = np.maximum(gaussian_mean(share, _SMOOTHING_CELLS), _LEAST_SHARE)
    mean: Array = gaussian_mean(squares * share, _SMOOTHING_CELLS) / around
    return mean


def mean_around(values: FloatMap, valid: npt.NDArray[np.bool_]) -> FloatMap:
    """Mean of the valid ones among a cell and its eight neighbours."""
    share = valid.astype(np.float32)
    sums: Array = cv2.blur(values * share, (3, 3), borderType=cv2.BORDER_CONSTANT)
    around: Array = cv2.blur(share, (3, 3), borderType=cv2.BORDER_CONSTANT)
    return np.asarray(sums / np.maximum(around, _LEAST_SHARE), np.float32)
