"""Sums along straight lines: the response to scratches."""

from functools import partial

import numpy as np
import numpy.typing as npt

from classify.base.compiling import Array, kernel
from classify.base.threads import run_on_rows
from classify.surface.estimate import FloatMap

DIRECTIONS = 12
"""Directions of lines over 180 degrees, in the frame of the texture."""
LENGTHS = 3
"""Lines have 9, 15 and 21 pixels."""
_MARGIN = 10
# Rows of pixels whose sums of three stay in the cache.
_STRIP = 64


def line_response(
    field: FloatMap, cell: int, orientation_deg: float, weights: FloatMap
) -> FloatMap:
    """(h, w) largest of the absolute sums along lines in every cell, times (DIRECTIONS * LENGTHS,).

    The field is (h cell, w cell), and 0 beyond its borders. Sums of threes of pixels have the
    weights 1 2 1, 1 2 3 2 1 and 1 2 3 3 3 2 1. Directions whose weights are 0 take no time.
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
    # Halves are rounded alike in all quarters, whatever the last digit of a sine.
    nearest = np.rint(steps.round(6)).astype(np.int64)
    return np.moveaxis(nearest, 0, -1)


@kernel
def _sum_lines(
    padded: Array, steps: Array, cell: int, weights: Array, highest: Array, first: int, stop: int
) -> None:
    """Responses of rows of cells: sums of three pixels, then sums of these."""
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
                # Loops of few arrays, which numba must know not to overlap. np.maximum is
                # vectorised, max is not.
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
