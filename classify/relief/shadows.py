"""Cast shadows of a height field under a distant light, by one horizon sweep."""

import math

import numpy as np
import numpy.typing as npt

from classify.base.arrays import Array, BoolArray, FloatMap
from classify.base.compiling import kernel
from classify.base.errors import InputError
from classify.base.threads import run_on_rows

# A point in shadow lies at least this far below the light's ray: heights are rounded to float32,
# and a plane must not shadow itself.
_TOLERANCE_PX = 1e-3
_NO_HORIZON = -1e30


def cast_shadow(height: FloatMap, direction: npt.ArrayLike) -> BoolArray:
    """(H, W) points of a height in px that the rest of the surface hides from the light.

    x is shadowed if z(x + d) - z(x) > d cot(slant) for some d > 0 along the light's azimuth, by the
    running maximum of z - d cot(slant); `direction` has x right, y up, z > 0 towards the camera.
    """
    light = np.asarray(direction, dtype=np.float64)
    if np.ndim(height) != 2 or light.shape != (3,):
        raise InputError(
            f"cast_shadow takes (rows, columns) heights and one (x, y, z); got "
            f"{np.shape(height)} and {light.shape}"
        )
    if not np.isfinite(light).all() or light[2] <= 0.0:
        raise InputError(
            f"the light has the direction {light.tolist()}; a light casts shadows only from above "
            "the surface: give z > 0"
        )
    # The sweep is written for one case, the light towards the last column and at most 45 degrees
    # off the rows' direction; a transposed or flipped view brings every other light there.
    along_col, along_row, up = light[0], -light[1], light[2]
    view = np.asarray(height, np.float32)
    transpose = abs(along_row) > abs(along_col)
    if transpose:
        view = view.T
        along_col, along_row = along_row, along_col
    flip = along_col < 0
    if flip:
        view = view[:, ::-1]
        along_col = -along_col
    if along_col <= 1e-9 * up:
        return np.zeros(np.shape(height), np.bool_)
    # Rounding makes a tilt of 90 degrees exactly that, in spite of cos(90 degrees) = 6e-17.
    rows_per_col = round(along_row / along_col, 12)
    view = np.ascontiguousarray(view)
    rows, cols = view.shape
    slip = -(cols - 1) * rows_per_col
    first = math.floor(min(0.0, slip))
    lines = math.ceil(rows - 1 + max(0.0, slip)) - first + 2
    horizon, shadow = np.empty((lines, cols), np.float32), np.empty((rows, cols), np.bool_)

    def trace(first_line: int, last_line: int) -> None:
        _horizons(first_line, last_line, view, rows_per_col, up / along_col, first, horizon)

    def compare(first_row: int, last_row: int) -> None:
        _below_horizon(first_row, last_row, view, rows_per_col, first, horizon, shadow)

    run_on_rows(trace, (lines, cols))
    run_on_rows(compare, (rows, cols))
    if flip:
        shadow = shadow[:, ::-1]
    return np.ascontiguousarray(shadow.T if transpose else shadow)


@kernel
def _horizons(
    first_line: int, last_line: int, height: Array, rows_per_col: float, rise_per_col: float,
    first: int, horizon: Array,
) -> None:  # fmt: skip
    """Horizon of a light towards the last column, along lines through the grid.

    Line k crosses column c at row first + k + c rows_per_col.
    """
    rows, cols = height.shape
    for k in range(first_line, last_line):
        above = _NO_HORIZON
        for c in range(cols - 1, -1, -1):
            # The horizon at (k, c) depends on the columns nearer to the light alone.
            horizon[k, c] = above
            row = first + k + c * rows_per_col
            if -1.0 < row < rows:
                upper = math.floor(row)
                share = row - upper
                z0 = height[max(upper, 0), c]
                z1 = height[min(upper + 1, rows - 1), c]
                above = max(above, z0 + share * (z1 - z0))
            above -= rise_per_col


@kernel
def _below_horizon(
    first_row: int, last_row: int, height: Array, rows_per_col: float, first: int,
    horizon: Array, shadow: Array,
) -> None:  # fmt: skip
    """Compare the height with the horizon, interpolated between lines."""
    for r in range(first_row, last_row):
        for c in range(height.shape[1]):
            line = r - c * rows_per_col - first
            k = math.floor(line)
            share = line - k
            ray = horizon[k, c] * (1.0 - share) + horizon[k + 1, c] * share
            shadow[r, c] = ray > height[r, c] + _TOLERANCE_PX
