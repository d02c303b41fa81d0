"""Sums along straight lines: the response to scratches."""

from functools import partial

import numpy as np
import numpy.typing as npt

from classify.compiling import Array, kernel
from classify.surface.estimate import FloatMap
from classify.threads import run_on_rows

LINE_DIRECTIONS = 12
"""Directions of lines over 180 degrees, in the frame of the texture."""


def line_responses(field: FloatMap, cell: int, pixels: int, orientation_deg: float) -> FloatMap:
    """(LINE_DIRECTIONS, h, w) float32 largest absolute response in every cell.

    The response is the sum over the pixels of a line around a pixel, over the root of their number:
    a white field keeps its variance.

    Parameters
    ----------
    field
        (h cell, w cell) float32; it counts as zero beyond its borders.
    cell
        Pixels on a side of a cell.
    pixels
        Length of a line, an odd multiple of three.
    orientation_deg
        Orientation of the texture, from which the directions count.
    """
    steps = _steps(pixels, orientation_deg)
    padded = np.pad(field, pixels // 2)
    rows, columns = field.shape[0] // cell, field.shape[1] // cell
    highest = np.empty((LINE_DIRECTIONS, rows, columns), np.float32)
    scale = np.float32(pixels**-0.5)
    run_on_rows(partial(_sum_lines, padded, steps, scale, cell, highest), (rows, field[:cell].size))
    return highest


def _steps(pixels: int, orientation_deg: float) -> npt.NDArray[np.int64]:
    """(directions, pixels, 2) rows and columns of the pixels of each line.

    They are the nearest to the points of the line, and count from the corner of the margin.
    """
    reach = pixels // 2
    directions = orientation_deg + np.arange(LINE_DIRECTIONS) * (180.0 / LINE_DIRECTIONS)
    angles = np.radians(directions)[:, None]
    distances = np.arange(-reach, reach + 1)
    steps = np.stack([-distances * np.sin(angles), distances * np.cos(angles)], axis=-1)
    # Halves are rounded alike in all quarters, whatever the last digit of a sine.
    nearest: npt.NDArray[np.int64] = np.rint(steps.round(6)).astype(np.int64)
    return nearest + reach


@kernel
def _sum_lines(
    padded: Array, steps: Array, scale: np.float32, cell: int, highest: Array, first: int, stop: int
) -> None:
    """Responses of rows of cells."""
    directions, pixels, _ = steps.shape
    columns = highest.shape[2] * cell
    line = np.empty(columns, np.float32)
    most = np.empty(columns, np.float32)
    for row in range(first, stop):
        for direction in range(directions):
            most[:] = np.float32(0.0)
            for r in range(row * cell, (row + 1) * cell):
                line[:] = np.float32(0.0)
                # Three pixels at once halve the traffic of the sum.
                for pixel in range(0, pixels, 3):
                    down, right = steps[direction, pixel]
                    a = padded[r + down, right : right + columns]
                    down, right = steps[direction, pixel + 1]
                    b = padded[r + down, right : right + columns]
                    down, right = steps[direction, pixel + 2]
                    d = padded[r + down, right : right + columns]
                    for c in range(columns):
                        line[c] += a[c] + b[c] + d[c]
                for c in range(columns):
                    most[c] = max(most[c], abs(line[c]))
            for column in range(highest.shape[2]):
                value = most[column * cell]
                for c in range(column * cell + 1, (column + 1) * cell):
                    value = max(value, most[c])
                highest[direction, row, column] = value * scale
