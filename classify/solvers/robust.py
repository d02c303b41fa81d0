"""`ps4_robust` and its first pass, which leaves out lights by the redundancy residual.

A residual beyond the gate is blamed on the light that most likely caused it, by a shadow or a
highlight. The loops over a row have no branches, so that the compiler vectorises them. `in_fill`
completes the pixels with fewer than three usable lights.
"""

from dataclasses import replace

import numpy as np

from classify.base.arrays import Array
from classify.base.compiling import kernel
from classify.images import ImageStack
from classify.lights.algebra import drop_one_constants
from classify.lights.led_levels import LEVEL_SAMPLES, LitSamples, level_corrections, residual_spread
from classify.shadow_rule import (
    DARK,
    LEAK,
    MIN_NORMAL_Z,
    MIN_SCALED_Z,
    NO_DROPPED_LIGHT,
    SHADOW_FRACTION,
)

from .in_fill import in_fill
from .problem import Maps, Problem, noise_floor_factor
from .strips import correct_for_near_lights, solve_strips
from .unsolved import LIGHTS, LOST, SATURATED

# A residual of more standard deviations is not attributed to noise.
_GATE = np.float32(3.0)
# LED levels are known, and surfaces are Lambertian, to a few percent only: a residual below this
# share of the brightness is blamed on no light, because four lights average such errors better
# than three. tests/evidence/true_normals.py measures the slope errors that these limits give.
TOLERANCE = np.float32(0.05)
# Squared slope below which surfaces count as equally flat: 0.6 degrees, less than images show at a
# noise of 1 %.
_FLAT_SQUARED_SLOPE = np.float32(1e-4)
_TINY = np.float32(1e-30)


def solve_ps4_robust(problem: Problem) -> Maps:
    """Least squares of four lights without the one that disagrees with the others."""
    # LED levels that were not given are estimated first.
    pinv, null = drop_one_constants(problem.lighting, "ps4_robust")
    shape = problem.shape
    levels_known = problem.lighting.intensities_given
    samples = problem.sample if levels_known else problem.stack.sample(LEVEL_SAMPLES, problem.gains)
    lit = LitSamples.of(*samples, float(problem.saturation))
    balanced, lighting, corrections = problem, problem.lighting, np.ones(4, np.float32)
    if not levels_known:
        corrections = level_corrections(lit, problem.gains, problem.noise_coefficients, lighting)
        lighting = replace(lighting, intensities=1 / corrections)
        # With equal lights `problem` serves: a new one would estimate the same noise again.
        if np.any(corrections != 1.0):
            balanced = replace(problem, lighting=lighting)
    spread = np.float32(residual_spread(lit.values * corrections[:, None], null))
    left_out, unlit = np.empty(shape, np.uint8), np.empty(shape, np.uint8)
    highlights, repaired = np.empty(shape, np.bool_), np.zeros(shape, np.bool_)
    maps = replace(balanced.new_maps(left_out, highlights, repaired, unlit), lighting=lighting)
    least_bz, correction_columns = noise_floor_factor(pinv), (pinv / null).astype(np.float32)
    pinv, null = pinv.astype(np.float32), null.astype(np.float32)

    def solve(stack: ImageStack, maps: Maps, first: int, last: int) -> None:
        _solve_rows(
            first, last, stack.images, stack.dark_rows, balanced.gains, problem.saturation,
            problem.noise_coefficients, problem.frames, spread, least_bz, pinv, correction_columns,
            null, balanced.dark_albedo, maps.p, maps.q, maps.albedo, maps.valid, maps.dark_counts,
            maps.left_out, maps.highlights, maps.unlit,
        )  # fmt: skip

    solve_strips(balanced, maps, solve)
    in_fill(balanced, maps)
    correct_for_near_lights(balanced, maps)
    return maps


