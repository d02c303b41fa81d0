"""Gradient and albedo spectra on a polar grid: what turns with the surface and only with it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import scipy.fft

from .errors import InputError
from .surface import FloatMap, SurfaceEstimate

__all__ = ["ANGLES", "MIN_SEGMENT_PX", "Spectra", "segment_for", "surface_spectra"]

ANGLES = 90
RADII = 28
MIN_SEGMENT_PX = 32
MAX_SEGMENT_PX = 256
# Radii run geometrically between these, so that a coarse and a fine texture get equal shares.
_FIRST_BIN = 2.0
_LAST_NYQUIST = 0.98
# Where two or more lights are in shadow a solver can return any slope; one such pixel outweighs
# a thousand others in a power spectrum unless it is bounded.
_MAX_SLOPE = np.float32(2.0)


@dataclass(frozen=True, eq=False)
class Spectra:
    """Power spectra of one surface, averaged over segments, on a polar grid of half a turn.

    Attributes
    ----------
    gradient
        (R, 90) float32, M = |P|^2 + |Q|^2 in slope^2 per (cycle/px)^2. The cos^2 and sin^2 of the
        direction of differentiation cancel in the sum, so M turns rigidly with the surface; the
        spectrum of an image does not (thesis section 9.4).
    albedo
        (R, 90) float32, A, the same for albedo divided by its mean.
    segment_px
        Side of the segments. It fixes the radii, so only spectra of equal segments compare.
    """

    gradient: FloatMap
    albedo: FloatMap
    segment_px: int

    @property
    def angles_deg(self) -> npt.NDArray[np.float64]:
        """(90,) direction of each column, anticlockwise from +x, [0, 180)."""
        return np.linspace(0.0, 180.0, ANGLES, endpoint=False)

    @property
    def radii_cpp(self) -> npt.NDArray[np.float64]:
        """(R,) frequency of each row, cycles per pixel."""
        return polar_radii_px(self.segment_px) / self.segment_px

    @property
    def polar(self) -> tuple[FloatMap, FloatMap]:
        """1D polar spectra of M and A, (90,) each: integrals over radius (thesis section 6.4)."""
        width = np.gradient(self.radii_cpp).astype(np.float32)[:, None]
        return (self.gradient * width).sum(axis=0), (self.albedo * width).sum(axis=0)

    @property
    def radial(self) -> tuple[FloatMap, FloatMap]:
        """1D radial spectra of M and A, (R,) each: integrals over half a turn."""
        step = np.float32(np.pi / ANGLES)
        return self.gradient.sum(axis=1) * step, self.albedo.sum(axis=1) * step


def segment_for(shape: tuple[int, int]) -> int:
    """Side of the segments for a frame: a power of two, at most half its shorter side.

    Raises
    ------
    InputError
        If the frame is too small to be cut into segments of 32 px that overlap.
    """
    shorter = min(shape)
    if shorter < 2 * MIN_SEGMENT_PX:
        raise InputError(
            f"a frame of {shape[1]} x {shape[0]} px is too small for a texture; "
            f"the shorter side must have at least {2 * MIN_SEGMENT_PX} px"
        )
    return min(MAX_SEGMENT_PX, 1 << ((shorter // 2).bit_length() - 1))


def surface_spectra(surface: SurfaceEstimate, segment_px: int | None = None) -> Spectra:
    """Spectra of a surface by Welch's averaging of overlapping segments.

    The thesis is silent on window, segments and mean: here the segments overlap by half or a
    little more so that they cover the frame, each loses its mean and gets a circular Hann window
    (a square one would stay behind when the surface turns).

    Parameters
    ----------
    surface
        Its valid pixels are used; others count as of mean slope and mean albedo.
    segment_px
        Side of the segments, 32 or more; by default `segment_for` the frame.

    Raises
    ------
    InputError
        If the frame is smaller than a segment, has no valid pixel, or segments are below 32 px.
    """
    side = segment_for(surface.shape) if segment_px is None else segment_px
    if side < MIN_SEGMENT_PX:
        raise InputError(
            f"{side} px segments; a texture needs segments of at least {MIN_SEGMENT_PX} px"
        )
    if min(surface.shape) < side:
        raise InputError(
            f"a frame of {surface.shape[1]} x {surface.shape[0]} px is smaller than the "
            f"{side} px segments of the library; use larger frames"
        )
    if not surface.valid.any():
        raise InputError("no pixel of this surface is valid; check exposure and lights")
    slope = np.empty(surface.shape, dtype=np.complex64)
    slope.real = surface.p
    slope.imag = surface.q
    slope *= _MAX_SLOPE / np.maximum(np.abs(slope), _MAX_SLOPE)
    slope[~surface.valid] = slope[surface.valid].mean()
    mean_albedo = surface.albedo[surface.valid].mean()
    relative_albedo = np.where(surface.valid, surface.albedo / mean_albedo, np.float32(1.0))

    window = _circular_hann(side)
    norm = np.float32(1.0 / np.sum(window.astype(np.float64) ** 2))
    gradient_power = np.zeros((side, side), dtype=np.float32)
    albedo_power = np.zeros((side, side // 2 + 1), dtype=np.float32)
    row_starts, column_starts = (_starts(length, side) for length in surface.shape)
    corners = [(row, column) for row in row_starts for column in column_starts]
    for row, column in corners:
        cut = np.s_[row : row + side, column : column + side]
        gradient_power += _power(scipy.fft.fft2(_windowed(slope[cut], window)))
        albedo_power += _power(scipy.fft.rfft2(_windowed(relative_albedo[cut], window)))
    # |P|^2 + |Q|^2 at k is the mean of |F(p + iq)|^2 at k and -k; the half plane is enough.
    mirrored = np.roll(gradient_power[::-1, ::-1], 1, axis=(0, 1))
    gradient_half = 0.5 * (gradient_power + mirrored)[:, : side // 2 + 1]
    scale = norm / np.float32(len(corners))
    return Spectra(
        gradient=_to_polar(gradient_half * scale, side),
        albedo=_to_polar(albedo_power * scale, side),
        segment_px=side,
    )


def _starts(length: int, side: int) -> list[int]:
    """First pixels of segments that cover `length` evenly and overlap by half or more."""
    count = -(-2 * length // side) - 1
    return [round(i * (length - side) / max(count - 1, 1)) for i in range(count)]


@lru_cache(maxsize=8)
def _circular_hann(side: int) -> FloatMap:
    offset = (np.arange(side) - (side - 1) / 2.0) / (side / 2.0)
    radius = np.hypot(offset[:, None], offset[None, :])
    return np.where(radius < 1.0, 0.5 + 0.5 * np.cos(np.pi * radius), 0.0).astype(np.float32)


def _windowed(segment: npt.NDArray[Any], window: FloatMap) -> npt.NDArray[Any]:
    """Less its weighted mean, so that nothing is left at zero frequency, times the window."""
    windowed: npt.NDArray[Any] = (segment - (segment * window).sum() / window.sum()) * window
    return windowed


def _power(spectrum: npt.NDArray[np.complex64]) -> FloatMap:
    return spectrum.real**2 + spectrum.imag**2


def polar_radii_px(side: int) -> npt.NDArray[np.float64]:
    """(R,) radii of the polar grid in DFT bins of a segment."""
    return np.geomspace(_FIRST_BIN, _LAST_NYQUIST * side / 2.0, RADII)


@lru_cache(maxsize=8)
def _polar_map(side: int) -> tuple[FloatMap, FloatMap]:
    """Column and row in a half-plane spectrum, rows shifted to put zero frequency at side // 2."""
    angles = np.arange(ANGLES) * (np.pi / ANGLES)
    radii = polar_radii_px(side)[:, None]
    u = radii * np.cos(angles)
    v = radii * np.sin(angles)
    # The half plane stores u >= 0: the other half is the same by point symmetry. Rows hold the
    # frequency along the row index, which is -v as y points up.
    flip = np.where(u < 0.0, -1.0, 1.0)
    return (u * flip).astype(np.float32), (side // 2 - v * flip).astype(np.float32)


def _to_polar(half_plane: FloatMap, side: int) -> FloatMap:
    columns, rows = _polar_map(side)
    # Amplitudes, not powers, are interpolated: they bend less between bins.
    shifted = np.sqrt(np.roll(half_plane, side // 2, axis=0))
    # Beyond the last row comes the first: frequencies repeat, and columns never leave the array.
    polar = cv2.remap(shifted, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return (polar**2).astype(np.float32)
