"""Solve a frame strip by strip, correct it for near lights, and invalidate dark pixels.

A strip of rows goes through all steps while it is in the cache. `classify.lights.near_light`
derives the formulas for near lights.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from classify.base.arrays import Array, FloatMap
from classify.base.compiling import kernel
from classify.base.threads import STRIP_PX, run_on_rows
from classify.images import ImageStack
from classify.lights.flat_field import DividedStack
from classify.lights.near_light import Shear, coordinates_px
from classify.shadow_rule import MIN_NORMAL_Z, SHADOW_FLOOR, SHADOW_FRACTION

from .problem import Maps, Problem
from .unsolved import LOST

# Limits of the excess of lights out of one plane, times half the diagonal of the frame: the largest
# share of the albedo that the excess can add to an image. Below `_LEAST_EXCESS` it is not
# subtracted, because it changes normals by 0.06 degrees at most. Above it, b . X comes from least
# squares of all lights, which is wrong for pixels in shadow. Above `_LARGE_EXCESS` that error
# exceeds 0.1 degrees, so b . X is computed again from the solution (test_near_light.py).
_LEAST_EXCESS, _LARGE_EXCESS = 1e-3, 3e-3
# Smallest 1 - c . X of a valid pixel; a smaller one is so near to the plane of the lights that its
# slope across that plane is not determined.
_NEAR_PLANE = np.float32(0.05)


@dataclass(frozen=True, eq=False)
class _NearRows:
    """Some rows of a frame under near lights."""

    problem: Problem  # of the whole frame
    shear: Shear  # of the whole frame
    x: FloatMap  # of the columns, px
    y: FloatMap  # of these rows, px
    b_dot_x: FloatMap  # b . X of the rows if the excess is large; else one scratch row, or none
    excess_is_large: bool  # whether the images need `subtract_rest_of_excess`

    @classmethod
    def of(cls, problem: Problem, first: int, height: int) -> Self | None:
        """Rows from `first` on; None for distant lights."""
        if problem.shear is None:
            return None
        rows, columns = problem.shape
        x, y = coordinates_px(problem.shape)
        largest = float(np.abs(problem.shear.excess).max()) * 0.5 * float(np.hypot(rows, columns))
        is_large = largest >= _LARGE_EXCESS
        buffer_rows = 0 if largest < _LEAST_EXCESS else height if is_large else 1
        b_dot_x = np.zeros((buffer_rows, columns), np.float32)
        return cls(problem, problem.shear, x, y[first : first + height], b_dot_x, is_large)

    def subtract_excess(self, stack: ImageStack) -> None:
        """Subtract e_k (b . X) from these rows in place, with b by least squares."""
        if len(self.b_dot_x) > 0:
            gains, shear = self.problem.gains, self.shear
            weights = np.linalg.pinv(self.problem.directions) * gains
            _subtract_excess(
                weights.astype(np.float32), shear.plane, shear.excess / gains, self.x, self.y,
                self.problem.saturation, stack.dark_rows, stack.images, self.b_dot_x,
            )  # fmt: skip

    def subtract_rest_of_excess(self, stack: ImageStack, maps: Maps) -> None:
        """Subtract in place e_k times the change of b . X to the solver's `maps`."""
        _subtract_rest(
            self.shear.plane, self.shear.excess / self.problem.gains, self.x, self.y,
            self.problem.saturation, maps.p, maps.q, maps.albedo, stack.images, self.b_dot_x,
        )  # fmt: skip

    def correct(self, maps: Maps) -> None:
        """Replace b' by b in the maps; slopes that face away become invalid."""
        _undo_shear(self.shear.plane, self.x, self.y, maps.p, maps.q, maps.albedo, maps.valid)


@kernel
def _undo_shear(
    plane: Array, x: Array, y: Array, p: Array, q: Array, albedo: Array, valid: Array
) -> None:
    """Replace b' by b = b' + c (b' . X) / (1 - c . X), at X = (x, y, 0)."""
    cx, cy, cz = plane
    zero, one, least = np.float32(0.0), np.float32(1.0), MIN_NORMAL_Z * MIN_NORMAL_Z
    rows, columns = p.shape
    for r in range(rows):
        for c in range(columns):
            across = one - cx * x[c] - cy * y[r]
            # b' . X in units of b'_z, then b in units of b'_z / across.
            b_dot_x = -(p[r, c] * x[c] + q[r, c] * y[r])
            bx, by, bz = (
                cx * b_dot_x - across * p[r, c],
                cy * b_dot_x - across * q[r, c],
                across + cz * b_dot_x,
            )
            square = bx * bx + by * by + bz * bz
            is_determined = (across > _NEAR_PLANE) & (bz > zero) & (bz * bz > least * square)
            # One quotient for both: divisions take most of the time.
            scale = across * across * (one + p[r, c] * p[r, c] + q[r, c] * q[r, c])
            quotient = one / (bz * scale if is_determined else one)
            slope = -quotient * scale if is_determined else zero
            albedo[r, c] *= np.sqrt(square * quotient * bz) if is_determined else one
            p[r, c] = bx * slope
            q[r, c] = by * slope
            valid[r, c] &= is_determined


