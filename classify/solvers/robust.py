"""`ps4_robust` and its first pass: the residual gate, and the light to blame.

The loops over a row have no branches, so that the compiler vectorises them. `in_fill` completes
the pixels with fewer than three usable lights.
"""

from dataclasses import replace

import numpy as np

from classify.base.arrays import Array
from classify.base.compiling import kernel
from classify.base.threads import STRIP_PX
from classify.images import ImageStack
from classify.lights.algebra import drop_one_constants
from classify.lights.led_levels import (
    LEVEL_SAMPLES,
    LitSamples,
    level_corrections,
    residual_spread,
)
from classify.shadow_rule import (
    DARK,
    LEAK,
    MIN_NORMAL_Z,
    MIN_SCALED_Z,
    NO_DROPPED_LIGHT,
    SHADOW_FRACTION,
)

from .in_fill import in_fill
from .problem import Maps, Problem, slope_noise
from .strips import correct_for_near_lights, solve_strips
from .unsolved import LOST, SATURATED

_NONE_LIT = np.uint8(15)

# A residual of more standard deviations than this is not noise; one normal residual in 370 is.
_GATE = np.float32(3.0)
# LED levels are known, and surfaces are Lambertian, to a few percent only: a smaller residual, as
# a share of the brightness, is taken off no light. All four lights average such errors better
# than three. tests/evidence/true_normals.py holds the slope errors that these limits give.
TOLERANCE = np.float32(0.05)
# Squared slope below which one explanation is not better for being flatter: 0.6 degrees, less than
# images show at a noise of 1 %.
_LEVEL = np.float32(1e-4)
_TINY = np.float32(1e-30)


def solve_ps4_robust(problem: Problem, strip_px: int = STRIP_PX) -> Maps:
    """Least squares of four lights without the one to blame, after estimating intensities that were
    not given.
    """
    pinv, null = drop_one_constants(problem.lighting, "ps4_robust")
    shape = problem.shape
    levels_known = problem.lighting.intensities_given
    samples = problem.sample if levels_known else problem.stack.sample(LEVEL_SAMPLES, problem.gains)
    lit = LitSamples.of(*samples, float(problem.saturation))
    balanced, lighting, corrections = problem, problem.lighting, np.ones(4, np.float32)
    if not levels_known:
        corrections = level_corrections(lit, problem.gains, problem.variance, lighting)
        lighting = replace(lighting, intensities=1 / corrections)
        # A new problem would estimate the noise again, which is the same for equal lights.
        if np.any(corrections != 1.0):
            balanced = replace(problem, lighting=lighting)
    spread = np.float32(residual_spread(lit.values * corrections[:, None], null))
    left_out, unlit = np.empty(shape, np.uint8), np.empty(shape, np.uint8)
    highlights, repaired = np.empty(shape, np.bool_), np.zeros(shape, np.bool_)
    maps = replace(balanced.new_maps(left_out, highlights, repaired, unlit), lighting=lighting)
    least_bz, per_residual = slope_noise(pinv), (pinv / null).astype(np.float32)
    pinv, null = pinv.astype(np.float32), null.astype(np.float32)

    def solve(stack: ImageStack, maps: Maps, first: int, last: int) -> None:
        _gate(
            first, last, stack.images, stack.dark_rows, balanced.gains, problem.saturation,
            problem.variance, problem.frames, spread, least_bz, pinv, per_residual, null,
            balanced.dark_albedo, maps.p, maps.q, maps.albedo, maps.valid, maps.dark_counts,
            maps.left_out, maps.highlights, maps.unlit,
        )  # fmt: skip

    solve_strips(balanced, maps, solve, strip_px)
    in_fill(balanced, maps, strip_px)
    correct_for_near_lights(balanced, maps)
    return maps


@kernel
def _flatness(
    bx: np.float32, by: np.float32, bz: np.float32, share: np.float32,
    cx: np.float32, cy: np.float32, cz: np.float32,
) -> np.float32:  # fmt: skip
    """Square of the inverse squared slope of b - share c; 0 where it faces away."""
    x, y, z = bx - share * cx, by - share * cy, bz - share * cz
    square = z * z
    flatness = square / max(x * x + y * y + _LEVEL * square, _TINY)
    return flatness * flatness if z > np.float32(0.0) else np.float32(0.0)


