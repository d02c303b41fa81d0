"""Power spectra of gradient and albedo on a polar grid."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from classify.base.arrays import Array, FloatMap, Floats
from classify.base.compiling import kernel
from classify.base.errors import InputError
from classify.surface.estimate import SurfaceEstimate

from .fields import TextureFields, texture_fields
from .segment_powers import segment_powers

# The polar grid of the comparison "Features of textures" in classify/DECISIONS.md.
ANGLES = 90
RADII = 28
MIN_SEGMENT_PX = 32
MAX_SEGMENT_PX = 256
# The first radius in bins, and the last in Nyquist frequencies. Radii between them are geometric,
# so that coarse and fine textures get equal shares. Bins 0 and 1 contain the window's spectrum.
_FIRST_BIN = 2.0
_LAST_NYQUIST = 0.98


@dataclass(frozen=True, eq=False)
class Spectra:
    """Power spectra of a surface, mean of segments, on a polar grid of 180 degrees.

    Rows are radii; the 90 columns are directions in steps of 2 degrees, anticlockwise from +x.

    Attributes
    ----------
    gradient
        (R, 90) float32, M = |P|^2 + |Q|^2 in slope^2 per (cycle/px)^2. The cos^2 and sin^2 of the
        direction of differentiation cancel in the sum, so that M rotates with the surface; the
        spectrum of an image does not (thesis section 9.4).
    albedo
        (R, 90) float32, A, the same for albedo divided by its mean.
    relief
        (R, 90) float32, |cos(theta) P + sin(theta) Q|^2: the part of M whose slopes lie along the
        wave vector, as those of a relief do. The rest of M is curl, which is an error.
    co_spectrum
        (R, 90) float32, real part of height times conjugate albedo, in the units of relief and
        albedo: positive where high places are bright.
    segment_px
        Side of the segments. It fixes the radii: only spectra of equal segments compare.
    """

    gradient: FloatMap
    albedo: FloatMap
    relief: FloatMap
    co_spectrum: FloatMap
    segment_px: int

    @property
    def radii_cpp(self) -> Floats:
        """(R,) frequency of each row, cycles per pixel."""
        return polar_radii_px(self.segment_px) / self.segment_px

    @property
    def polar(self) -> tuple[FloatMap, FloatMap]:
        """1D polar spectra of M and A, (90,): integrals over radius (thesis section 6.4)."""
        width = np.gradient(self.radii_cpp).astype(np.float32)[:, None]
        return (self.gradient * width).sum(axis=0), (self.albedo * width).sum(axis=0)

    @property
    def radial(self) -> tuple[FloatMap, FloatMap]:
        """1D radial spectra of M and A, (R,) each: integrals over 180 degrees."""
        step = np.float32(np.pi / ANGLES)
        return self.gradient.sum(axis=1) * step, self.albedo.sum(axis=1) * step

    @property
    def curl_density(self) -> float:
        """Mean of M - relief, the error of the gradient, over the frequency plane."""
        area = np.square(self.radii_cpp)  # of rings of geometric radii
        return float(((self.gradient - self.relief).mean(axis=1) * area).sum() / area.sum())


def segment_for(shape: tuple[int, int]) -> int:
    """Largest power of two, up to 256 px, that fits twice into the shorter side of a frame."""
    shorter = min(shape)
    if shorter < 2 * MIN_SEGMENT_PX:
        raise InputError(
            f"{shape[1]} x {shape[0]} px are too small for a texture; the frame, or the largest "
            f"square within its mask, must have at least {2 * MIN_SEGMENT_PX} px a side"
        )
    return min(MAX_SEGMENT_PX, 1 << ((shorter // 2).bit_length() - 1))


def surface_spectra(surface: SurfaceEstimate, segment_px: int | None = None) -> Spectra:
    """Spectra of a surface; see `field_spectra`.

    Parameters
    ----------
    surface
        Pixels that are not valid get the mean slope and the mean albedo.
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
    return field_spectra(texture_fields(surface), side)


