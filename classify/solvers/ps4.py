"""PS4 as in the thesis: the darkest of four lights is left out at every pixel."""

import numpy as np

from classify.base.arrays import Array
from classify.base.compiling import kernel
from classify.images import ImageStack
from classify.lights.algebra import drop_one_constants
from classify.shadow_rule import MIN_NORMAL_Z, MIN_SCALED_Z, SHADOW_FLOOR, SHADOW_FRACTION

from .problem import Maps, Problem
from .strips import solve_strips

# A light counts as shadowed up to this value, relative to the albedo: see classify/shadow_rule.py.
# The prediction is not computed here, so its smallest value stands for it.
_SHADOW_LIMIT = SHADOW_FRACTION * SHADOW_FLOOR


def solve_ps4(problem: Problem) -> Maps:
    """Leave out the darkest of four lights at every pixel; reports no highlights."""
    pinv, null = drop_one_constants(problem.lighting, "ps4")
    floor = problem.noise_floor(pinv)
    inverse = np.linalg.inv(problem.lighting.directions[:3]).astype(np.float32)
    # Slopes do not depend on a common gain of the lights: equal gains are applied to the albedo
    # only.
    gains, albedo_gain = problem.gains, np.float32(1.0)
    if np.ptp(gains) == 0.0:
        gains, albedo_gain = np.ones_like(gains), gains[0]
    maps = problem.new_maps(highlights=np.broadcast_to(np.False_, problem.shape))
    null = null.astype(np.float32)

    def solve(stack: ImageStack, maps: Maps, first: int, last: int) -> None:
        _drop_darkest(
            first, last, stack.images, stack.dark_rows, gains, albedo_gain, problem.saturation,
            floor / albedo_gain, inverse, null, problem.dark_albedo, maps.p, maps.q, maps.albedo,
            maps.valid, maps.dark_counts,
        )  # fmt: skip

    solve_strips(problem, maps, solve)
    return maps


@kernel
def _drop_darkest(
    first: int, last: int, images: Array, ambient: Array, gains: Array, albedo_gain: np.float32,
    saturation: np.float32, noise_floor: np.float32, inverse: Array, null: Array,
    dark_albedo: np.float32,
    p: Array, q: Array, albedo: Array, valid: Array, dark_counts: Array,
) -> None:  # fmt: skip
    """Leave out the darkest of four values, and solve for b = albedo * normal from the others."""
    # With nul the left null vector of the lights, r = nul . i is 0 for a Lambertian pixel that all
    # lights reach. So the other values predict i_k - r / nul_k for the darkest light k. With that
    # in place of i_k, any three of the values give b. Of n equally dark lights, each is left out
    # in turn, and b is the mean: each value is corrected by 1 / n of r / nul_k.
    # A slope is valid where no light is saturated, the second darkest light is out of shadow, and
    # b_z^2 >= `noise_floor` rho: the standard error of a slope is proportional to rho / b_z^2
    # (`noise_floor_factor`). If n > 1 lights are equally dark, the value of the second darkest is
    # lowered by (n - 1) / n of |r| max(1 / |nul|), the largest correction that the mean omits.
    columns = p.shape[1]
    g0, g1, g2, g3 = gains
    n0, n1, n2, n3 = null
    # Scalars, which a store to a map cannot change; array elements would be loaded at every pixel.
    (x0, x1, x2), (y0, y1, y2), (z0, z1, z2) = inverse[0], inverse[1], inverse[2]
    zero, one = np.float32(0.0), np.float32(1.0)
    c0, c1, c2, c3 = one / n0, one / n1, one / n2, one / n3
    max_inverse = max(max(abs(c0), abs(c1)), max(abs(c2), abs(c3)))
    for r in range(first, last):
        ambient_row = ambient[min(r, len(ambient) - 1)]  # one row of zeros without an image
        dark_count = 0
        for c in range(columns):
            v0 = np.float32(images[0, r, c])
            v1 = np.float32(images[1, r, c])
            v2 = np.float32(images[2, r, c])
            v3 = np.float32(images[3, r, c])
            brightest = max(max(v0, v1), max(v2, v3))
            ambient_value = np.float32(ambient_row[c])
            v0 = (v0 - ambient_value) * g0
            v1 = (v1 - ambient_value) * g1
            v2 = (v2 - ambient_value) * g2
            v3 = (v3 - ambient_value) * g3
            low, other_low = min(v0, v1), min(v2, v3)
            darkest = min(low, other_low)
            second = min(max(low, other_low), min(max(v0, v1), max(v2, v3)))
            # 1 for each light with the darkest value, else 0.
            d0 = one if v0 == darkest else zero
            d1 = one if v1 == darkest else zero
            d2 = one if v2 == darkest else zero
            d3 = one if v3 == darkest else zero
            ties = (d0 + d1) + (d2 + d3)
            share = (n0 * v0 + n1 * v1 + n2 * v2 + n3 * v3) / ties
            s0 = v0 - share * c0 * d0
            s1 = v1 - share * c1 * d1
            s2 = v2 - share * c2 * d2
            second -= (ties - one) * max_inverse * abs(share)
            second = second if brightest < saturation else -one
            bx = x0 * s0 + x1 * s1 + x2 * s2
            by = y0 * s0 + y1 * s1 + y2 * s2
            bz = z0 * s0 + z1 * s1 + z2 * s2
            rho = np.sqrt(bx * bx + by * by + bz * bz)
            visible = (bz > max(MIN_NORMAL_Z * rho, MIN_SCALED_Z)) & (bz * bz >= noise_floor * rho)
            scale = -one / bz if visible else zero
            p[r, c] = bx * scale
            q[r, c] = by * scale
            scaled = rho * albedo_gain
            albedo[r, c] = scaled
            dark_count += scaled < dark_albedo
            valid[r, c] = visible & (second > _SHADOW_LIMIT * rho)
        dark_counts[r] = dark_count
