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
    "MIN_NORMAL_Z",
    "NO_DROPPED_LIGHT",
    "SHADOW_FLOOR",
    "SHADOW_FRACTION",
    "drop_darkest",
    "linear",
]

# A normal nearer to the horizon than this (a slope of 50) is noise, not surface.
MIN_NORMAL_Z = np.float32(0.02)
# A light counts as shadowed where it gives no more than this fraction of the Lambertian prediction;
# the prediction is taken as at least SHADOW_FLOOR of the albedo, so that a pixel turned away from
# the light (prediction negative, value near zero) counts as well, and one without any light too.
SHADOW_FRACTION = np.float32(0.5)
SHADOW_FLOOR = np.float32(0.1)
NO_DROPPED_LIGHT = 255

Array = npt.NDArray[Any]

# NaN and infinity stay exact; only rounding order may change.
_FAST = {"contract", "arcp", "nsz", "reassoc"}


@njit(parallel=True, fastmath=_FAST, cache=True, error_model="numpy")
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
    for r in prange(rows):
        for c in range(columns):
            v0 = np.float32(images[0, r, c])
            v1 = np.float32(images[1, r, c])
            v2 = np.float32(images[2, r, c])
            v3 = np.float32(images[3, r, c])
            brightest = max(max(v0, v1), max(v2, v3))
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
            shadow_count[r, c] = (
                (v0 <= SHADOW_FRACTION * max(s0, floor))
                + (v1 <= SHADOW_FRACTION * max(s1, floor))
                + (v2 <= SHADOW_FRACTION * max(s2, floor))
                + (v3 <= SHADOW_FRACTION * max(s3, floor))
            )
            flags[r, c] = (2 if brightest >= saturation else 0) + (0 if visible else 1)


@njit(parallel=True, fastmath=_FAST, cache=True, error_model="numpy")
def linear(
    images: Array, ambient: Array | None, gains: Array, saturation: np.float32,
    noise_floor: np.float32, weights: Array, directions: Array,
    p: Array, q: Array, albedo: Array, residual: Array, shadow_count: Array, flags: Array,
) -> None:  # fmt: skip
    """Any number of lights by b = weights i: least squares, or three chosen beforehand."""
    lights = images.shape[0]
    rows, columns = p.shape
    for r in prange(rows):
        # One row of accumulators stays in the first-level cache while the lights pass over it.
        bx = np.zeros(columns, np.float32)
        by = np.zeros(columns, np.float32)
        bz = np.zeros(columns, np.float32)
        brightest = np.zeros(columns, np.float32)
        squares = np.zeros(columns, np.float32)
        shadows = np.zeros(columns, np.uint8)
        for k in range(lights):
            for c in range(columns):
                v = np.float32(images[k, r, c])
                brightest[c] = max(brightest[c], v)
                if ambient is not None:
                    v -= np.float32(ambient[r, c])
                v *= gains[k]
                bx[c] += weights[0, k] * v
                by[c] += weights[1, k] * v
                bz[c] += weights[2, k] * v
        for k in range(lights):
            for c in range(columns):
                v = np.float32(images[k, r, c])
                if ambient is not None:
                    v -= np.float32(ambient[r, c])
                v *= gains[k]
                s = directions[k, 0] * bx[c] + directions[k, 1] * by[c] + directions[k, 2] * bz[c]
                rho = np.sqrt(bx[c] * bx[c] + by[c] * by[c] + bz[c] * bz[c])
                squares[c] += (v - s) * (v - s)
                shadows[c] += v <= SHADOW_FRACTION * max(s, SHADOW_FLOOR * rho)
        for c in range(columns):
            rho = np.sqrt(bx[c] * bx[c] + by[c] * by[c] + bz[c] * bz[c])
            visible = bz[c] > MIN_NORMAL_Z * rho and bz[c] * bz[c] >= noise_floor * rho
            inverse = np.float32(1.0) / bz[c] if visible else np.float32(0.0)
            p[r, c] = -bx[c] * inverse
            q[r, c] = -by[c] * inverse
            albedo[r, c] = rho
            residual[r, c] = np.sqrt(squares[c] / np.float32(lights))
            shadow_count[r, c] = shadows[c]
            flags[r, c] = (2 if brightest[c] >= saturation else 0) + (0 if visible else 1)