def field_spectra(fields: TextureFields, segment_px: int) -> Spectra:
    """Spectra of fields, averaged over segments; raises as `segment_powers`."""
    powers = segment_powers(fields, segment_px)
    columns, rows = _polar_map(segment_px)
    amplitudes = _amplitudes(powers, _wave_directions(segment_px))
    # Roots are interpolated, and squared with their sign. The spectrum is periodic along its rows.
    polar = cv2.remap(amplitudes, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    gradient, albedo, relief, co_spectrum = np.ascontiguousarray(
        np.moveaxis(polar * np.abs(polar), 2, 0)
    )
    return Spectra(gradient, albedo, relief, co_spectrum, segment_px=segment_px)


def image_spectrum(image: Array, segment_px: int) -> FloatMap:
    """(R, 90) power spectrum of one image (thesis chapter 6), which depends on its light."""
    mean = float(image.mean())
    if mean <= 0.0:
        raise InputError("the image is black; check exposure and lights")
    values = np.ascontiguousarray(image, np.float32) / np.float32(mean)
    flat = np.zeros_like(values)
    return field_spectra(TextureFields(flat, flat, values), segment_px).albedo


@lru_cache(maxsize=8)
def _wave_directions(side: int) -> FloatMap:
    """(4, side, side // 2 + 1) cos and sin of one and two angles of each wave vector, y up."""
    u = np.fft.rfftfreq(side)[None, :]
    v = -np.fft.fftfreq(side)[:, None]
    radius = np.hypot(u, v)
    radius[0, 0] = 1.0
    cos, sin = u / radius, v / radius
    directions = np.stack([cos, sin, cos * cos - sin * sin, 2.0 * cos * sin])
    return np.asarray(directions, np.float32)


@lru_cache(maxsize=8)
def polar_radii_px(side: int) -> Floats:
    """(R,) radii of the polar grid in DFT bins of a segment."""
    return np.geomspace(_FIRST_BIN, _LAST_NYQUIST * side / 2.0, RADII)


@lru_cache(maxsize=8)
def _polar_map(side: int) -> tuple[FloatMap, FloatMap]:
    """Columns and rows of the polar grid in a half plane; zero frequency at side // 2."""
    angles = np.arange(ANGLES) * (np.pi / ANGLES)
    radii = polar_radii_px(side)[:, None]
    u = radii * np.cos(angles)
    v = radii * np.sin(angles)
    # The half plane stores u >= 0; the other half follows by point symmetry. Row frequencies are
    # -v, because y points up.
    flip = np.where(u < 0.0, -1.0, 1.0)
    return (u * flip).astype(np.float32), (side // 2 - v * flip).astype(np.float32)


@kernel
def _amplitudes(powers: Array, directions: Array) -> Array:
    """(side, side // 2 + 1, 4) roots of M, A, relief and signed co-spectrum."""
    side, _, columns = powers.shape
    amplitudes = np.empty((side, columns, 4), np.float32)
    half, zero = np.float32(0.5), np.float32(0.0)
    for r in range(side):
        target = amplitudes[(r + side // 2) % side].reshape(-1)
        for c in range(columns):
            gradient, difference, product = powers[r, 0, c], powers[r, 1, c], powers[r, 2, c]
            cos, sin = directions[0, r, c], directions[1, r, c]
            cos_2, sin_2 = directions[2, r, c], directions[3, r, c]
            # The slope along the wave vector is cos P + sin Q = i k z, so that z has phase -i.
            relief = half * (gradient + cos_2 * difference + sin_2 * product)
            co_spectrum = cos * powers[r, 4, c] + sin * powers[r, 5, c]
            target[4 * c] = np.sqrt(gradient)
            target[4 * c + 1] = np.sqrt(powers[r, 3, c])
            target[4 * c + 2] = np.sqrt(max(relief, zero))
            target[4 * c + 3] = np.copysign(np.sqrt(abs(co_spectrum)), co_spectrum)
    return amplitudes
