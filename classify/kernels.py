"""The per-pixel solvers: one pass from raw images to gradients, albedo and masks.

Each kernel reads a pixel once and writes every map of it once, because at four images in and
seven maps out the memory bus, not the arithmetic, is what there is to save.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit, prange

__all__ = [
    "FAST",
    "MIN_NORMAL_Z",
    "NOT_VALID",
    "NO_DROPPED_LIGHT",
    "REPAIRED",
    "SATURATED",
    "SHADOW_FLOOR",
    "SHADOW_FRACTION",
    "SPECULAR",
    "drop_darkest",
    "judge_row",
    "linear",
    "solve_lights",
    "tell_flags",
]

# A normal nearer to the horizon than this (a slope of 50) is noise, not surface.
MIN_NORMAL_Z = np.float32(0.02)
# A light counts as shadowed where it gives no more than this fraction of the Lambertian prediction;
# the prediction is taken as at least SHADOW_FLOOR of the albedo, so that a pixel turned away from
# the light (prediction negative, value near zero) counts as well, and one without any light too.
SHADOW_FRACTION = np.float32(0.5)
SHADOW_FLOOR = np.float32(0.1)
# The same for a highlight, which gives more than predicted.
_HIGHLIGHT_FRACTION, _HIGHLIGHT_FLOOR = np.float32(1.5), np.float32(0.2)
NO_DROPPED_LIGHT = 255
# Bits of the flags.
NOT_VALID, SATURATED, SPECULAR, REPAIRED = np.uint8(1), np.uint8(2), np.uint8(4), np.uint8(8)

# Smallest eigenvalue of L^T L, the square of the smallest singular value of L, that still
# determines a normal.
_MIN_EIGENVALUE = 1e-6

Array = npt.NDArray[Any]

# NaN and infinity stay exact, and so does the order of sums: when it is free ("reassoc"), a kernel
# that numba has just compiled and the same from its cache differ in the last digits, and the first
# run of a machine does not give the numbers of all later ones.
FAST = {"contract", "arcp", "nsz"}


@njit(parallel=True, fastmath=FAST, cache=True, error_model="numpy")
def drop_darkest(
    images: Array, ambient: Array | None, gains: Array, saturation: np.float32,
    noise_floor: np.float32, pinv: Array, corrections: Array, null: Array, directions: Array,
    p: Array, q: Array, albedo: Array, residual: Array,
    dropped: Array, shadow_count: Array, flags: Array,
) -> None:  # fmt: skip
    """PS4: leave out the darkest of four values, solve from the other three (SCIENCE section 1).

    With b = pinv(L) i the four-light solution and r = nul . i its one contradiction, leaving out
    light k gives b - r pinv(L)[:, k] / nul[k]. Where several lights are equally dark the mean of
    their solutions is taken: picking the first would favour one axis over the other.
    """
    rows, columns = p.shape
    g0, g1, g2, g3 = gains
    n0, n1, n2, n3 = null
    zero, one = np.float32(0.0), np.float32(1.0)
    for r in prange(rows):
        for c in range(columns):
            v0 = np.float32(images[0, r, c])
            v1 = np.float32(images[1, r, c])
            v2 = np.float32(images[2, r, c])
            v3 = np.float32(images[3, r, c])
            saturated = max(max(v0, v1), max(v2, v3)) >= saturation
            if ambient is not None:
                dark = np.float32(ambient[r, c])
                v0 -= dark
                v1 -= dark
                v2 -= dark
                v3 -= dark
            v0 *= g0
            v1 *= g1
            v2 *= g2
            v3 *= g3
            darkest = min(min(v0, v1), min(v2, v3))
            w0 = np.float32(v0 == darkest)
            w1 = np.float32(v1 == darkest)
            w2 = np.float32(v2 == darkest)
            w3 = np.float32(v3 == darkest)
            contradiction = n0 * v0 + n1 * v1 + n2 * v2 + n3 * v3
            share = contradiction / (w0 + w1 + w2 + w3)
            bx = (pinv[0, 0] * v0 + pinv[0, 1] * v1 + pinv[0, 2] * v2 + pinv[0, 3] * v3) - share * (
                corrections[0, 0] * w0 + corrections[0, 1] * w1
                + corrections[0, 2] * w2 + corrections[0, 3] * w3
            )  # fmt: skip
            by = (pinv[1, 0] * v0 + pinv[1, 1] * v1 + pinv[1, 2] * v2 + pinv[1, 3] * v3) - share * (
                corrections[1, 0] * w0 + corrections[1, 1] * w1
                + corrections[1, 2] * w2 + corrections[1, 3] * w3
            )  # fmt: skip
            bz = (pinv[2, 0] * v0 + pinv[2, 1] * v1 + pinv[2, 2] * v2 + pinv[2, 3] * v3) - share * (
                corrections[2, 0] * w0 + corrections[2, 1] * w1
                + corrections[2, 2] * w2 + corrections[2, 3] * w3
            )  # fmt: skip
            rho = np.sqrt(bx * bx + by * by + bz * bz)
            visible = bz > MIN_NORMAL_Z * rho and bz * bz >= noise_floor * rho
            inverse = np.float32(1.0) / bz if visible else np.float32(0.0)
            p[r, c] = -bx * inverse
            q[r, c] = -by * inverse
            albedo[r, c] = rho
            residual[r, c] = np.float32(0.5) * abs(contradiction)
            index = 3 if w3 > 0 else 0
            index = 2 if w2 > 0 else index
            index = 1 if w1 > 0 else index
            dropped[r, c] = 0 if w0 > 0 else index
            floor = SHADOW_FLOOR * rho
            s0 = directions[0, 0] * bx + directions[0, 1] * by + directions[0, 2] * bz
            s1 = directions[1, 0] * bx + directions[1, 1] * by + directions[1, 2] * bz
            s2 = directions[2, 0] * bx + directions[2, 1] * by + directions[2, 2] * bz
            s3 = directions[3, 0] * bx + directions[3, 1] * by + directions[3, 2] * bz
            # Counted in float32: whatever stays in one type, eight pixels at a time can be done.
            shadows = (
                (one if v0 <= SHADOW_FRACTION * max(s0, floor) else zero)
                + (one if v1 <= SHADOW_FRACTION * max(s1, floor) else zero)
                + (one if v2 <= SHADOW_FRACTION * max(s2, floor) else zero)
                + (one if v3 <= SHADOW_FRACTION * max(s3, floor) else zero)
            )
            shadow_count[r, c] = np.uint8(shadows)
            # With two lights in shadow, one of them is in the solution.
            flags[r, c] = np.uint8(
                (one if not visible or shadows > one or saturated else zero)
                + (np.float32(SATURATED) if saturated else zero)
            )


@njit(parallel=True, fastmath=FAST, cache=True, error_model="numpy")
def linear(
    images: Array, ambient: Array | None, gains: Array, saturation: np.float32,
    noise_floor: np.float32, weights: Array, directions: Array, used: Array,
    p: Array, q: Array, albedo: Array, residual: Array, shadow_count: Array, flags: Array,
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
            images, ambient, gains, saturation, directions, used, r, bx, by, bz, floors, lost,
            p, q, albedo, residual, shadow_count, flags,
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
    images: Array, ambient: Array | None, gains: Array, saturation: np.float32,
    directions: Array, used: Array, r: int,
    bx: Array, by: Array, bz: Array, floors: Array, lost: Array,
    p: Array, q: Array, albedo: Array, residual: Array, shadow_count: Array, flags: Array,
) -> None:  # fmt: skip
    """Write all maps of a row from its scaled normals.

    A slope is known where bz^2 >= `floors` rho, the pixel is not `lost`, and at least three of the
    lights `used` are out of shadow. Of a highlight in a light that is not used nothing is lost.
    """
    lights = images.shape[0]
    columns = p.shape[1]
    zero, one = np.float32(0.0), np.float32(1.0)
    squares = np.zeros(columns, np.float32)
    brightest = np.zeros(columns, np.float32)
    # Shadows, lit lights and highlights in a byte each: with few arrays to write, the compiler
    # does eight pixels at a time.
    tally = np.zeros(columns, np.int32)
    for k in range(lights):
        x, y, z = directions[k]
        gain = gains[k]
        is_lit = np.int32(1 << 8) if used[k] else np.int32(0)
        for c in range(columns):
            v = np.float32(images[k, r, c])
            brightest[c] = max(brightest[c], v)
            if ambient is not None:
                v -= np.float32(ambient[r, c])
            v *= gain
            s = x * bx[c] + y * by[c] + z * bz[c]
            squares[c] += (v - s) * (v - s)
            rho = np.sqrt(bx[c] * bx[c] + by[c] * by[c] + bz[c] * bz[c])
            shadowed = v <= SHADOW_FRACTION * max(s, SHADOW_FLOOR * rho)
            highlight = v >= _HIGHLIGHT_FRACTION * max(s, _HIGHLIGHT_FLOOR * rho)
            tally[c] += (np.int32(1) if shadowed else is_lit) + (
                np.int32(1 << 16) if highlight else np.int32(0)
            )
    share = one / np.float32(lights)
    for c in range(columns):
        rho = np.sqrt(bx[c] * bx[c] + by[c] * by[c] + bz[c] * bz[c])
        visible = (bz[c] > MIN_NORMAL_Z * rho) & (bz[c] * bz[c] >= floors[c] * rho)
        inverse = one / bz[c] if visible else zero
        p[r, c] = -bx[c] * inverse
        q[r, c] = -by[c] * inverse
        albedo[r, c] = rho
        residual[r, c] = np.sqrt(squares[c] * share)
        shadow_count[r, c] = np.uint8(tally[c] & np.int32(255))
        known = visible & ((tally[c] >> np.int32(8)) & np.int32(255) >= np.int32(3))
        flag = np.int32(0) if known & (lost[c] == zero) else np.int32(NOT_VALID)
        flag |= np.int32(SATURATED) if brightest[c] >= saturation else np.int32(0)
        flag |= np.int32(SPECULAR) if visible & (tally[c] > np.int32(0xFFFF)) else np.int32(0)
        flags[r, c] = np.uint8(flag)


@njit(parallel=True, cache=True)
def tell_flags(
    flags: Array, saturated: Array, specular: Array, repaired: Array, valid: Array
) -> None:
    """Each of the flags as a map of its own, in one pass instead of eight of numpy."""
    rows, columns = flags.shape
    for r in prange(rows):
        for c in range(columns):
            flag = flags[r, c]
            saturated[r, c] = (flag & SATURATED) != 0
            specular[r, c] = (flag & SPECULAR) != 0
            repaired[r, c] = (flag & REPAIRED) != 0
            valid[r, c] = (flag & NOT_VALID) == 0
