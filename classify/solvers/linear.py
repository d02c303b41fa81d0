"""Least squares and PS3, and the last steps of all solvers of any number of lights.

A kernel goes from raw images to gradients, albedo and validity row by row, while the row is in the
cache. A row is solved in several short loops without branches, which the compiler vectorises.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from classify.compiling import kernel
from classify.lights.algebra import least_squares_weights, three_of_ring
from classify.shadow_rule import (
    MIN_NORMAL_Z,
    MIN_SCALED_Z,
    NO_DROPPED_LIGHT,
    SHADOW_FLOOR,
    SHADOW_FRACTION,
)
from classify.threads import run_on_rows

from .problem import Maps, Problem

# Smallest eigenvalue of L^T L, the square of the smallest singular value of L, that still
# determines a normal; the limit of `algebra`.
_MIN_EIGENVALUE = 1e-6

Array = npt.NDArray[Any]


def solve_least_squares(problem: Problem) -> Maps:
    """Least squares of all lights that are not saturated; three lights or more."""
    weights = least_squares_weights(problem.lighting, "least_squares")
    return _solve(problem, weights, NO_DROPPED_LIGHT)


def solve_three_of_ring(problem: Problem, method: str) -> Maps:
    """One version of PS3: the same three lights of a ring of four at every pixel."""
    return _solve(problem, *three_of_ring(problem.lighting, method))


def _solve(problem: Problem, weights: Array, unused: int) -> Maps:
    """B = weights i at every pixel, without the light `unused`."""
    used = np.arange(len(problem.lighting)) != unused
    floor = problem.noise_floor(weights)
    maps = problem.new_maps(left_out=np.broadcast_to(np.uint8(unused), problem.shape))

    def solve(first: int, last: int) -> None:
        _linear(
            *problem.stack.float_rows(first, last), problem.gains, problem.saturation, floor,
            weights, problem.directions, used, *maps.slope_rows(first, last),
        )  # fmt: skip

    run_on_rows(solve, problem.shape)
    return maps


@kernel
def _linear(
    images: Array, ambient: Array, gains: Array, saturation: np.float32,
    noise_floor: np.float32, weights: Array, directions: Array, used: Array,
    p: Array, q: Array, albedo: Array, valid: Array,
) -> None:  # fmt: skip
    """Solve by b = weights i; `used` (N,) bool says which weights are not zero.

    Lights that are saturated at a pixel are left out there as long as the rest determine the
    normal.
    """
    lights = images.shape[0]
    rows, columns = p.shape
    floors = np.full(columns, noise_floor)
    for r in range(rows):
        dark = ambient[min(r, len(ambient) - 1)]
        # Sums over the lights of one row at a time: the inner loops then run along the pixels.
        bx = np.zeros(columns, np.float32)
        by = np.zeros(columns, np.float32)
        bz = np.zeros(columns, np.float32)
        brightest = np.zeros(columns, np.float32)
        lost = np.zeros(columns, np.float32)
        for k in range(lights):
            if used[k]:
                gain, x, y, z = gains[k], weights[0, k], weights[1, k], weights[2, k]
                for c in range(columns):
                    raw = images[k, r, c]
                    brightest[c] = max(brightest[c], raw)
                    v = (raw - dark[c]) * gain
                    bx[c] += x * v
                    by[c] += y * v
                    bz[c] += z * v
        # A loop over all pixels with this test would not be vectorised.
        for column in np.flatnonzero(brightest >= saturation):
            rest = used.copy()
            for k in range(lights):
                rest[k] &= images[k, r, column] < saturation
            solved, x, y, z = solve_lights(images, dark[column], gains, directions, rest, r, column)
            lost[column] = not solved
            if solved:
                bx[column], by[column], bz[column] = x, y, z
        judge_row(
            images, dark, gains, directions, used, r, bx, by, bz, floors, lost, p, q, albedo, valid
        )


@kernel
def solve_lights(
    images: Array, dark: np.float32, gains: Array, directions: Array, used: Array, r: int, c: int
) -> tuple[bool, np.float32, np.float32, np.float32]:
    """Scaled normal of one pixel by the normal equations of the lights `used`.

    `dark` is its ambient value. The first result is false if the lights do not determine a normal:
    fewer than three, or all in one plane.
    """
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    x, y, z = 0.0, 0.0, 0.0
    for k in range(images.shape[0]):
        if used[k]:
            value = float((images[k, r, c] - dark) * gains[k])
            lx, ly, lz = float(directions[k, 0]), float(directions[k, 1]), float(directions[k, 2])
            xx += lx * lx
            xy += lx * ly
            xz += lx * lz
            yy += ly * ly
            yz += ly * lz
            zz += lz * lz
            x += lx * value
            y += ly * value
            z += lz * value
    # The inverse as adjugate over determinant.
    a00, a01, a02 = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    a11, a12, a22 = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    determinant = xx * a00 + xy * a01 + xz * a02
    # The product of the two larger eigenvalues is at most a quarter of the squared trace.
    trace = xx + yy + zz
    if not determinant > 0.25 * _MIN_EIGENVALUE * trace * trace:
        return False, np.float32(0.0), np.float32(0.0), np.float32(0.0)
    return (
        True,
        np.float32((a00 * x + a01 * y + a02 * z) / determinant),
        np.float32((a01 * x + a11 * y + a12 * z) / determinant),
        np.float32((a02 * x + a12 * y + a22 * z) / determinant),
    )


@kernel
def judge_row(
    images: Array, dark: Array, gains: Array, directions: Array, used: Array, r: int,
    bx: Array, by: Array, bz: Array, floors: Array, lost: Array,
    p: Array, q: Array, albedo: Array, valid: Array,
) -> None:  # fmt: skip
    """Write the maps of row r from its scaled normals; `dark` is its ambient row.

    A slope is valid where bz^2 >= `floors` rho, the pixel is not `lost`, and at least three of the
    lights `used` are out of shadow.
    """
    columns = p.shape[1]
    zero, one = np.float32(0.0), np.float32(1.0)
    for c in range(columns):
        albedo[r, c] = np.sqrt(bx[c] * bx[c] + by[c] * by[c] + bz[c] * bz[c])
    lit = np.zeros(columns, np.float32)
    for k in range(images.shape[0]):
        if used[k]:
            x, y, z = directions[k]
            gain = gains[k]
            for c in range(columns):
                v = images[k, r, c] - dark[c]
                s = x * bx[c] + y * by[c] + z * bz[c]
                limit = SHADOW_FRACTION * max(s, SHADOW_FLOOR * albedo[r, c])
                lit[c] += one if v * gain > limit else zero
    for c in range(columns):
        rho = albedo[r, c]
        visible = (bz[c] > max(MIN_NORMAL_Z * rho, MIN_SCALED_Z)) & (
            bz[c] * bz[c] >= floors[c] * rho
        )
        inverse = -one / bz[c] if visible else zero
        p[r, c] = bx[c] * inverse
        q[r, c] = by[c] * inverse
        valid[r, c] = visible & (lit[c] > np.float32(2.5)) & (lost[c] == zero)
