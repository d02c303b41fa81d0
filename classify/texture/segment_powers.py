"""Power and cross spectra of slopes and albedo, by Welch's method."""

from collections.abc import Sequence
from functools import lru_cache, partial

import cv2
import numpy as np

from classify.base.arrays import Array, FloatMap
from classify.base.compiling import kernel
from classify.base.errors import InputError
from classify.base.threads import map_in_threads

from .fields import TextureFields

_SPECTRA = 6  # sums of `_add_powers`
# Number of partial sums. It is the same on every machine, because the order of additions decides
# the last digits of a sum.
_LANES = 4
# Least number of pixels for threads: less work is done before another thread has started.
_FEW_PX = 1 << 17


def require_segment(shape: tuple[int, ...], side: int) -> None:
    """Check that a frame of `shape` holds a segment of `side` pixels."""
    if min(shape) < side:
        raise InputError(
            f"{shape[1]} x {shape[0]} px are fewer than the {side} px segments of the library; "
            "use a larger frame, or a larger mask"
        )


def segment_powers(fields: TextureFields, side: int) -> FloatMap:
    """Mean powers of segments, (side, 6, side // 2 + 1).

    They are |P|^2 + |Q|^2, |P|^2 - |Q|^2, 2 Re P Q*, |A|^2, Im P A* and Im Q A*, under a round Hann
    window, so that they rotate with the surface.
    """
    require_segment(fields.shape, side)
    rows, columns = (_starts(length, side) for length in fields.shape)
    corners = [(row, column) for row in rows for column in columns]
    pairs = [np.array(corners[first : first + 2]) for first in range(0, len(corners), 2)]
    lanes = [pairs[lane::_LANES] for lane in range(min(_LANES, len(pairs)))]
    window = _circular_hann(side)
    planes = tuple(map(np.ascontiguousarray, (fields.p, fields.q, fields.albedo)))
    summed = partial(_summed_powers, planes, window)
    if len(corners) * side * side < _FEW_PX:
        sums = list(map(summed, lanes))
    else:
        sums = map_in_threads(summed, lanes)
    powers = sums[0]
    for lane in sums[1:]:
        powers += lane
    powers *= np.float32(1.0 / (len(corners) * np.square(window, dtype=np.float64).sum()))
    return powers


