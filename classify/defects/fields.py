"""Slopes and log albedo of a part at half resolution, without outliers and gaps."""

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import scipy.fft

from classify.base.compiling import Array, kernel
from classify.base.threads import run_on_rows
from classify.surface.estimate import FloatMap, SurfaceEstimate
from classify.texture.fields import texture_fields

from .defect_map import CELL_PX

HALF_CELL = CELL_PX // 2
# Coarsest pixel of the octave statistics, in pixels at half resolution; the fields are padded to
# multiples of it.
COARSEST = 16
# Pixels at half resolution over which the fields fade to zero towards the frame and large gaps:
# a transform repeats the frame, and a step at its border would look like a scratch. This width and
# the constants of the other files of this folder are tested in tests/evidence/defect_constants.py.
_FADE = 17
# Sigma of the Gaussian that fills gaps. A gap is too large to fill where the Gaussian mean of valid
# pixels is below `_MIN_FILLED_SHARE`.
_FILL_PX = 2.0
_MIN_FILLED_SHARE = np.float32(0.25)
_MIN_VALID_SHARE = np.float32(0.5)
_TINY = np.float32(1e-3)
# A valid pixel as a byte: OpenCV resizes bytes faster. It is divisible by 4, so that means of
# 2 x 2 pixels are exact.
_BYTE = np.uint8(252)


_Plane = FloatMap | npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class PartFields:
    """Slopes and log albedo without their means, at half resolution."""

    # The planes are padded to sides that suit a transform, and fade to 0 at borders and large gaps.
    p: FloatMap
    q: FloatMap
    albedo: FloatMap
    weight: FloatMap  # of the fading, 0 to 1
    # (h, w, 8), without fading: the share of valid pixels in every cell, and its products with the
    # means of p, q, a, p^2, q^2, p q and a^2, where a is the log albedo.
    moments: FloatMap
    valid: npt.NDArray[np.bool_]  # cells with at least half of their pixels valid
    shape: tuple[int, int]  # rows and columns of the frame, px


