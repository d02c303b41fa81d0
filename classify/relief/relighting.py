"""Images of a solved surface under other lights, cast shadows, and rotated lights."""

import math
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from classify.base.arrays import Array, BoolArray, FloatMap
from classify.base.compiling import kernel
from classify.base.errors import InputError
from classify.base.threads import run_on_rows
from classify.lighting import Lighting
from classify.methods import METHODS
from classify.solvers.solver import photometric_stereo
from classify.surface.estimate import SurfaceEstimate

from .height import integrate_gradients

# A point in shadow lies at least this far below the light's ray: heights are rounded to float32,
# and a plane must not shadow itself.
_TOLERANCE_PX = 1e-3
_NO_HORIZON = -1e30


def cast_shadow(height: FloatMap, direction: npt.ArrayLike) -> BoolArray:
    """(H, W) whether the points of a height in px are in shadow.

    A point x is in shadow if z(x + d) - z(x) > d cot(slant) for a distance d along the azimuth of
    `direction`, which is (x right, y up, z > 0).
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
    # Lines along the light, one row apart in every column, that cover the grid.
    rows_to_last_col = (cols - 1) * rows_per_col
    row_of_line_0 = math.floor(min(0.0, -rows_to_last_col))
    lines = math.ceil(rows - 1 + max(0.0, -rows_to_last_col)) - row_of_line_0 + 2
    horizon, shadow = np.empty((lines, cols), np.float32), np.empty((rows, cols), np.bool_)

    def trace(first_line: int, last_line: int) -> None:
        _horizons(first_line, last_line, view, rows_per_col, up / along_col, row_of_line_0, horizon)

    def compare(first_row: int, last_row: int) -> None:
        _below_horizon(first_row, last_row, view, rows_per_col, row_of_line_0, horizon, shadow)

    run_on_rows(trace, (lines, cols))
    run_on_rows(compare, (rows, cols))
    if flip:
        shadow = shadow[:, ::-1]
    return np.ascontiguousarray(shadow.T if transpose else shadow)


@kernel
def _horizons(
    first_line: int, last_line: int, height: Array, rows_per_col: float, rise_per_col: float,
    row_of_line_0: int, horizon: Array,
) -> None:  # fmt: skip
    """Write the horizon towards the last column on lines k.

    Line k crosses column c at row_of_line_0 + k + c rows_per_col.
    """
    rows, cols = height.shape
    for k in range(first_line, last_line):
        ray = _NO_HORIZON
        for c in range(cols - 1, -1, -1):
            # The horizon at (k, c) depends only on the columns nearer to the light.
            horizon[k, c] = ray
            row = row_of_line_0 + k + c * rows_per_col
            if -1.0 < row < rows:
                upper = math.floor(row)
                share = row - upper
                z0 = height[max(upper, 0), c]
                z1 = height[min(upper + 1, rows - 1), c]
                ray = max(ray, z0 + share * (z1 - z0))
            ray -= rise_per_col


@kernel
def _below_horizon(
    first_row: int, last_row: int, height: Array, rows_per_col: float, row_of_line_0: int,
    horizon: Array, shadow: Array,
) -> None:  # fmt: skip
    """Compare the height with the horizon, interpolated between lines."""
    for r in range(first_row, last_row):
        for c in range(height.shape[1]):
            line = r - c * rows_per_col - row_of_line_0
            k = math.floor(line)
            share = line - k
            ray = horizon[k, c] * (1.0 - share) + horizon[k + 1, c] * share
            shadow[r, c] = ray > height[r, c] + _TOLERANCE_PX


def relight(surface: SurfaceEstimate, lighting: Lighting) -> FloatMap:
    """Images of the surface under any distant lights, without cast shadows.

    Lambert's law, i = intensity rho max(0, n . l): the forward model that `photometric_stereo`
    inverts (Wu's thesis, chapter 9). Pixels that face away from a light are black. There are no
    cast shadows and no highlights.

    Parameters
    ----------
    surface
        Its p, q and albedo are used. Pixels without a slope have p = q = 0 and are shown flat.
    lighting
        One light or more.

    Returns
    -------
    (N, H, W) float32 in the units of the albedo, in the order of the lights.

    Examples
    --------
    >>> from classify import photometric_stereo
    >>> lighting = Lighting.ring(slant_deg=45.0)
    >>> flat = (100 * lighting.directions[:, 2]).astype(np.float32)
    >>> surface = photometric_stereo(np.tile(flat[:, None, None], (1, 2, 2)), lighting)
    >>> above = relight(surface, Lighting.from_angles([0.0], 0.0))
    >>> above.shape, round(float(above[0, 0, 0]), 3)
    ((1, 2, 2), 100.0)
    """
    p, q = surface.p, surface.q
    scaled = surface.albedo / np.sqrt(1.0 + p * p + q * q)
    images = np.empty((len(lighting), *surface.shape), dtype=np.float32)
    for image, (x, y, z), intensity in zip(
        images, lighting.directions.tolist(), lighting.intensities.tolist(), strict=True
    ):
        np.maximum(z - x * p - y * q, 0.0, out=image)
        image *= scaled
        image *= intensity
    return images


_STEPS_BETWEEN_LIGHTS = 4
# Least share of the surface in shadow. With less, noise causes most errors, whatever the
# orientation.
_MIN_SHADOW = 0.01


def under_rotated_lights(surface: SurfaceEstimate) -> Iterator[SurfaceEstimate]:
    """Yield three estimates with the part rotated by quarters of the angle between lights.

    There are none without lighting, by PS3, or with less than 1 % of shadow.
    """
    lighting = surface.lighting
    # PS3 chooses lights by their tilt: rotated, it would choose others.
    if lighting is None or surface.method not in METHODS or surface.method.startswith("ps3"):
        return
    if surface.shadow_mask.mean() < _MIN_SHADOW:
        return
    height = integrate_gradients(surface.p, surface.q)
    step_deg = 360.0 / len(lighting) / _STEPS_BETWEEN_LIGHTS
    for step in range(1, _STEPS_BETWEEN_LIGHTS):
        rotated = Lighting.from_angles(
            list(lighting.tilts_deg - step * step_deg), list(lighting.slants_deg)
        )
        images = relight(surface, rotated)
        for image, direction in zip(images, rotated.directions, strict=True):
            image[cast_shadow(height, direction)] = 0.0
        # The surface contains the noise of its own images; none is added.
        yield photometric_stereo(images, rotated, surface.method)
