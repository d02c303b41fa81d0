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


def line_responses(field: FloatMap, cell: int, orientation_deg: float) -> FloatMap:
    """(LENGTHS * DIRECTIONS, h, w) float32 largest absolute response in every cell.

    The weights fall towards the ends of a line: 1 2 1, 1 2 3 2 1 and 1 2 3 3 3 2 1 for threes of
    pixels.

    Parameters
    ----------
    field
        (h cell, w cell) float32; it counts as zero beyond its borders.
    cell
        Pixels on a side of a cell.
    orientation_deg
        Orientation of the texture, from which the directions count.
    """
    rows, columns = (side // cell for side in field.shape)
    highest = np.empty((DIRECTIONS, LENGTHS, rows, columns), np.float32)
    padded = np.pad(field, _MARGIN)
    run_on_rows(
        partial(_sum_lines, padded, _steps(orientation_deg), cell, highest),
        (rows, field[:cell].size),
    )
    return highest.reshape(-1, rows, columns)


def _steps(orientation_deg: float) -> npt.NDArray[np.int64]:
    """(directions, 4, 2) rows and columns to the pixels at a distance of 1, 3, 6 and 9."""
    angles = np.radians(orientation_deg + np.arange(DIRECTIONS) * (180.0 / DIRECTIONS))[:, None]
    steps = np.array([1.0, 3.0, 6.0, 9.0]) * np.stack([-np.sin(angles), np.cos(angles)])
    # Halves are rounded alike in all quarters, whatever the last digit of a sine.
    nearest = np.rint(steps.round(6)).astype(np.int64)
    return np.moveaxis(nearest, 0, -1)


@kernel
def _sum_lines(
    padded: Array, steps: Array, cell: int, highest: Array, first: int, stop: int
) -> None:
    """Responses of rows of cells: sums of three pixels, then sums of these."""
    width = highest.shape[3] * cell
    threes = np.empty((_STRIP + 18, width + 18), np.float32)
    line, pair = np.empty(width, np.float32), np.empty(width, np.float32)
    most = np.empty((3, width), np.float32)
    zero, two, three = np.float32(0.0), np.float32(2.0), np.float32(3.0)
    for top in range(first, stop, _STRIP // cell):
        cells = min(_STRIP // cell, stop - top)
        for direction in range(highest.shape[0]):
            y, x = steps[direction, 0]
            for r in range(cells * cell + 18):
                row = top * cell + r + 1
                a = padded[row - y, 1 - x : 1 - x + threes.shape[1]]
                b = padded[row, 1 : 1 + threes.shape[1]]
                d = padded[row + y, 1 + x : 1 + x + threes.shape[1]]
                out = threes[r]
                for c in range(threes.shape[1]):
                    out[c] = a[c] + b[c] + d[c]
            short, middle, long = most[0], most[1], most[2]
            for index in range(cells):
                most[:] = zero
                for r in range(index * cell + 9, (index + 1) * cell + 9):
                    here = threes[r, 9 : 9 + width]
                    y, x = steps[direction, 1]
                    a, b = (
                        threes[r - y, 9 - x : 9 - x + width],
                        threes[r + y, 9 + x : 9 + x + width],
                    )
                    # Loops of few arrays, which numba must know not to overlap. np.maximum is
                    # vectorised, max is not.
                    for c in range(width):
                        line[c] = here[c] + a[c] + b[c]
                    for c in range(width):
                        short[c] = np.maximum(short[c], abs(line[c] + here[c]))
                    y, x = steps[direction, 2]
                    a, b = (
                        threes[r - y, 9 - x : 9 - x + width],
                        threes[r + y, 9 + x : 9 + x + width],
                    )
                    for c in range(width):
                        pair[c] = a[c] + b[c]
                    for c in range(width):
                        middle[c] = np.maximum(middle[c], abs(two * line[c] + here[c] + pair[c]))
                    y, x = steps[direction, 3]
                    a, b = (
                        threes[r - y, 9 - x : 9 - x + width],
                        threes[r + y, 9 + x : 9 + x + width],
                    )
                    for c in range(width):
                        value = three * line[c] + two * pair[c] + a[c] + b[c]
                        long[c] = np.maximum(long[c], abs(value))
                for number in range(3):
                    for column in range(highest.shape[3]):
                        value = zero
                        for c in range(column * cell, (column + 1) * cell):
                            value = max(value, most[number, c])
                        highest[direction, number, top + index, column] = value
