"""Gradient and albedo spectra on a polar grid: what turns with the surface and only with it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import scipy.fft
from numba import get_num_threads, njit, prange

from .errors import InputError
from .kernels import FAST
from .surface import FloatMap, SurfaceEstimate
from .texture_fields import TextureFields, texture_fields

__all__ = [
    "ANGLES",
    "MAX_SEGMENT_PX",
    "MIN_SEGMENT_PX",
    "RADII",
    "Spectra",
    "field_spectra",
    "image_spectrum",
    "polar_radii_px",
    "segment_for",
    "surface_spectra",
]

ANGLES = 90
RADII = 28
MIN_SEGMENT_PX = 32
MAX_SEGMENT_PX = 256
# Radii run geometrically between these, so that a coarse and a fine texture get equal shares.
_FIRST_BIN = 2.0
_LAST_NYQUIST = 0.98
_FIELDS = 3  # p, q, albedo
# So many transforms are done before threads have started.
_FEW = 8

Array = npt.NDArray[Any]


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
    relief
        (R, 90) float32, |cos(theta) P + sin(theta) Q|^2: the part of M whose slopes lie along the
        wave vector, as those of a relief do. The rest of M is curl, which no relief has: error.
    co_spectrum
        (R, 90) float32, real part of relief times conjugate albedo: positive where what is high
        is bright. A wave's relief counts as its slope turned a quarter wave back.
    segment_px
        Side of the segments. It fixes the radii, so only spectra of equal segments compare.
    """

    gradient: FloatMap
    albedo: FloatMap
    relief: FloatMap
    co_spectrum: FloatMap
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

    @property
    def curl_density(self) -> float:
        """Mean of M less relief over the plane, in units of M: how large the errors are."""
        area = np.square(self.radii_cpp)  # of rings whose radii are geometric
        return float(((self.gradient - self.relief).mean(axis=1) * area).sum() / area.sum())


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
    """Spectra of a surface; see `field_spectra`.

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
    _check_side(side, surface.shape)
    return field_spectra(texture_fields(surface), side)


def field_spectra(fields: TextureFields, segment_px: int) -> Spectra:
    """Spectra by Welch's averaging of overlapping segments.

    The thesis is silent on window, segments and mean: here the segments overlap by half or a
    little more so that they cover the frame, each loses its mean and gets a circular Hann window
    (a square one would stay behind when the surface turns).

    Raises
    ------
    InputError
        If the frame is smaller than a segment.
    """
    side = segment_px
    _check_side(side, fields.shape)
    row_starts, column_starts = (_starts(length, side) for length in fields.shape)
    sums = np.zeros((side, 6, side // 2 + 1), np.float32)
    window = _circular_hann(side)
    starts, weight = np.array(column_starts), float(window.sum(dtype=np.float64))
    # Two real fields are one complex one, whose transform costs little more than that of one: p and
    # q of a segment, then albedos of two segments. So neither leaves its rounding in the other.
    packed = np.zeros((len(starts) + (len(starts) + 1) // 2, side, side, 2), np.float32)
    transforms = np.empty_like(packed)
    with ThreadPoolExecutor(get_num_threads()) as threads:
        for row in row_starts:
            # One row of segments at a time: enough work for all cores, little memory.
            cut = np.s_[row : row + side]
            strips = tuple(
                map(np.ascontiguousarray, (fields.p[cut], fields.q[cut], fields.albedo[cut]))
            )
            _cut(strips, starts, window, weight, packed)
            at_once = threads.map if len(packed) > _FEW else map
            for _ in at_once(cv2.dft, packed, transforms):
                pass
            _accumulate(transforms, len(starts), sums)
    norm = 1.0 / (len(row_starts) * len(column_starts) * np.sum(np.square(window, dtype=float)))
    gradient, difference, product, albedo, with_p, with_q = np.moveaxis(
        sums * np.float32(norm), 1, 0
    )
    cos, sin, cos_2, sin_2 = _wave_directions(side)
    # Along its wave vector the slope is cos P + sin Q, and i k z: z lies along -i slope.
    relief = np.float32(0.5) * (gradient + cos_2 * difference + sin_2 * product)
    relief = np.maximum(relief, np.float32(0.0))
    planes = np.stack([gradient, albedo, relief, cos * with_p + sin * with_q], axis=2)
    gradient, albedo, relief, co_spectrum = _to_polar(planes, side)
    return Spectra(gradient, albedo, relief, co_spectrum, segment_px=side)


def image_spectrum(image: npt.NDArray[Any], segment_px: int) -> FloatMap:
    """(R, 90) float32 power spectrum of one image divided by its mean, on the same polar grid.

    It carries cos^2(theta - tilt) of the light it was taken under, and so does not turn with the
    surface: what chapter 6 of the thesis begins with, and chapters 7 to 9 improve on.

    Raises
    ------
    InputError
        If the image is smaller than a segment, or black.
    """
    _check_side(segment_px, image.shape)
    mean = float(image.mean())
    if mean <= 0.0:
        raise InputError("the image is black; check exposure and lights")
    values = np.ascontiguousarray(image, np.float32) / np.float32(mean)
    flat = np.zeros_like(values)
    return field_spectra(TextureFields(flat, flat, values), segment_px).albedo


def _check_side(side: int, shape: tuple[int, ...]) -> None:
    if min(shape) < side:
        raise InputError(
            f"a frame of {shape[1]} x {shape[0]} px is smaller than the "
            f"{side} px segments of the library; use larger frames"
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


@lru_cache(maxsize=8)
def _wave_directions(side: int) -> FloatMap:
    """(4, side, side // 2 + 1) cos and sin of the direction of each wave vector, and of twice it.

    y up; 0 at zero frequency, which has none.
    """
    u = scipy.fft.rfftfreq(side)[None, :]
    v = -scipy.fft.fftfreq(side)[:, None]
    radius = np.hypot(u, v)
    radius[0, 0] = 1.0
    cos, sin = u / radius, v / radius
    directions: FloatMap = np.stack([cos, sin, cos * cos - sin * sin, 2.0 * cos * sin]).astype(
        np.float32
    )
    return directions


@njit(parallel=True, fastmath=FAST, cache=True, error_model="numpy")
def _cut(
    strips: tuple[Array, ...], starts: Array, window: Array, weight: float, packed: Array
) -> None:
    """Fields of segments, each less its weighted mean, times the window, two to an array."""
    side = window.shape[0]
    count = len(starts)
    means = np.empty((_FIELDS, count), np.float32)
    for k in prange(count * _FIELDS):
        n, field = k // _FIELDS, k % _FIELDS
        strip, start = strips[field], starts[n]
        # Sums of columns: these can be done eight at a time in the order they are written.
        sums = np.zeros(side, np.float32)
        for r in range(side):
            line = strip[r, start : start + side]
            for c in range(side):
                sums[c] += line[c] * window[r, c]
        means[field, n] = sums.sum() / weight
    p, q, albedo = strips
    for r in prange(side):
        for n in range(count):
            part = slice(starts[n], starts[n] + side)
            _pair(p[r, part], q[r, part], means[0, n], means[1, n], window[r], packed[n, r])
        for n in range(0, count - 1, 2):
            here, next_ = starts[n], starts[n + 1]
            _pair(
                albedo[r, here : here + side], albedo[r, next_ : next_ + side],
                means[2, n], means[2, n + 1], window[r], packed[count + n // 2, r],
            )  # fmt: skip
        if count % 2:
            # The last one is alone: the imaginary part stays zero.
            target, line, mean = packed[-1, r], albedo[r, starts[-1] :], means[2, -1]
            for c in range(side):
                target[c, 0] = (line[c] - mean) * window[r, c]


@njit(fastmath=FAST, cache=True, error_model="numpy")
def _pair(
    real: Array, imaginary: Array, real_mean: np.float32, imaginary_mean: np.float32,
    window: Array, target: Array,
) -> None:  # fmt: skip
    for c in range(len(window)):
        target[c, 0] = (real[c] - real_mean) * window[c]
        target[c, 1] = (imaginary[c] - imaginary_mean) * window[c]


@njit(parallel=True, fastmath=FAST, cache=True, error_model="numpy")
def _accumulate(transforms: Array, count: int, sums: Array) -> None:
    """Add |P|^2 + |Q|^2, |P|^2 - |Q|^2, 2 Re P Q*, |A|^2, Im P A* and Im Q A* of all segments.

    Of C, the transform of x + i y, that of x is X(k) = (C(k) + C*(-k)) / 2 and that of y is
    Y(k) = (C(k) - C*(-k)) / 2i; and C(k) C(-k) = |X|^2 - |Y|^2 + 2i Re X Y*.
    """
    side = transforms.shape[1]
    columns = side // 2 + 1
    for r in prange(side):
        opposite = (side - r) % side
        # Lines of real and imaginary parts at k, then at -k.
        slopes, albedos = np.empty((4, columns), np.float32), np.empty((2, 2, columns), np.float32)
        pair = albedos.reshape(4, columns)
        for n in range(count):
            _untwine(transforms[n, r], transforms[n, opposite], slopes)
            if n % 2 == 0:
                number = count + n // 2
                _untwine(transforms[number, r], transforms[number, opposite], pair)
                _separate(pair)
            _add_powers(slopes, albedos[n % 2], sums[r])


@njit(fastmath=FAST, cache=True, error_model="numpy")
def _untwine(here: Array, there: Array, parts: Array) -> None:
    side = len(here)
    for c in range(side // 2 + 1):
        parts[0, c] = here[c, 0]
        parts[1, c] = here[c, 1]
    # The column opposite to the first is the first itself.
    parts[2, 0], parts[3, 0] = there[0, 0], there[0, 1]
    for c in range(1, side // 2 + 1):
        parts[2, c] = there[side - c, 0]
        parts[3, c] = there[side - c, 1]


@njit(fastmath=FAST, cache=True, error_model="numpy")
def _separate(parts: Array) -> None:
    """Of C(k) and C(-k) make X(k) and Y(k)."""
    half = np.float32(0.5)
    for c in range(parts.shape[1]):
        re, im, opposite_re, opposite_im = parts[0, c], parts[1, c], parts[2, c], parts[3, c]
        parts[0, c] = half * (re + opposite_re)
        parts[1, c] = half * (im - opposite_im)
        parts[2, c] = half * (im + opposite_im)
        parts[3, c] = half * (opposite_re - re)


@njit(fastmath=FAST, cache=True, error_model="numpy")
def _add_powers(slopes: Array, albedo: Array, sums: Array) -> None:
    # Arrays with two indices, not lines of them by name: of these the compiler would not know
    # that they lie apart, and do one number at a time.
    half = np.float32(0.5)
    for c in range(slopes.shape[1]):
        re, im, opposite_re, opposite_im = slopes[0, c], slopes[1, c], slopes[2, c], slopes[3, c]
        sums[0, c] += half * (
            (re * re + im * im) + (opposite_re * opposite_re + opposite_im * opposite_im)
        )
        sums[1, c] += re * opposite_re - im * opposite_im
        sums[2, c] += re * opposite_im + im * opposite_re
    for c in range(slopes.shape[1]):
        re, im, opposite_re, opposite_im = slopes[0, c], slopes[1, c], slopes[2, c], slopes[3, c]
        a_re, a_im = albedo[0, c], albedo[1, c]
        p_re, p_im = half * (re + opposite_re), half * (im - opposite_im)
        q_re, q_im = half * (im + opposite_im), half * (opposite_re - re)
        sums[3, c] += a_re * a_re + a_im * a_im
        sums[4, c] += p_im * a_re - p_re * a_im
        sums[5, c] += q_im * a_re - q_re * a_im


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


def _to_polar(half_planes: FloatMap, side: int) -> FloatMap:
    """(4, R, 90) float32 of (side, side // 2 + 1, 4) float32."""
    columns, rows = _polar_map(side)
    # Amplitudes, not powers, are interpolated: they bend less between bins. With its sign, the
    # co-spectrum stays within the root of both powers (Cauchy and Schwarz).
    amplitudes = np.copysign(np.sqrt(np.abs(half_planes)), half_planes)
    shifted = np.roll(amplitudes, side // 2, axis=0)
    # Beyond the last row comes the first: frequencies repeat, and columns never leave the array.
    polar = cv2.remap(shifted, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.ascontiguousarray(np.moveaxis(polar * np.abs(polar), 2, 0), np.float32)
