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
from classify.base.errors import InputError
from classify.base.threads import thread_count

from .resampling import sample_rotated, spline_coefficients

MAX_SIDE_PX = 8192
"""Largest side of a frame or a tile: the spline coefficients of one need 4 GB."""


@dataclass(frozen=True, eq=False)
class SurfacePatch:
    """A piece of surface in front of the camera, one surface pixel per camera pixel."""

    height: FloatMap
    p: FloatMap
    q: FloatMap
    albedo: FloatMap
    plane_px: float | None = None


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
            raise InputError(f"a self.magnification of {self.magnification}; it must be 0.1 to 10")

    @property
    def side_px(self) -> int:
        """Side of the frame with its margins."""
        return self.size_px + 2 * self.margin_px

    def part_coordinates(self) -> tuple[Floats, Floats]:
        """Coordinates on the part of each pixel: R(-rotate) x / magnification + shift."""
        x, y = (at.astype(np.float64) / self.magnification for at in from_centre(self.side_px))
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

    @classmethod
    def from_gradients(
        cls, p: npt.ArrayLike, q: npt.ArrayLike, albedo: npt.ArrayLike, name: str
    ) -> PeriodicSurface:
        """Make a surface whose height is integrated from its gradients (see `periodic_height`)."""
        slope_x, slope_y = np.asarray(p, np.float32), np.asarray(q, np.float32)
        height = periodic_height(slope_x, slope_y)
        return cls(height, slope_x, slope_y, np.asarray(albedo, np.float32), name)

    def band_limited(self) -> PeriodicSurface:
        """Remove the waves that a pixel grid holds only along its diagonals."""
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
        return spline_coefficients(np.stack([self.height, self.p, self.q, self.albedo]))

    def patch(self, view: View) -> SurfacePatch:
        """Cut a square piece at a shifted centre, rotated about that centre.

        patch(x) = tile(R(-rotate) x / magnification + shift), with x measured from the centre of
        the frame. The gradients rotate with the surface: (p', q') = R (p, q).
        """
        rows, cols = self.height.shape
        right, up = view.shift_px
        height, p, q, albedo = sample_rotated(
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
    """Low-pass (rows, cols // 2 + 1): 1 up to 0.40 cycles/px, a raised cosine down to 0 at 0.48.

    The cubic spline is within 0.6 % up to 0.40 (`test_spline_error_between_pixels`).
    """
    frequency = np.hypot(fft.rfftfreq(cols)[None, :], fft.fftfreq(rows)[:, None])
    along = np.clip((frequency - 0.40) / (0.48 - 0.40), 0.0, 1.0)
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * along), np.float32)


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
