"""Least squares and PS3, and how solvers of any number of lights end a row.

A kernel goes from raw images to gradients, albedo and validity row by row, while the row is in the
cache. A row is done in several short loops: each is branch-free, so that the compiler makes it
eight pixels wide, and short enough that the processor has two rounds of it in hand at once.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from classify.compiling import FAST
from classify.shadow_rule import MIN_NORMAL_Z, SHADOW_FLOOR, SHADOW_FRACTION

__all__ = ["judge_row", "linear", "solve_lights"]

# Smallest eigenvalue of L^T L, the square of the smallest singular value of L, that still
# determines a normal.
_MIN_EIGENVALUE = 1e-6

Array = npt.NDArray[Any]


@njit(parallel=True, fastmath=FAST, cache=True, error_model="numpy")
def linear(
    images: Array, ambient: Array | None, gains: Array, saturation: np.float32,
    noise_floor: np.float32, weights: Array, directions: Array, used: Array,
    p: Array, q: Array, albedo: Array, valid: Array,
) -> None:  # fmt: skip
    """Any number of lights by b = weights i: least squares, or three chosen beforehand.

    `used` (N,) bool says which lights the weights count. Lights that are saturated at a pixel are
    left out there as long as the rest determine the normal.
    """
    lights = images.shape[0]
    rows, columns = p.shape
    for r in prange(rows):
        # Sums over the lights of one row at a time: the inner loops then run along the pixels.
        bx = np.zeros(columns, np.float32)
        by = np.zeros(columns, np.float32)
        bz = np.zeros(columns, np.float32)
        brightest = np.zeros(columns, np.float32)
        floors = np.full(columns, noise_floor)
        lost = np.zeros(columns, np.float32)
        for k in range(lights):
            if used[k]:
                for c in range(columns):
                    v = np.float32(images[k, r, c])
                    brightest[c] = max(brightest[c], v)
                    if ambient is not None:
                        v -= np.float32(ambient[r, c])
                    v *= gains[k]
                    bx[c] += weights[0, k] * v
                    by[c] += weights[1, k] * v
                    bz[c] += weights[2, k] * v
        for c in range(columns):
            if brightest[c] >= saturation:
                rest = used.copy()
                for k in range(lights):
                    rest[k] &= np.float32(images[k, r, c]) < saturation
                solved, x, y, z = solve_lights(images, ambient, gains, directions, rest, r, c)
                lost[c] = not solved
                if solved:
                    bx[c], by[c], bz[c] = x, y, z
        judge_row(
            images, ambient, gains, directions, used, r, bx, by, bz, floors, lost,
            p, q, albedo, valid,
        )  # fmt: skip


@njit(fastmath=FAST, cache=True, error_model="numpy")
def solve_lights(
    images: Array, ambient: Array | None, gains: Array, directions: Array, used: Array,
    r: int, c: int,
) -> tuple[bool, np.float32, np.float32, np.float32]:  # fmt: skip
    """Scaled normal of one pixel by the normal equations of some of its lights.

    The first value is false where these do not determine it: fewer than three, or in one plane.
    """
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    x, y, z = 0.0, 0.0, 0.0
    for k in range(images.shape[0]):
        if used[k]:
            v = np.float32(images[k, r, c])
            if ambient is not None:
                v -= np.float32(ambient[r, c])
            value = float(v * gains[k])
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


@njit(fastmath=FAST, cache=True, error_model="numpy")
def judge_row(
    images: Array, ambient: Array | None, gains: Array, directions: Array, used: Array, r: int,
    bx: Array, by: Array, bz: Array, floors: Array, lost: Array,
    p: Array, q: Array, albedo: Array, valid: Array,
) -> None:  # fmt: skip
    """Write the maps of a row from its scaled normals.

    A slope is known where bz^2 >= `floors` rho, the pixel is not `lost`, and at least three of the
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
                v = np.float32(images[k, r, c])
                if ambient is not None:
                    v -= np.float32(ambient[r, c])
                s = x * bx[c] + y * by[c] + z * bz[c]
                limit = SHADOW_FRACTION * max(s, SHADOW_FLOOR * albedo[r, c])
                lit[c] += one if v * gain > limit else zero
    for c in range(columns):
        rho = albedo[r, c]
        visible = (bz[c] > MIN_NORMAL_Z * rho) & (bz[c] * bz[c] >= floors[c] * rho)
        inverse = -one / bz[c] if visible else zero
        p[r, c] = bx[c] * inverse
        q[r, c] = by[c] * inverse
        valid[r, c] = visible & (lit[c] > np.float32(2.5)) & (lost[c] == zero)
