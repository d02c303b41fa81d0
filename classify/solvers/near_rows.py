"""Rows under near lights, solved by methods for distant ones.

`classify.lights.near_light` derives the formulas.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from classify.base.arrays import Array, FloatMap
from classify.base.compiling import kernel
from classify.images.stack import ImageStack
from classify.lights.near_light import Shear
from classify.shadow_rule import MIN_NORMAL_Z

from .problem import Maps, Problem

# The excess of lights out of one plane, times half the diagonal of the frame, is the largest share
# of the albedo that it can add to an image. Below the first limit it is not subtracted: it changes
# normals by 0.06 degrees at most. Above it, b . X comes from least squares of all lights, which is
# wrong for pixels in shadow. Above the second limit that would cost them more than 0.1 degrees, so
# b . X is then taken from the solution (test_near_light.py).
_LEAST_EXCESS, _LARGE_EXCESS = 1e-3, 3e-3
# 1 - c . X of a pixel so near to the plane of the lights that its slope across it is not known.
_NEAR_PLANE = np.float32(0.05)


@dataclass(frozen=True, eq=False)
class NearRows:
    """Some rows of a frame under near lights."""

    problem: Problem  # of the whole frame
    shear: Shear  # of the whole frame
    x: FloatMap  # of the columns, px
    y: FloatMap  # of these rows, px
    inner: FloatMap  # b . X of each row if the excess is large; else one row of scratch, or none
    excess_is_large: bool  # whether the images need `subtract_rest_of_excess`

    @classmethod
    def of(cls, problem: Problem, first: int, height: int) -> Self | None:
        """Rows from `first` on; None for distant lights."""
        if problem.shear is None:
            return None
        rows, columns = problem.shape
        x, y = problem.plane_px
        largest = float(np.abs(problem.shear.excess).max()) * 0.5 * float(np.hypot(rows, columns))
        is_large = largest >= _LARGE_EXCESS
        rows_kept = 0 if largest < _LEAST_EXCESS else height if is_large else 1
        inner = np.zeros((rows_kept, columns), np.float32)
        return cls(problem, problem.shear, x, y[first : first + height], inner, is_large)

    def subtract_excess(self, stack: ImageStack) -> None:
        """Subtract e_k (b . X) from these rows in place, with b by least squares."""
        if len(self.inner) > 0:
            gains, shear = self.problem.gains, self.shear
            weights = np.linalg.pinv(self.problem.directions) * gains
            _subtract_excess(
                weights.astype(np.float32), shear.plane, shear.excess / gains, self.x, self.y,
                self.problem.saturation, stack.dark_rows, stack.images, self.inner,
            )  # fmt: skip

    def subtract_rest_of_excess(self, stack: ImageStack, maps: Maps) -> None:
        """Subtract in place e_k times the change of b . X to the solver's `maps`."""
        _subtract_rest(
            self.shear.plane, self.shear.excess / self.problem.gains, self.x, self.y,
            self.problem.saturation, maps.p, maps.q, maps.albedo, stack.images, self.inner,
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
            # b, in units of b'_z / across.
            inner = -(p[r, c] * x[c] + q[r, c] * y[r])
            bx, by, bz = (
                cx * inner - across * p[r, c],
                cy * inner - across * q[r, c],
                across + cz * inner,
            )
            square = bx * bx + by * by + bz * bz
            known = (across > _NEAR_PLANE) & (bz > zero) & (bz * bz > least * square)
            # One quotient for both: divisions take most of the time.
            scale = across * across * (one + p[r, c] * p[r, c] + q[r, c] * q[r, c])
            quotient = one / (bz * scale if known else one)
            slope = -quotient * scale if known else zero
            albedo[r, c] *= np.sqrt(square * quotient * bz) if known else one
            p[r, c] = bx * slope
            q[r, c] = by * slope
            valid[r, c] &= known


@kernel
def _subtract_excess(
    weights: Array, plane: Array, excess: Array, x: Array, y: Array, saturation: np.float32,
    dark: Array, images: Array, inner: Array,
) -> None:  # fmt: skip
    """Find b . X by least squares, and subtract `excess` times it from the images.

    b' = weights i; `weights` (3, N) contain the gains. Values of `saturation` are kept.
    """
    cx, cy, _ = plane
    one = np.float32(1.0)
    lights, rows, columns = images.shape
    along = np.empty(columns, np.float32)
    for r in range(rows):
        dark_row = dark[min(r, len(dark) - 1)]
        along[:] = np.float32(0.0)
        for k in range(lights):
            wx, wy = weights[0, k], weights[1, k] * y[r]
            for c in range(columns):
                along[c] += (wx * x[c] + wy) * (images[k, r, c] - dark_row[c])
        for c in range(columns):
            along[c] /= max(one - cx * x[c] - cy * y[r], _NEAR_PLANE)
        for k in range(lights):
            e = excess[k]
            for c in range(columns):
                raw = images[k, r, c]
                images[k, r, c] = raw - e * along[c] if raw < saturation else raw
        inner[min(r, len(inner) - 1)] = along


@kernel
def _subtract_rest(
    plane: Array, excess: Array, x: Array, y: Array, saturation: np.float32,
    p: Array, q: Array, albedo: Array, images: Array, inner: Array,
) -> None:  # fmt: skip
    """Subtract `excess` times the difference of b . X = (b' . X) / (1 - c . X) from `inner`."""
    cx, cy, _ = plane
    one = np.float32(1.0)
    lights, rows, columns = images.shape
    rest = np.empty(columns, np.float32)
    for r in range(rows):
        for c in range(columns):
            across = max(one - cx * x[c] - cy * y[r], _NEAR_PLANE)
            scale = albedo[r, c] / np.sqrt(one + p[r, c] * p[r, c] + q[r, c] * q[r, c])
            rest[c] = -scale * (p[r, c] * x[c] + q[r, c] * y[r]) / across - inner[r, c]
        for k in range(lights):
            e = excess[k]
            for c in range(columns):
                raw = images[k, r, c]
                images[k, r, c] = raw - e * rest[c] if raw < saturation else raw