@kernel
def _flatness(
    bx: np.float32, by: np.float32, bz: np.float32, share: np.float32,
    cx: np.float32, cy: np.float32, cz: np.float32,
) -> np.float32:  # fmt: skip
    """Inverse fourth power of the slope of b - share c; 0 where it faces away."""
    x, y, z = bx - share * cx, by - share * cy, bz - share * cz
    square = z * z
    flatness = square / max(x * x + y * y + _FLAT_SQUARED_SLOPE * square, _TINY)
    return flatness * flatness if z > np.float32(0.0) else np.float32(0.0)


@kernel
def _solve_rows(
    first: int, last: int, images: Array, ambient: Array, gains: Array, saturation: np.float32,
    noise: Array, frames: np.float32, spread: np.float32, least_bz: np.float32, pinv: Array,
    correction_columns: Array, null: Array, dark_albedo: np.float32,
    p: Array, q: Array, albedo: Array, valid: Array, dark_counts: Array,
    dropped: Array, highlights: Array, unlit: Array,
) -> None:  # fmt: skip
    """Solve rows by least squares, without the blamed light where the lights disagree."""
    # b = L+ i - share sum_k w_k L+[:, k] / nul_k. The share (1 - T^2 / r^2) r of the redundancy
    # residual r = nul . i is 0 for |r| < T (positive-part estimator of James and Stein, 1961); the
    # weights w_k are the inverse fourth powers of the slopes without light k, because flatter
    # surfaces are likelier. T is the largest of three standard deviations of noise, `TOLERANCE` and
    # `spread` times the brightness. If a light is dark or saturated, all of the residual is blamed
    # on it, and T is one standard deviation. `noise` (3,) is a, b and black of the variance a + b
    # (value - black). `correction_columns` (3, 4) is pinv / null. `unlit` is 0, `LOST`, or the bits
    # of the lights in shadow or saturated; `out0` to `out3` are 1 for these lights.
    columns = p.shape[1]
    g0, g1, g2, g3 = gains
    n0, n1, n2, n3 = null
    a, b, black = noise
    # Factors of the variances of the pixel values in the variance of the residual.
    m0, m1, m2, m3 = (n0 * g0) ** 2, (n1 * g1) ** 2, (n2 * g2) ** 2, (n3 * g3) ** 2
    x0, x1, x2, x3 = pinv[0]
    y0, y1, y2, y3 = pinv[1]
    z0, z1, z2, z3 = pinv[2]
    cx0, cx1, cx2, cx3 = correction_columns[0]
    cy0, cy1, cy2, cy3 = correction_columns[1]
    cz0, cz1, cz2, cz3 = correction_columns[2]
    zero, one, two, half = np.float32(0.0), np.float32(1.0), np.float32(2.0), np.float32(0.5)
    quarter = np.float32(0.25)
    # The one ambient frame is in all four values, and cancels if the gains are equal.
    common = (frames - one) * (n0 * g0 + n1 * g1 + n2 * g2 + n3 * g3) ** 2
    gate_share = max(TOLERANCE, spread) ** 2
    outlier_share = max(TOLERANCE, _GATE * spread) ** 2
    variances = np.empty(columns, np.float32)
    for r in range(first, last):
        dark_row = ambient[min(r, len(ambient) - 1)]
        # The maps hold the scaled normals until the second loop.
        for c in range(columns):
            v0 = np.float32(images[0, r, c])
            v1 = np.float32(images[1, r, c])
            v2 = np.float32(images[2, r, c])
            v3 = np.float32(images[3, r, c])
            out0 = one if v0 >= saturation else zero
            out1 = one if v1 >= saturation else zero
            out2 = one if v2 >= saturation else zero
            out3 = one if v3 >= saturation else zero
            saturated = (out0 + out1) + (out2 + out3) > zero
            variance = (
                m0 * (a + b * max(v0 - black, zero)) + m1 * (a + b * max(v1 - black, zero))
            ) + (m2 * (a + b * max(v2 - black, zero)) + m3 * (a + b * max(v3 - black, zero)))
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
            shadow_limit, leak = SHADOW_FRACTION * brightest, LEAK * second
            dark0, dark1 = dark_level * g0, dark_level * g1
            dark2, dark3 = dark_level * g2, dark_level * g3
            out0 = one if v0 <= max(min(dark0, shadow_limit), leak) else out0
            out1 = one if v1 <= max(min(dark1, shadow_limit), leak) else out1
            out2 = one if v2 <= max(min(dark2, shadow_limit), leak) else out2
            out3 = one if v3 <= max(min(dark3, shadow_limit), leak) else out3
            out_count = (out0 + out1) + (out2 + out3)
            residual = (n0 * v0 + n1 * v1) + (n2 * v2 + n3 * v3)
            square = residual * residual
            mean = quarter * ((v0 + v1) + (v2 + v3))
            noise_gate = _GATE * _GATE * variance
            gate = max(noise_gate, gate_share * mean * mean)
            gate = gate if out_count == zero else variance
            shrinkage = max(square - gate, zero) / max(square, _TINY)
            share = residual * shrinkage
            bx = (x0 * v0 + x1 * v1) + (x2 * v2 + x3 * v3)
            by = (y0 * v0 + y1 * v1) + (y2 * v2 + y3 * v3)
            bz = (z0 * v0 + z1 * v1) + (z2 * v2 + z3 * v3)
            w0 = _flatness(bx, by, bz, share, cx0, cy0, cz0)
            w1 = _flatness(bx, by, bz, share, cx1, cy1, cz1)
            w2 = _flatness(bx, by, bz, share, cx2, cy2, cz2)
            w3 = _flatness(bx, by, bz, share, cx3, cy3, cz3)
            w0 = w0 if out_count == zero else out0
            w1 = w1 if out_count == zero else out1
            w2 = w2 if out_count == zero else out2
            w3 = w3 if out_count == zero else out3
            total = one / max((w0 + w1) + (w2 + w3), _TINY)
            correction = share * total
            p[r, c] = bx - correction * ((w0 * cx0 + w1 * cx1) + (w2 * cx2 + w3 * cx3))
            q[r, c] = by - correction * ((w0 * cy0 + w1 * cy1) + (w2 * cy2 + w3 * cy3))
            albedo[r, c] = bz - correction * ((w0 * cz0 + w1 * cz1) + (w2 * cz2 + w3 * cz3))
            largest = max(max(w0, w1), max(w2, w3))
            index = np.uint8(2) if w2 == largest else np.uint8(3)
            index = np.uint8(1) if w1 == largest else index
            index = np.uint8(0) if w0 == largest else index
            left_out = largest * total * shrinkage > half
            dropped[r, c] = index if left_out else np.uint8(NO_DROPPED_LIGHT)
            bright = (
                (w0 if n0 * residual > zero else zero) + (w1 if n1 * residual > zero else zero)
            ) + ((w2 if n2 * residual > zero else zero) + (w3 if n3 * residual > zero else zero))
            outlying = (out_count == zero) & (square > max(noise_gate, outlier_share * mean * mean))
            blames_bright = bright * total > half
            highlights[r, c] = blames_bright & (outlying | (saturated & (out_count == one)))
            bits = np.uint8((out0 + two * out1) + (np.float32(4.0) * out2 + np.float32(8.0) * out3))
            bits |= SATURATED if saturated else np.uint8(0)
            bits = bits if out_count > one else np.uint8(0)
            black_pixel = (v0 <= dark0) & (v1 <= dark1) & (v2 <= dark2) & (v3 <= dark3)
            bits = LIGHTS if black_pixel else bits
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
            is_lost = (bits & LIGHTS == 0) & (not visible)
            bits |= LOST if is_lost else np.uint8(0)
            unlit[r, c] = bits
            valid[r, c] = bits == 0
        dark_counts[r] = dark_count
