"""Surfaces for the simulated camera: a periodic relief with albedo, shifted and rotated."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy import fft

from classify.base.arrays import FloatMap, Floats
from classify.base.compiling import kernel
from classify.base.errors import InputError
from classify.base.threads import run_on_rows, thread_count

MAX_SIDE_PX = 8192
"""Largest side of a frame or a tile: the spline coefficients of one need 4 GB."""


@dataclass(frozen=True, eq=False)
class SurfacePatch:
    """A piece of surface in front of the camera, one surface pixel per camera pixel."""

    height: FloatMap
    p: FloatMap
    q: FloatMap
    albedo: FloatMap
    plane_px: float | None = None  # height to which distances of lights refer; None: the mean


@dataclass(frozen=True)
class View:
    """A square frame, and how the part lies below it."""

    size_px: int
    rotate_deg: float = 0.0  # of the part, anticlockwise about the centre of the frame
    shift_px: tuple[float, float] = (0.0, 0.0)  # of that centre over the part, right and up
    margin_px: int = 0  # border around the frame, which casts shadows into it
    magnification: float = 1.0

    def __post_init__(self) -> None:
        if not 1 <= self.size_px <= MAX_SIDE_PX:
            raise InputError(f"a frame of {self.size_px} px; its side must be 1 to {MAX_SIDE_PX}")
        if not 0 <= self.margin_px <= MAX_SIDE_PX:
            raise InputError(f"a margin of {self.margin_px} px; it must be 0 to {MAX_SIDE_PX}")
        if not all(map(math.isfinite, (self.rotate_deg, *self.shift_px))):
            raise InputError("the angle and the shift of a patch must be finite numbers")
        if not 0.1 <= self.magnification <= 10.0:
            raise InputError(f"a magnification of {self.magnification}; it must be 0.1 to 10")

    @property
    def side_px(self) -> int:
        """Side of the frame with its margins."""
        return self.size_px + 2 * self.margin_px

    def part_coordinates(self) -> tuple[Floats, Floats]:
        """Coordinates on the part of each pixel: R(-rotate) x / magnification + shift."""
        x, y = (axis.astype(np.float64) / self.magnification for axis in from_centre(self.side_px))
        cos, sin = math.cos(math.radians(self.rotate_deg)), math.sin(math.radians(self.rotate_deg))
        return cos * x + sin * y + self.shift_px[0], cos * y - sin * x + self.shift_px[1]


def from_centre(side_px: int) -> tuple[FloatMap, FloatMap]:
    """Coordinates of pixels from the centre of the frame: x (1, side) and y (side, 1)."""
    x = np.arange(side_px, dtype=np.float32) - np.float32(0.5 * (side_px - 1))
    return x[None, :], -x[:, None]


class Surface(Protocol):
    """Something that can be put below the camera: a texture or a calibration target."""

    @property
    def relief_px(self) -> float: ...

    def patch(self, view: View) -> SurfacePatch: ...


@dataclass(frozen=True, eq=False)
class PeriodicSurface:
    """One period of a surface that repeats in both directions."""

    height: FloatMap  # (H, W), px towards the camera
    p: FloatMap  # (H, W), dz/dx
    q: FloatMap  # (H, W), dz/dy with y up
    albedo: FloatMap  # (H, W), 1 is white
    name: str

    def __post_init__(self) -> None:
        for field in ("height", "p", "q", "albedo"):
            image = np.array(getattr(self, field), dtype=np.float32, order="C")
            if image.ndim != 2 or not all(2 <= side <= MAX_SIDE_PX for side in image.shape):
                raise InputError(
                    f"surface {self.name}: {field} has shape {image.shape}; give (rows, columns) "
                    f"of 2 to {MAX_SIDE_PX} each"
                )
            if image.shape != np.shape(self.height):
                raise InputError(
                    f"surface {self.name}: {field} has shape {image.shape}, height has "
                    f"{np.shape(self.height)}; they must be equal"
                )
            if not np.isfinite(image).all():
                raise InputError(f"surface {self.name}: {field} has values that are not finite")
            image.flags.writeable = False
            object.__setattr__(self, field, image)
        if self.albedo.min() < 0:
            raise InputError(f"surface {self.name}: an albedo is negative; it lies within 0 to 1")

    @classmethod
    def from_height(
        cls, height: npt.ArrayLike, albedo: npt.ArrayLike, name: str
    ) -> PeriodicSurface:
        """Make a surface whose gradients are the spectral derivatives of its height."""
        heights = np.asarray(height, np.float32)
        p, q = spectral_gradients(heights)
        return cls(heights, p, q, np.asarray(albedo, np.float32), name)

    def band_limited(self) -> PeriodicSurface:
        """Remove the frequencies that a pixel grid holds along its diagonals alone."""
        shape = self.height.shape
        gain = round_band_limit(*shape)
        height, p, q, albedo = (
            fft.irfft2(
                gain * fft.rfft2(image, workers=thread_count()), s=shape, workers=thread_count()
            )
            for image in (self.height, self.p, self.q, self.albedo)
        )
        return PeriodicSurface(height, p, q, np.maximum(albedo, 0.0), self.name)

    @cached_property
    def relief_px(self) -> float:
        """Height of the highest point above the lowest, in pixels."""
        return float(np.ptp(self.height))

    @cached_property
    def _coefficients(self) -> FloatMap:
        """Spline coefficients of height, p, q and albedo, computed once for all patches."""
        return _spline_coefficients(np.stack([self.height, self.p, self.q, self.albedo]))

    def patch(self, view: View) -> SurfacePatch:
        """Cut a square, patch(x) = tile(R(-rotate) x / magnification + shift) about the centre.

        Gradients rotate too, (p', q') = R (p, q).
        """
        rows, cols = self.height.shape
        right, up = view.shift_px
        height, p, q, albedo = _sample_rotated(
            self._coefficients,
            centre_row=0.5 * (view.size_px - 1) + (rows - view.size_px) // 2 - up,
            centre_col=0.5 * (view.size_px - 1) + (cols - view.size_px) // 2 + right,
            rotate_deg=view.rotate_deg,
            side_px=view.side_px,
            magnification=view.magnification,
        )
        height *= np.float32(view.magnification)
        # The spline may overshoot below zero beside a dark edge; a reflectance cannot be negative.
        np.maximum(albedo, 0.0, out=albedo)
        angle = math.radians(view.rotate_deg)
        cos, sin = np.float32(math.cos(angle)), np.float32(math.sin(angle))
        return SurfacePatch(height, cos * p - sin * q, sin * p + cos * q, albedo)


def spectral_gradients(height: FloatMap) -> tuple[FloatMap, FloatMap]:
    """Differentiate a periodic, band-limited height exactly: p and q, both (H, W) float32."""
    rows, cols = height.shape
    spectrum = fft.rfft2(height.astype(np.float64), workers=thread_count())
    along_x, along_y = _derivative_factors(rows, cols)
    p = fft.irfft2(along_x * spectrum, s=(rows, cols), workers=thread_count())
    q = fft.irfft2(along_y * spectrum, s=(rows, cols), workers=thread_count())
    return p.astype(np.float32), q.astype(np.float32)


def periodic_height(p: FloatMap, q: FloatMap) -> FloatMap:
    """Integrate p and q to a periodic height by least squares (Frankot and Chellappa 1988)."""
    rows, cols = p.shape
    along_x, along_y = _derivative_factors(rows, cols)
    power = np.abs(along_x) ** 2 + np.abs(along_y) ** 2
    power[power == 0.0] = np.inf
    spectrum = np.conj(along_x) * fft.rfft2(p.astype(np.float64), workers=thread_count())
    spectrum += np.conj(along_y) * fft.rfft2(q.astype(np.float64), workers=thread_count())
    height = fft.irfft2(spectrum / power, s=(rows, cols), workers=thread_count())
    return np.asarray(height, np.float32)


def round_band_limit(rows: int, cols: int) -> FloatMap:
    """Low-pass filter of the half spectrum, (rows, cols // 2 + 1).

    1 up to 0.40 cycles/px, where the cubic spline is exact to 0.6 %, then a raised cosine down to 0
    at 0.48.
    """
    frequency = np.hypot(fft.rfftfreq(cols)[None, :], fft.fftfreq(rows)[:, None])
    transition = np.clip((frequency - 0.40) / (0.48 - 0.40), 0.0, 1.0)
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * transition), np.float32)


def rms_slope(p: FloatMap, q: FloatMap) -> float:
    """Root mean square of the steepest slope at each point: sqrt(mean(p^2 + q^2))."""
    return float(np.sqrt(np.mean(np.square(p, dtype=np.float64) + np.square(q, dtype=np.float64))))


def _derivative_factors(
    rows: int, cols: int
) -> tuple[npt.NDArray[np.complex128], npt.NDArray[np.complex128]]:
    """Factors of d/dx (1, cols // 2 + 1) and d/dy (rows, 1), y up; 0 at the Nyquist frequency."""
    along_x = 2j * np.pi * fft.rfftfreq(cols)[None, :]
    along_y = -2j * np.pi * fft.fftfreq(rows)[:, None]
    if cols % 2 == 0:
        along_x[0, cols // 2] = 0.0
    if rows % 2 == 0:
        along_y[rows // 2, 0] = 0.0
    return along_x, along_y


# Rotating a surface for a test of orientation must not change its texture. Linear and cubic
# interpolation of the pixels do change it (Kylberg and Sintorn 2016). The tile is periodic, so the
# two steps before the interpolation are exact and use the Fourier transform: doubling the
# resolution, and the B-spline prefilter.

# Number of pixels in a strip of rows: some milliseconds of work, against 10 us to call the kernel.
_STRIP_PX = 1 << 14


def _spline_coefficients(channels: FloatMap) -> FloatMap:
    """Coefficients (2H, 2W, C) of the cubic B-spline through the pixels of periodic (C, H, W).

    Its rms error between the pixels is 0.6 % at 0.4 cycles/px, and 0.01 % at 0.15.
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
    positive = (rows + 1) // 2  # rows of frequencies that are not negative
    padded[:positive, :width] = spectrum[:positive]
    padded[2 * rows - (rows - positive) :, :width] = spectrum[positive:]
    if rows % 2 == 0:
        padded[2 * rows - rows // 2, :width] *= 0.5
        padded[rows // 2, :width] = padded[2 * rows - rows // 2, :width]
    if cols % 2 == 0:
        padded[:, cols // 2] *= 0.5
    return padded


def _sample_rotated(
    coefficients: FloatMap,
    centre_row: float,
    centre_col: float,
    rotate_deg: float,
    side_px: int,
    magnification: float,
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
                spline_row = coefficients[(int(row_floor) - 1 + i) % fine_rows]
                for j in range(4):
                    weight = row_weights[i] * col_weights[j]
                    for k in range(count):
                        sums[k] += weight * spline_row[cols[j], k]
            for k in range(count):
                out[k, r, c] = sums[k]