def _starts(length: int, side: int) -> list[int]:
    """First pixels of segments that cover `length` evenly and overlap by half or more."""
    last = length - side
    count = -(-2 * length // side) - 1
    # The starts are symmetric. With an odd count one is last / 2, so `last` must be even.
    count += count % 2 * (last % 2)
    first_half = [round(i * last / max(count - 1, 1)) for i in range((count + 1) // 2)]
    return sorted({*first_half, *(last - start for start in first_half)})


@lru_cache(maxsize=8)
def _circular_hann(side: int) -> FloatMap:
    offset = (np.arange(side) - (side - 1) / 2.0) / (side / 2.0)
    radius = np.hypot(offset[:, None], offset[None, :])
    return np.where(radius < 1.0, 0.5 + 0.5 * np.cos(np.pi * radius), 0.0).astype(np.float32)


def _summed_powers(planes: tuple[Array, ...], window: FloatMap, pairs: Sequence[Array]) -> FloatMap:
    """Sum the powers of pairs of segments, all in the same memory.

    Two real planes are transformed as one complex plane: p and q of one segment, or albedo of both.
    """
    side, window_sum = len(window), window.sum()
    sums = np.zeros((side, _SPECTRA, side // 2 + 1), np.float32)
    # Slopes of (segment, row, column, Re and Im); albedo of both segments in one.
    slopes, albedo = np.empty((2, side, side, 2), np.float32), np.empty((side, side, 2), np.float32)
    for corners in pairs:
        _cut(planes, corners, window, window_sum, slopes, albedo)
        for plane in (*slopes[: len(corners)], albedo):
            cv2.dft(plane, plane)
        spectra = slopes[: len(corners)], albedo
        _add_powers(*(parts.view(np.complex64)[..., 0] for parts in spectra), sums)
    return sums


@kernel
def _cut(
    planes: tuple[Array, ...], corners: Array, window: Array, window_sum: np.float32,
    slopes: Array, albedos: Array,
) -> None:  # fmt: skip
    """Cut one segment or two from all fields, subtract their mean, apply the window."""
    p, q, albedo = planes
    for n in range(len(corners)):
        _write_complex(p, corners[n], q, corners[n], window, window_sum, slopes[n])
    _write_complex(albedo, corners[0], albedo, corners[-1], window, window_sum, albedos)
    if len(corners) == 1:
        albedos[:, :, 1] = np.float32(0.0)


@kernel
def _write_complex(
    real: Array, real_corner: Array, imaginary: Array, imaginary_corner: Array,
    window: Array, window_sum: np.float32, segment: Array,
) -> None:  # fmt: skip
    """Write two segments, of one plane or two, as real and imaginary part of one."""
    side = len(window)
    real_mean = _weighted_mean(real, real_corner, window, window_sum)
    imaginary_mean = _weighted_mean(imaginary, imaginary_corner, window, window_sum)
    for r in range(side):
        real_row = _segment_row(real, real_corner, r, side)
        imaginary_row = _segment_row(imaginary, imaginary_corner, r, side)
        # With one index the compiler vectorises, which halves the time.
        flat_row = segment[r].reshape(-1)
        for c in range(side):
            flat_row[2 * c] = (real_row[c] - real_mean) * window[r, c]
            flat_row[2 * c + 1] = (imaginary_row[c] - imaginary_mean) * window[r, c]


@kernel
def _weighted_mean(
    plane: Array, corner: Array, window: Array, window_sum: np.float32
) -> np.float32:
    # One sum per column, which the compiler vectorises without a change of the order of additions.
    side = len(window)
    sums = np.zeros(side, np.float32)
    for r in range(side):
        row = _segment_row(plane, corner, r, side)
        for c in range(side):
            sums[c] += row[c] * window[r, c]
    return np.float32(sums.sum() / window_sum)


@kernel
def _segment_row(plane: Array, corner: Array, r: int, side: int) -> Array:
    first_row, column = corner
    return plane[first_row + r, column : column + side]


@kernel
def _add_powers(slopes: Array, albedo: Array, sums: Array) -> None:
    """Add the powers of one segment or two to the sums."""
    # If C is the transform of x + i y, that of x is X(k) = (C(k) + C*(-k)) / 2 and that of y is
    # Y(k) = (C(k) - C*(-k)) / 2i; and C(k) C(-k) = |X|^2 - |Y|^2 + 2i Re X Y*.
    side = len(albedo)
    columns = side // 2 + 1
    # Re C(k), Im C(k), Re C(-k) and Im C(-k) of a row of wave vectors k.
    slope_parts = np.empty((4, columns), np.float32)
    # The same of albedo, then (segment, Re and Im, column).
    albedo_spectra = np.empty((2, 2, columns), np.float32)
    albedo_parts = albedo_spectra.reshape(4, columns)
    for r in range(side):
        opposite = (side - r) % side
        _read_row_pair(albedo[r], albedo[opposite], albedo_parts)
        _separate(albedo_parts)
        for n in range(len(slopes)):
            _read_row_pair(slopes[n, r], slopes[n, opposite], slope_parts)
            _add_row(slope_parts, albedo_spectra[n], sums[r])


@kernel
def _read_row_pair(row: Array, opposite_row: Array, parts: Array) -> None:
    side = len(row)
    for c in range(side // 2 + 1):
        parts[0, c], parts[1, c] = row[c].real, row[c].imag
    # Column 0 is opposite to itself.
    parts[2, 0], parts[3, 0] = opposite_row[0].real, opposite_row[0].imag
    for c in range(1, side // 2 + 1):
        opposite = opposite_row[side - c]
        parts[2, c], parts[3, c] = opposite.real, opposite.imag


@kernel
def _separate(parts: Array) -> None:
    """Replace C(k) and C(-k) by X(k), of the first segment, and Y(k), of the second."""
    half = np.float32(0.5)
    for c in range(parts.shape[1]):
        re, im, opposite_re, opposite_im = parts[0, c], parts[1, c], parts[2, c], parts[3, c]
        parts[0, c] = half * (re + opposite_re)
        parts[1, c] = half * (im - opposite_im)
        parts[2, c] = half * (im + opposite_im)
        parts[3, c] = half * (opposite_re - re)


@kernel
def _add_row(slopes: Array, albedo: Array, sums: Array) -> None:
    # Arrays with two indices instead of named rows: the compiler cannot know that rows do not
    # overlap, and would not vectorise.
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