def part_fields(surface: SurfaceEstimate) -> PartFields:
    """Compute the fields; raises InputError like `texture_fields`."""
    fields = texture_fields(surface)
    rows, columns = (_padded(-(-side // 2)) for side in surface.shape)
    planes = [_halved(plane, rows, columns) for plane in (fields.p, fields.q, fields.albedo)]
    whole, weight = _whole_frame(surface.shape, rows, columns)
    share = whole
    if not surface.valid.all():
        share = _halved(surface.valid * _BYTE, rows, columns) / np.float32(_BYTE)
        blurred_share = gaussian_mean(share, _FILL_PX)
        # `texture_fields` sets invalid pixels to the mean of the frame: subtract their contribution
        # to the means of 2 x 2 pixels.
        gap = np.unravel_index(np.argmin(surface.valid), surface.shape)
        means = (plane[gap] for plane in (fields.p, fields.q, fields.albedo))
        for plane, mean in zip(planes, means, strict=True):
            plane -= (1.0 - share) * mean
        planes = [_filled(plane, share, blurred_share) for plane in planes]
        weight = _faded(blurred_share)
    total = max(float(weight.sum()), 1.0)
    np.log(np.maximum(planes[2], _TINY), out=planes[2])
    h, w = (-(-side // CELL_PX) for side in surface.shape)
    for plane in planes:
        plane -= np.float32(np.vdot(plane, weight) / total)
    moments = _cell_moments(share, *planes)[:h, :w]
    for plane in planes:
        plane *= weight
    valid_shares, covered_shares = (
        resized(shares, rows // HALF_CELL, columns // HALF_CELL)[:h, :w]
        for shares in (share, whole)
    )
    p, q, albedo = planes
    valid = valid_shares >= _MIN_VALID_SHARE * covered_shares
    return PartFields(p, q, albedo, weight, moments, valid, surface.shape)


def resized(plane: _Plane, rows: int, columns: int) -> FloatMap:
    """Resize a plane: means of its pixels if it is finer, else linear interpolation."""
    finer = plane.shape[0] > rows
    method = cv2.INTER_AREA if finer else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(plane, (columns, rows), interpolation=method), np.float32)


def cell_maximum(plane: FloatMap, pixels: int) -> FloatMap:
    """Largest value of every square of `pixels` x `pixels`."""
    highest = cv2.dilate(plane, np.ones((pixels, pixels), np.uint8), anchor=(0, 0))
    # With its anchor at the first pixel, a square reaches to the right and down.
    return np.ascontiguousarray(highest[::pixels, ::pixels])


def gaussian_mean(plane: FloatMap, sigma: float) -> FloatMap:
    """Gaussian mean around every pixel."""
    return np.asarray(cv2.GaussianBlur(plane, (0, 0), sigma), np.float32)


@lru_cache(maxsize=4)
def _whole_frame(shape: tuple[int, int], rows: int, columns: int) -> tuple[FloatMap, FloatMap]:
    """Shares of valid pixels, and weights, of a frame whose pixels are all valid."""
    share = _halved(np.ones(shape, np.float32), rows, columns)
    return share, _faded(share)


def _faded(share: FloatMap) -> FloatMap:
    """Weights that fade to 0 towards the frame and large gaps."""
    eroded = cv2.erode(
        (share > _MIN_FILLED_SHARE).astype(np.float32), np.ones((_FADE, _FADE), np.uint8),
        borderType=cv2.BORDER_CONSTANT, borderValue=0,
    )  # fmt: skip
    faded = cv2.blur(eroded, (_FADE, _FADE), borderType=cv2.BORDER_CONSTANT)
    return np.asarray(faded, np.float32)


def _cell_moments(share: FloatMap, p: FloatMap, q: FloatMap, albedo: FloatMap) -> FloatMap:
    """Sums over the valid pixels of every cell, as of `PartFields.moments`."""
    moments = np.empty((share.shape[0] // HALF_CELL, share.shape[1] // HALF_CELL, 8), np.float32)
    run_on_rows(
        partial(_sum_moments, share, p, q, albedo, moments),
        (len(moments), HALF_CELL * share.shape[1]),
    )
    return moments


@kernel
def _sum_moments(
    share: Array, p: Array, q: Array, albedo: Array, moments: Array, first: int, stop: int
) -> None:
    """Write the moments of rows of cells."""
    columns = share.shape[1]
    sums = np.empty((8, columns), np.float32)
    cell = share.shape[0] // moments.shape[0]
    scale = np.float32(1.0) / np.float32(cell * cell)
    for row in range(first, stop):
        sums[:] = np.float32(0.0)
        for r in range(row * cell, (row + 1) * cell):
            for c in range(columns):
                w, x, y, a = share[r, c], p[r, c], q[r, c], albedo[r, c]
                sums[0, c] += w
                sums[1, c] += w * x
                sums[2, c] += w * y
                sums[3, c] += w * a
                sums[4, c] += w * x * x
                sums[5, c] += w * y * y
                sums[6, c] += w * x * y
                sums[7, c] += w * a * a
        for column in range(moments.shape[1]):
            for index in range(8):
                total = np.float32(0.0)
                for c in range(column * cell, (column + 1) * cell):
                    total += sums[index, c]
                moments[row, column, index] = scale * total


def _padded(side: int) -> int:
    """Next length that is fast to transform and a multiple of `COARSEST`."""
    return COARSEST * int(scipy.fft.next_fast_len(-(-side // COARSEST), real=True))


def _halved(plane: _Plane, rows: int, columns: int) -> FloatMap:
    """Means of 2 x 2 pixels, with zeros beyond the frame."""
    height, width = plane.shape
    if (height, width) != (2 * rows, 2 * columns):
        padded: Any = np.pad(plane, ((0, 2 * rows - height), (0, 2 * columns - width)))
        plane = padded
    return resized(plane, rows, columns)


def _filled(total: FloatMap, share: FloatMap, blurred_share: FloatMap) -> FloatMap:
    """Means of the valid pixels, from sums; gaps by normalized convolution (Knutsson 1993)."""
    gaussian = gaussian_mean(total, _FILL_PX) / np.maximum(blurred_share, _TINY)
    filled: FloatMap = np.where(share > 0.0, total / np.maximum(share, _TINY), gaussian)
    return filled
