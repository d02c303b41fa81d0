"""Local statistics of slopes and log albedo, which another texture changes."""

import cv2
import numpy as np
import numpy.typing as npt

from classify.base.compiling import Array
from classify.surface.estimate import FloatMap

from .fields import gaussian_mean

# Sides of the windows in cells.
_WINDOWS = (1, 3)
WINDOW_STATISTICS = 5 * len(_WINDOWS)
"""Window statistics of a cell."""
LOW = [0, 3]
"""Those that fall in the smallest window where the texture is missing."""

# Cells over which squared distances are averaged: standard deviation of the Gaussian.
_SMOOTHING_CELLS = 1.0
# Least variance of slopes and of log albedo: that of values rounded to 8 bit is 1e-6.
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