@kernel
def _subtract_excess(
    weights: Array, plane: Array, excess: Array, x: Array, y: Array, saturation: np.float32,
    dark: Array, images: Array, b_dot_x: Array,
) -> None:  # fmt: skip
    """Compute b . X by least squares, and subtract `excess` times it from unsaturated pixels."""
    # `weights` (3, N) contain the gains.
    cx, cy, _ = plane
    one = np.float32(1.0)
    lights, rows, columns = images.shape
    for r in range(rows):
        dark_row = dark[min(r, len(dark) - 1)]
        inner = b_dot_x[min(r, len(b_dot_x) - 1)]  # b . X
        inner[:] = np.float32(0.0)
        for k in range(lights):
            wx, wy = weights[0, k], weights[1, k] * y[r]
            for c in range(columns):
                inner[c] += (wx * x[c] + wy) * (images[k, r, c] - dark_row[c])
        for c in range(columns):
            inner[c] /= max(one - cx * x[c] - cy * y[r], _NEAR_PLANE)
        for k in range(lights):
            e = excess[k]
            for c in range(columns):
                raw = images[k, r, c]
                images[k, r, c] = raw - e * inner[c] if raw < saturation else raw


@kernel
def _subtract_rest(
    plane: Array, excess: Array, x: Array, y: Array, saturation: np.float32,
    p: Array, q: Array, albedo: Array, images: Array, b_dot_x: Array,
) -> None:  # fmt: skip
    """Subtract `excess` times the difference of b . X = (b' . X) / (1 - c . X) from `b_dot_x`."""
    cx, cy, _ = plane
    one = np.float32(1.0)
    lights, rows, columns = images.shape
    rest = np.empty(columns, np.float32)
    for r in range(rows):
        for c in range(columns):
            across = max(one - cx * x[c] - cy * y[r], _NEAR_PLANE)
            scale = albedo[r, c] / np.sqrt(one + p[r, c] * p[r, c] + q[r, c] * q[r, c])
            rest[c] = -scale * (p[r, c] * x[c] + q[r, c] * y[r]) / across - b_dot_x[r, c]
        for k in range(lights):
            e = excess[k]
            for c in range(columns):
                raw = images[k, r, c]
                images[k, r, c] = raw - e * rest[c] if raw < saturation else raw


# A light is missing if its value is below the shadow limit, and below the prediction by this many
# standard deviations.
_MISSING = 3.0


def _judge_dark_pixels(
    problem: Problem, stack: ImageStack, maps: Maps, first: int, last: int
) -> None:
    """Invalidate dark pixels at which a light is missing, in rows `first` to `last`."""
    part = maps.rows(first, last)
    if not part.dark_counts.any():
        return
    # The prediction from the other lights is noisy as well: with four lights, the difference has a
    # standard deviation of 2 sigma.
    lights = len(problem.lighting)
    noise = np.float32(_MISSING * problem.sigma * math.sqrt(lights / max(lights - 3, 1)))
    p, q, albedo, valid = part.p.ravel(), part.q.ravel(), part.albedo.ravel(), part.valid.ravel()
    pixels = np.flatnonzero((albedo < problem.dark_albedo) & valid)
    values = stack.values_at(first * problem.shape[1] + pixels) * problem.gains[:, None]
    dark = values.mean(axis=0) < problem.dark_level
    pixels, values = pixels[dark], values[:, dark]
    rho = albedo[pixels]
    normals = np.stack([-p[pixels], -q[pixels], np.ones_like(rho)])
    normals *= rho / np.sqrt(np.square(normals).sum(axis=0))
    predicted = np.maximum(problem.directions @ normals, SHADOW_FLOOR * rho)
    missing = (values <= SHADOW_FRACTION * predicted) & (predicted - values > noise)
    pixels = pixels[missing.any(axis=0)]
    p[pixels] = q[pixels] = 0.0
    valid[pixels] = False
    if part.unlit is not None:
        part.unlit.ravel()[pixels] = LOST


_Solve = Callable[[ImageStack, Maps, int, int], None]


def solve_strips(
    problem: Problem,
    maps: Maps,
    solve: _Solve,
    *,
    from_all_lights: bool = False,
) -> None:
    """Solve a frame by `solve(stack, maps, first, last)`; invalidate dark pixels.

    The maps are corrected for near lights. Methods that fill in do that later, by
    `correct_for_near_lights`.
    """
    rows, solved_rows = problem.shape[0], list[int]()
    # Cached properties are computed here, before the threads start, so that only one computes them.
    problem.dark_albedo, problem.shear  # noqa: B018

    def solve_strip(first: int, last: int) -> None:
        if problem.shear is not None or isinstance(problem.stack, DividedStack):
            solve_copy(problem.stack.rows(first, last), maps.rows(first, last), first)
        else:
            solve(problem.stack, maps, first, last)
            _judge_dark_pixels(problem, problem.stack, maps, first, last)
        solved_rows.append(last - first)
        if problem.on_progress is not None:
            problem.on_progress(sum(solved_rows) / rows)

    def solve_copy(stack: ImageStack, maps: Maps, first: int) -> None:
        """Solve a copy of some rows, which is divided by the flat field and less the excess."""
        height = len(maps.p)
        near = _NearRows.of(problem, first, height)
        if near is not None:
            near.subtract_excess(stack)
        solve(stack, maps, 0, height)
        if near is not None and near.excess_is_large and not from_all_lights:
            near.subtract_rest_of_excess(stack, maps)
            solve(stack, maps, 0, height)
        _judge_dark_pixels(problem, stack, maps, 0, height)
        if near is not None and maps.unlit is None:
            near.correct(maps)

    run_on_rows(solve_strip, problem.shape, 4 * STRIP_PX // len(problem.lighting))


def correct_for_near_lights(problem: Problem, maps: Maps) -> None:
    """Replace the solution b' of distant lights by b if the lights are near."""

    def correct(first: int, last: int) -> None:
        near = _NearRows.of(problem, first, last - first)
        assert near is not None
        near.correct(maps.rows(first, last))

    if problem.shear is not None:
        run_on_rows(correct, problem.shape)
