"""PS4 as in the thesis: of four lights the darkest is left out, at every pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from classify.compiling import FAST
from classify.shadow_rule import MIN_NORMAL_Z, SHADOW_FLOOR, SHADOW_FRACTION

__all__ = ["drop_darkest"]

Array = npt.NDArray[Any]

_DARK = SHADOW_FRACTION * SHADOW_FLOOR


@njit(parallel=True, fastmath=FAST, cache=True, error_model="numpy")
def drop_darkest(
    images: Array, ambient: Array | None, gains: Array | None, albedo_gain: np.float32,
    saturation: np.float32, noise_floor: np.float32, inverse: Array, null: Array,
    p: Array, q: Array, albedo: Array, valid: Array,
) -> None:  # fmt: skip
    """Leave out the darkest of four values, solve from the other three (SCIENCE section 1).

    With r = nul . i the contradiction of the four values, the others predict i_k - r / nul_k for
    light k. With that in place of i_k all four agree, and any three give b: those of `inverse`, of
    the first three light vectors. Where several lights are equally dark the mean of their solutions
    is taken: picking the first would favour one axis over the other.

    Values are multiplied by `gains` before, or, where those are all the same, albedo by
    `albedo_gain` after: slopes do not change with the brightness of all lights.

    A slope is known where b_z^2 >= `noise_floor` rho (before `albedo_gain`), no light is saturated,
    and the second darkest is out of shadow: with two lights in shadow, one of them is in the
    solution. Of n equally dark lights any may be the one in shadow, and what r says of that one
    does not go for the others: by (n - 1) / n of it the second darkest counts as darker.
    """
    rows, columns = p.shape
    n0, n1, n2, n3 = null
    zero, one = np.float32(0.0), np.float32(1.0)
    c0, c1, c2, c3 = one / n0, one / n1, one / n2, one / n3
    largest = max(max(abs(c0), abs(c1)), max(abs(c2), abs(c3)))
    for r in prange(rows):
        # Until the second loop the maps hold what three lights give.
        seconds = np.empty(columns, np.float32)
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
            if gains is not None:
                v0 *= gains[0]
                v1 *= gains[1]
                v2 *= gains[2]
                v3 *= gains[3]
            low, other_low = min(v0, v1), min(v2, v3)
            darkest = min(low, other_low)
            second = min(max(low, other_low), min(max(v0, v1), max(v2, v3)))
            # One for each light that is the darkest.
            d0 = one if v0 == darkest else zero
            d1 = one if v1 == darkest else zero
            d2 = one if v2 == darkest else zero
            d3 = one if v3 == darkest else zero
            ties = (d0 + d1) + (d2 + d3)
            share = (n0 * v0 + n1 * v1 + n2 * v2 + n3 * v3) / ties
            p[r, c] = v0 - share * c0 * d0
            q[r, c] = v1 - share * c1 * d1
            albedo[r, c] = v2 - share * c2 * d2
            second -= (ties - one) * largest * abs(share)
            seconds[c] = second if brightest < saturation else -one
        for c in range(columns):
            s0, s1, s2 = p[r, c], q[r, c], albedo[r, c]
            bx = inverse[0, 0] * s0 + inverse[0, 1] * s1 + inverse[0, 2] * s2
            by = inverse[1, 0] * s0 + inverse[1, 1] * s1 + inverse[1, 2] * s2
            bz = inverse[2, 0] * s0 + inverse[2, 1] * s1 + inverse[2, 2] * s2
            rho = np.sqrt(bx * bx + by * by + bz * bz)
            visible = (bz > MIN_NORMAL_Z * rho) & (bz * bz >= noise_floor * rho)
            scale = -one / bz if visible else zero
            p[r, c] = bx * scale
            q[r, c] = by * scale
            albedo[r, c] = rho * albedo_gain
            valid[r, c] = visible & (seconds[c] > _DARK * rho)
