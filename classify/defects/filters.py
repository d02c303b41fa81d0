"""Matched filters of spots and scratches: their responses in every cell.

The matched filter of a defect divides the field by the power spectrum of the texture and by
nothing else that depends on the texture (North 1943). A spot or a scratch of half width s is a
Gaussian, across or all around, so both have one radial filter: exp(-2 (pi s k)^2) in the albedo and
k times that in the slopes. A scratch is then a sum along a line.
"""

from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.fft

from classify.base.compiling import Array, kernel
from classify.base.threads import run_on_rows
from classify.surface.estimate import FloatMap

from .fields import HALF_CELL, cell_maximum
from .whitening import HalfSpectrum, frequencies, low_pass

DIRECTIONS = 12
"""Directions of lines over 180 degrees, in the frame of the texture."""
LENGTHS = 3
"""Number of lengths of a line: 9, 15 and 21 pixels."""
# Half of the longest line: a step of 9 pixels to the centre of a sum of three pixels.
_MARGIN = 10
# Rows of pixels per strip; their sums of three pixels fit in the cache.
_STRIP = 64


def line_response(
    field: FloatMap, cell: int, orientation_deg: float, weights: FloatMap
) -> FloatMap:
    """(h, w) largest absolute sums along lines in the cells of an (h cell, w cell) field.

    The sums are multiplied by weights (DIRECTIONS * LENGTHS,). Directions of weight 0 take no time.
    """
    rows, columns = (side // cell for side in field.shape)
    highest = np.empty((rows, columns), np.float32)
    padded = np.pad(field, _MARGIN)
    run_on_rows(
        partial(
            _sum_lines, padded, _steps(orientation_deg), cell, weights.reshape(-1, LENGTHS), highest
        ),
        (rows, field[:cell].size),
    )
    return highest


def _steps(orientation_deg: float) -> npt.NDArray[np.int64]:
    """(directions, 4, 2) rows and columns to the pixels at a distance of 1, 3, 6 and 9."""
    angles = np.radians(orientation_deg + np.arange(DIRECTIONS) * (180.0 / DIRECTIONS))[:, None]
    steps = np.array([1.0, 3.0, 6.0, 9.0]) * np.stack([-np.sin(angles), np.cos(angles)])
    # Halves are rounded alike in all quadrants, independent of the last digit of a sine.
    nearest = np.rint(steps.round(6)).astype(np.int64)
    return np.moveaxis(nearest, 0, -1)


@kernel
def _sum_lines(
    padded: Array, steps: Array, cell: int, weights: Array, highest: Array, first: int, stop: int
) -> None:
    """Write the responses of rows of cells: sums of three pixels, then weighted sums of these."""
    # The weights of the sums of three fall towards the ends of a line: (1, 2, 1), (1, 2, 3, 2, 1)
    # and (1, 2, 3, 3, 3, 2, 1). `threes` has a margin of 9 pixels for the longest line.
    width = highest.shape[1] * cell
    threes = np.empty((_STRIP + 18, width + 18), np.float32)
    line = np.empty(width, np.float32)
    most = np.empty((_STRIP, width), np.float32)
    zero, two, three = np.float32(0.0), np.float32(2.0), np.float32(3.0)
    for top in range(first, stop, _STRIP // cell):
        rows = min(_STRIP // cell, stop - top) * cell
        most[:] = zero
        for direction in range(len(steps)):
            short, middle, long = weights[direction]
            if max(short, middle, long) == zero:
                continue
            y, x = steps[direction, 0]
            for r in range(rows + 18):
                row = top * cell + r + 1
                a = padded[row - y, 1 - x : 1 - x + threes.shape[1]]
                b = padded[row, 1 : 1 + threes.shape[1]]
                d = padded[row + y, 1 + x : 1 + x + threes.shape[1]]
                out = threes[r]
                for c in range(threes.shape[1]):
                    out[c] = a[c] + b[c] + d[c]
            for r in range(9, rows + 9):
                # Loops over few arrays: to vectorise one, numba must rule out that its arrays
                # overlap. np.maximum is vectorised, max is not.
                here, best = threes[r, 9 : 9 + width], most[r - 9]
                y, x = steps[direction, 1]
                a, b = threes[r - y, 9 - x : 9 - x + width], threes[r + y, 9 + x : 9 + x + width]
                for c in range(width):
                    line[c] = here[c] + a[c] + b[c]
                for c in range(width):
                    best[c] = np.maximum(best[c], short * abs(line[c] + here[c]))
                y, x = steps[direction, 2]
                a, b = threes[r - y, 9 - x : 9 - x + width], threes[r + y, 9 + x : 9 + x + width]
                for c in range(width):
                    pair = a[c] + b[c]
                    best[c] = np.maximum(best[c], middle * abs(two * line[c] + here[c] + pair))
                    line[c] = three * line[c] + two * pair
                y, x = steps[direction, 3]
                a, b = threes[r - y, 9 - x : 9 - x + width], threes[r + y, 9 + x : 9 + x + width]
                for c in range(width):
                    best[c] = np.maximum(best[c], long * abs(line[c] + a[c] + b[c]))
        for r in range(0, rows, cell):
            for column in range(highest.shape[1]):
                value = zero
                for y in range(r, r + cell):
                    for x in range(column * cell, (column + 1) * cell):
                        value = max(value, most[y, x])
                highest[top + r // cell, column] = value


class _Filter(NamedTuple):
    """A matched filter of spots, or of lines."""

    departure: int
    half_width_px: float  # of the defect, in pixels of the frame
    octave: int  # below half resolution
    is_line: bool


_SPOTS, _FINE, _WIDE, ALBEDO = range(4)
"""Departures: spots, fine and wide scratches of the relief; spots and scratches of the albedo."""
# The fine filter of 1 px found more ploughed grooves of 1.5 px on even textures than one of 1.5 px.
FILTERS = (
    *(_Filter(kind, half_px, 1, False) for kind in (_SPOTS, ALBEDO) for half_px in (4, 8, 16)),
    _Filter(_FINE, 1.0, 0, True),
    *(
        _Filter(kind, half_px, 1, True)
        for kind, half_px in ((_WIDE, 2.5), (_WIDE, 4), (ALBEDO, 2.5))
    ),
)
SIZES = tuple(DIRECTIONS * LENGTHS if matched_filter.is_line else 1 for matched_filter in FILTERS)
"""Number of responses of each filter."""

Response = Callable[[FloatMap], FloatMap]
"""Function of weights: (h, w) float32 largest weighted absolute response in every cell."""


def filter_responses(
    spectra: tuple[HalfSpectrum, HalfSpectrum], orientation_deg: float
) -> Iterator[Response]:
    """The `Response` of each filter to relief and albedo, divided by the power of their texture."""
    for matched_filter in FILTERS:
        spectrum = spectra[int(matched_filter.departure == ALBEDO)]
        shape = (spectrum.shape[0], 2 * (spectrum.shape[1] - 1))
        field = _filtered(spectrum, _profile(shape, matched_filter), matched_filter.octave)
        cell = HALF_CELL >> matched_filter.octave
        if matched_filter.is_line:
            yield partial(line_response, field, cell, orientation_deg)
        else:
            yield partial(np.multiply, cell_maximum(np.abs(field), cell))


def _filtered(spectrum: HalfSpectrum, profile: HalfSpectrum, octave: int) -> FloatMap:
    """A filtered field, sampled every 2 ** octave pixels."""
    rows, half = profile.shape
    if octave:
        spectrum = np.concatenate([spectrum[: rows // 2, :half], spectrum[-(rows // 2) :, :half]])
    return np.asarray(scipy.fft.irfft2(spectrum * profile, s=(rows, 2 * (half - 1))), np.float32)


@lru_cache(maxsize=32)
def _profile(shape: tuple[int, int], matched_filter: _Filter) -> HalfSpectrum:
    """The radial filter on the half spectrum of the sampled field."""
    step = 1 << matched_filter.octave
    sampled = (shape[0] // step, shape[1] // step)
    u, v = frequencies(sampled)
    k = np.hypot(u, v)
    profile = np.exp(-2.0 * (np.pi * matched_filter.half_width_px / (2 * step) * k) ** 2)
    if matched_filter.octave:
        profile *= low_pass(k)
    if matched_filter.departure != ALBEDO:
        profile = profile * k
    # Shift the samples to the middle of the pixels that they stand for; rows run down, and v up.
    shift = 0.5 * (step - 1) / step
    return np.asarray(profile * np.exp(2j * np.pi * shift * (u - v)), np.complex64)