@kernel
def _gate(
    first: int, last: int, images: Array, ambient: Array, gains: Array, saturation: np.float32,
    noise: Array, frames: np.float32, spread: np.float32, least_bz: np.float32, pinv: Array,
    corrections: Array, null: Array, dark_albedo: np.float32,
    p: Array, q: Array, albedo: Array, valid: Array, dark_counts: Array,
    dropped: Array, highlights: Array, unlit: Array,
) -> None:  # fmt: skip
    """Solve rows by least squares, without the light to blame where they disagree."""
    # b = L+ i - share sum_k w_k L+[:, k] / nul_k. The share (1 - T^2 / r^2) r of the redundancy
    # residual r = nul . i is 0 for |r| < T (positive-part estimator of James and Stein, 1961); the
    # weights w_k are the inverse fourth powers of the slopes without light k, because flatter
    # surfaces are likelier. T is the largest of three standard deviations of noise, `TOLERANCE` and
    # `spread` times the brightness. A dark or saturated light takes all the blame, and T is one
    # standard deviation. `noise` (3,) is a, b and black of the variance a + b (value - black),
    # `corrections` (3, 4) is pinv / null; `unlit` gets 0, `LOST` or the bits of the lights in
    # shadow or saturated.
    columns = p.shape[1]
    g0, g1, g2, g3 = gains
    n0, n1, n2, n3 = null
    a, b, black = noise
    y0, y1, y2, y3 = (n0 * g0) ** 2, (n1 * g1) ** 2, (n2 * g2) ** 2, (n3 * g3) ** 2
    x0, x1, x2, x3 = pinv[0]
    z0, z1, z2, z3 = pinv[2]
    u0, u1, u2, u3 = pinv[1]
    cx0, cx1, cx2, cx3 = corrections[0]
    cy0, cy1, cy2, cy3 = corrections[1]
    cz0, cz1, cz2, cz3 = corrections[2]
    zero, one, two, half = np.float32(0.0), np.float32(1.0), np.float32(2.0), np.float32(0.5)
    quarter = np.float32(0.25)
    # The one ambient frame is in all four values, and cancels if the gains are equal.
    common = (frames - one) * (n0 * g0 + n1 * g1 + n2 * g2 + n3 * g3) ** 2
    doubt = max(TOLERANCE, spread) ** 2
    outlier = max(TOLERANCE, _GATE * spread) ** 2
    variances = np.empty(columns, np.float32)
    for r in range(first, last):
        dark_row = ambient[min(r, len(ambient) - 1)]
        # The maps hold the scaled normals until the second loop.
        for c in range(columns):
            v0 = np.float32(images[0, r, c])
            v1 = np.float32(images[1, r, c])
            v2 = np.float32(images[2, r, c])
            v3 = np.float32(images[3, r, c])
            o0 = one if v0 >= saturation else zero
            o1 = one if v1 >= saturation else zero
            o2 = one if v2 >= saturation else zero
            o3 = one if v3 >= saturation else zero
            saturated = (o0 + o1) + (o2 + o3) > zero
            variance = (
                y0 * (a + b * max(v0 - black, zero)) + y1 * (a + b * max(v1 - black, zero))
            ) + (y2 * (a + b * max(v2 - black, zero)) + y3 * (a + b * max(v3 - black, zero)))
            dark = np.float32(dark_row[c])
            dark_variance = a + b * max(dark - black, zero)
            variance += common * dark_variance
            variances[c] = variance
            dark_level = DARK * np.sqrt(frames * dark_variance)
            v0 = (v0 - dark) * g0
            v1 = (v1 - dark) * g1
            v2 = (v2 - dark) * g2
            v3 = (v3 - dark) * g3
            high, other_high = max(v0, v1), max(v2, v3)
            brightest = max(high, other_high)
            second = max(min(high, other_high), max(min(v0, v1), min(v2, v3)))
            most, leak = SHADOW_FRACTION * brightest, LEAK * second
            t0, t1, t2, t3 = dark_level * g0, dark_level * g1, dark_level * g2, dark_level * g3
            o0 = one if v0 <= max(min(t0, most), leak) else o0
            o1 = one if v1 <= max(min(t1, most), leak) else o1
            o2 = one if v2 <= max(min(t2, most), leak) else o2
            o3 = one if v3 <= max(min(t3, most), leak) else o3
            count = (o0 + o1) + (o2 + o3)
            residual = (n0 * v0 + n1 * v1) + (n2 * v2 + n3 * v3)
            square = residual * residual
            mean = quarter * ((v0 + v1) + (v2 + v3))
            noise_gate = _GATE * _GATE * variance
            gate = max(noise_gate, doubt * mean * mean)
            gate = gate if count == zero else variance
            beyond = max(square - gate, zero) / max(square, _TINY)
            share = residual * beyond
            bx = (x0 * v0 + x1 * v1) + (x2 * v2 + x3 * v3)
            by = (u0 * v0 + u1 * v1) + (u2 * v2 + u3 * v3)
            bz = (z0 * v0 + z1 * v1) + (z2 * v2 + z3 * v3)
            w0 = _flatness(bx, by, bz, share, cx0, cy0, cz0)
            w1 = _flatness(bx, by, bz, share, cx1, cy1, cz1)
            w2 = _flatness(bx, by, bz, share, cx2, cy2, cz2)
            w3 = _flatness(bx, by, bz, share, cx3, cy3, cz3)
            w0 = w0 if count == zero else o0
            w1 = w1 if count == zero else o1
            w2 = w2 if count == zero else o2
            w3 = w3 if count == zero else o3
            total = one / max((w0 + w1) + (w2 + w3), _TINY)
            correction = share * total
            p[r, c] = bx - correction * ((w0 * cx0 + w1 * cx1) + (w2 * cx2 + w3 * cx3))
            q[r, c] = by - correction * ((w0 * cy0 + w1 * cy1) + (w2 * cy2 + w3 * cy3))
            albedo[r, c] = bz - correction * ((w0 * cz0 + w1 * cz1) + (w2 * cz2 + w3 * cz3))
            largest = max(max(w0, w1), max(w2, w3))
            index = np.uint8(2) if w2 == largest else np.uint8(3)
            index = np.uint8(1) if w1 == largest else index
            index = np.uint8(0) if w0 == largest else index
            left_out = largest * total * beyond > half
            dropped[r, c] = index if left_out else np.uint8(NO_DROPPED_LIGHT)
            bright = (
                (w0 if n0 * residual > zero else zero) + (w1 if n1 * residual > zero else zero)
            ) + ((w2 if n2 * residual > zero else zero) + (w3 if n3 * residual > zero else zero))
            outlying = (count == zero) & (square > max(noise_gate, outlier * mean * mean))
            blames_bright = bright * total > half
            highlights[r, c] = blames_bright & (outlying | (saturated & (count == one)))
            bits = np.uint8((o0 + two * o1) + (np.float32(4.0) * o2 + np.float32(8.0) * o3))
            bits |= SATURATED if saturated else np.uint8(0)
            bits = bits if count > one else np.uint8(0)
            black_pixel = (v0 <= t0) & (v1 <= t1) & (v2 <= t2) & (v3 <= t3)
            bits = _NONE_LIT if black_pixel else bits
            unlit[r, c] = bits
        dark_count = 0
        for c in range(columns):
            bx, by, bz = p[r, c], q[r, c], albedo[r, c]
            rho = np.sqrt(bx * bx + by * by + bz * bz)
            least = least_bz * np.sqrt(variances[c]) * rho
            visible = (bz > max(MIN_NORMAL_Z * rho, MIN_SCALED_Z)) & (bz * bz >= least)
            inverse = -one / bz if visible else zero
            p[r, c] = bx * inverse
            q[r, c] = by * inverse
            albedo[r, c] = rho
            dark_count += rho < dark_albedo
            bits = unlit[r, c]
            lost = (bits & _NONE_LIT == 0) & (not visible)
            bits |= LOST if lost else np.uint8(0)
            unlit[r, c] = bits
            valid[r, c] = bits == 0
        dark_counts[r] = dark_count
