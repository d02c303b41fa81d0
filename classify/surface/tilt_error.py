"""The error of the tilts of all lights, from the slopes of a surface."""

import cv2
import numpy as np

from classify.base.arrays import FloatMap

from .estimate import SurfaceEstimate

# Side of the square in the middle that is used; more pixels take more time.
_MIDDLE_PX = 512
# Without it, pixels of fine anisotropic textures scatter by 8 degrees instead of 1.3.
_BLUR_PX = 1.5


def tilt_error_deg(surface: SurfaceEstimate) -> float:
    """Return by how many degrees the given tilts exceed the true ones; 0 for a plane.

    Slopes from tilts that are wrong by d are rotated by d. The slopes of a surface have no curl;
    rotated ones have sin(d) of its Laplacian as curl, and cos(d) as divergence.
    """
    p, q = (_smooth_middle(surface, slopes) for slopes in (surface.p, surface.q))
    divergence = _along_x(p) + _along_y(q)
    curl = _along_x(q) - _along_y(p)
    return float(np.rad2deg(np.arctan2(np.vdot(curl, divergence), np.vdot(divergence, divergence))))


def _smooth_middle(surface: SurfaceEstimate, slopes: FloatMap) -> FloatMap:
    top, left = (max(0, (side - _MIDDLE_PX) // 2) for side in slopes.shape)
    middle = np.s_[top : top + _MIDDLE_PX, left : left + _MIDDLE_PX]
    smooth = np.where(surface.valid[middle], slopes[middle], np.float32(0.0))
    cv2.GaussianBlur(smooth, (0, 0), _BLUR_PX, dst=smooth)
    return smooth


def _along_x(slopes: FloatMap) -> FloatMap:
    return slopes[1:-1, 2:] - slopes[1:-1, :-2]


def _along_y(slopes: FloatMap) -> FloatMap:
    return slopes[:-2, 1:-1] - slopes[2:, 1:-1]  # y is up, rows go down
