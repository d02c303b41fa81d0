"""Interpolation of a periodic surface: cubic B-splines at twice the resolution.

Rotating a surface for a test of orientation must not change its texture. Linear and cubic
interpolation of the pixels do change it (Kylberg and Sintorn 2016). The tile is periodic, so the
two steps before the interpolation are exact and use the Fourier transform: doubling the
resolution, and the B-spline prefilter.
"""

import math

import numpy as np
import numpy.typing as npt
from scipy import fft

from classify.base.arrays import FloatMap
from classify.base.compiling import kernel
from classify.base.threads import run_on_rows, thread_count

# Pixels of one strip of rows: some milliseconds of work, against 10 us for a call of the kernel.
_STRIP_PX = 1 << 14


def spline_coefficients(channels: FloatMap) -> FloatMap:
    """Cubic B-spline coefficients (2H, 2W, C) of periodic images (C, H, W) on a doubled grid.

    The spline passes through the pixels; between them it is within 0.6 % rms of the band-limited
    image at 0.4 cycles/px and within 0.01 % at 0.15.
    """
    count, rows, cols = channels.shape
    # The B-spline's samples (1/6, 4/6, 1/6) have the transform (4 + 2 cos w) / 6; the
    # factor 4 keeps the values as they are when the inverse transform has 4 times the points.
    gain_rows = 2.0 * 6.0 / (4.0 + 2.0 * np.cos(2.0 * np.pi * fft.fftfreq(2 * rows)))
    gain_cols = 2.0 * 6.0 / (4.0 + 2.0 * np.cos(2.0 * np.pi * fft.rfftfreq(2 * cols)))
    coefficients = np.empty((2 * rows, 2 * cols, count), np.float32)
    for index, channel in enumerate(channels):
        padded = _zero_padded(fft.rfft2(channel, workers=thread_count()), rows, cols)
        padded *= gain_rows[:, None].astype(np.float32)
        padded *= gain_cols[None, :].astype(np.float32)
        coefficients[:, :, index] = fft.irfft2(
            padded, s=(2 * rows, 2 * cols), workers=thread_count(), overwrite_x=True
        )
    return coefficients


def _zero_padded(
    spectrum: npt.NDArray[np.complexfloating], rows: int, cols: int
) -> npt.NDArray[np.complexfloating]:
    """Put a half spectrum on a doubled grid, with half of the Nyquist term at either sign."""
    padded = np.zeros((2 * rows, cols + 1), spectrum.dtype)
    width = cols // 2 + 1
    below = (rows + 1) // 2
    padded[:below, :width] = spectrum[:below]
    padded[2 * rows - (rows - below) :, :width] = spectrum[below:]
    if rows % 2 == 0:
        padded[2 * rows - rows // 2, :width] *= 0.5
        padded[rows // 2, :width] = padded[2 * rows - rows // 2, :width]
    if cols % 2 == 0:
        padded[:, cols // 2] *= 0.5
    return padded


def sample_rotated(
    coefficients: FloatMap,
    centre_row: float,
    centre_col: float,
    rotate_deg: float,
    side_px: int,
    magnification: float = 1.0,
) -> FloatMap:
    """Interpolate a rotated square (C, side_px, side_px) from coefficients of a periodic tile."""
    fine_rows, fine_cols, count = coefficients.shape
    angle = math.radians(rotate_deg)
    row = math.fmod(2.0 * centre_row, fine_rows)
    col = math.fmod(2.0 * centre_col, fine_cols)
    step = 2.0 / magnification
    cos, sin = step * math.cos(angle), step * math.sin(angle)
    out = np.empty((count, side_px, side_px), np.float32)
    run_on_rows(
        lambda first, last: _sample(coefficients, row, col, cos, sin, first, last, out),
        (side_px, side_px),
        _STRIP_PX,
    )
    return out


@kernel
def _cubic_weights(t: float) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Weights of the cubic B-spline at 1 + t, t, 1 - t and 2 - t, for 0 <= t < 1."""
    s = 1.0 - t
    first = s * s * s / 6.0
    second = (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0
    third = (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0
    return np.float32(first), np.float32(second), np.float32(third), np.float32(t * t * t / 6.0)


@kernel
def _sample(
    coefficients: FloatMap,
    row0: float,
    col0: float,
    cos: float,
    sin: float,
    first: int,
    last: int,
    out: FloatMap,
) -> None:
    """Interpolate rows `first` to `last`; position and rotation in spline pixels."""
    fine_rows, fine_cols, count = coefficients.shape
    side = out.shape[1]
    half = 0.5 * (side - 1)
    cols = np.empty(4, np.int64)
    sums = np.empty(count, np.float32)
    for r in range(first, last):
        y = half - r
        for c in range(side):
            x = c - half
            row = row0 + sin * x - cos * y  # rows run down: minus y
            col = col0 + cos * x + sin * y
            row_floor = math.floor(row)
            col_floor = math.floor(col)
            row_weights = _cubic_weights(row - row_floor)
            col_weights = _cubic_weights(col - col_floor)
            for j in range(4):
                cols[j] = (int(col_floor) - 1 + j) % fine_cols
            sums[:] = 0.0
            for i in range(4):
                line = coefficients[(int(row_floor) - 1 + i) % fine_rows]
                for j in range(4):
                    weight = row_weights[i] * col_weights[j]
                    for k in range(count):
                        sums[k] += weight * line[cols[j], k]
            for k in range(count):
                out[k, r, c] = sums[k]
