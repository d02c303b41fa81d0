"""`ps4_robust` and its first pass: the noise gate, and at most one light left out of a pixel.

The first loops over a row have no branches, so that the compiler vectorises them. They mark the
doubtful pixels, which `_settle_row` solves one by one. `in_fill` completes those with fewer than
three usable lights.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from classify.compiling import kernel
from classify.lighting import Lighting
from classify.lights.algebra import drop_one_constants
from classify.lights.led_levels import level_corrections
from classify.shadow_rule import MIN_NORMAL_Z, MIN_SCALED_Z, NO_DROPPED_LIGHT, SHADOW_FRACTION
from classify.threads import STRIP_PX, run_on_rows

from .in_fill import LOST, SATURATED, in_fill
from .problem import Maps, Problem, slope_noise

Array = npt.NDArray[Any]

_NONE_LIT = np.uint8(15)
_DOUBTFUL = np.uint8(128)

# A residual of more standard deviations than this is not noise; one normal residual in 370 is.
_GATE = np.float32(3.0)
# A light is dark at a pixel if it gives no more than DARK standard deviations of a pixel without
# light, but at most half of the brightest light: a dark material is all noise without shadow. It
# is dark in any case below the share LEAK of the second brightest light, which is not a highlight:
# shadows get light from the surface around them.
DARK = np.float32(3.0)
LEAK = np.float32(0.03)
# LED levels are known, and surfaces are Lambertian, to a few percent only: a smaller residual, as
# a share of the brightest light, leaves out no light. All four lights average such errors better
# than three. tests/rig/test_known_truth.py holds the slope errors that these limits give.
TOLERANCE = np.float32(0.05)
_TINY = np.float32(1e-30)


def solve_ps4_robust(problem: Problem, strip_px: int = STRIP_PX) -> Maps:
    """Least squares of four lights where they agree, without one light where they do not.

    Pixels with fewer than three lights are filled in from their surroundings. Intensities that
    were not given are estimated first, and the lighting of the result holds them.
    """
    pinv, null = drop_one_constants(problem.lighting, "ps4_robust")
    stack, shape = problem.stack, problem.shape
    balanced = problem
    if not problem.lighting.intensities_given:
        corrections = level_corrections(
            stack.images, stack.ambient, problem.gains, float(problem.saturation),
            problem.variance, null,
        )  # fmt: skip
        balanced = replace(problem, lighting=Lighting(problem.lighting.directions, 1 / corrections))
    dropped, highlights = np.empty(shape, np.uint8), np.empty(shape, np.bool_)
    maps = balanced.new_maps(dropped, highlights, np.zeros(shape, np.bool_))
    unlit, row_counts = np.empty(shape, np.uint8), np.empty(shape[0], np.int64)
    images, dark = stack.images, stack.dark_rows
    least_bz, per_residual = slope_noise(pinv), (pinv / null).astype(np.float32)
    pinv, null = pinv.astype(np.float32), null.astype(np.float32)

    def solve(first: int, last: int) -> None:
        _gate(
            first, last, images, dark, balanced.gains, problem.saturation,
            problem.variance, problem.frames, least_bz, pinv, per_residual, null,
            maps.p, maps.q, maps.albedo, maps.valid, dropped, highlights, unlit, row_counts,
        )  # fmt: skip

    run_on_rows(solve, shape, strip_px)
    in_fill(balanced, maps, unlit, row_counts, strip_px)
    return maps


@kernel
def _gate(
    first: int, last: int, images: Array, ambient: Array, gains: Array, saturation: np.float32,
    noise: Array, frames: np.float32, least_bz: np.float32, pinv: Array, corrections: Array,
    null: Array, p: Array, q: Array, albedo: Array, valid: Array,
    dropped: Array, highlights: Array, unlit: Array, row_counts: Array,
) -> None:  # fmt: skip
    """Least squares of four lights where they agree, without one light where they do not.

    Parameters
    ----------
    noise
        (3,) a, b and black of the variance a + b (value - black) of a pixel value.
    frames
        1, or 2 where an ambient image, which is noisy as well, was subtracted.
    least_bz
        A slope is valid where bz^2 >= least_bz sigma rho, sigma that of the redundancy residual.
    corrections
        (3, 4) pinv / null: what b changes by if a light is left out, per unit of the residual.
    unlit
        Out: 0 where a pixel is solved, `LOST` where its slope drowns in noise, else the bits of
        the lights in shadow or saturated, which leave fewer than three.
    row_counts
        Out: (H,) pixels of each row that are not solved.

    Notes
    -----
    Formulas as for `ps4._drop_darkest`, with a share of the redundancy residual r = nul . i in
    place of all of it. The share is zero for least squares of all four. Where a dark light k is
    left out it is (1 - variance / r^2) r, all but what noise explains (the positive-part estimator
    of James and Stein, 1961). The solution then predicts i_j - nul_j (r - share) for every light,
    and share / nul_k less for light k.
    """
    columns = p.shape[1]
    g0, g1, g2, g3 = gains
    n0, n1, n2, n3 = null
    a, b, black = noise
    y0, y1, y2, y3 = (n0 * g0) ** 2, (n1 * g1) ** 2, (n2 * g2) ** 2, (n3 * g3) ** 2
    # The one ambient frame is in all four values, and cancels if the gains are equal.
    zero, one, two = np.float32(0.0), np.float32(1.0), np.float32(2.0)
    common = (frames - one) * (n0 * g0 + n1 * g1 + n2 * g2 + n3 * g3) ** 2
    c0, c1, c2, c3 = one / n0, one / n1, one / n2, one / n3
    marked, values = np.empty(columns, np.int64), np.empty((columns, 5), np.float32)
    for r in range(first, last):
        dark_row = ambient[min(r, len(ambient) - 1)]
        # The maps hold the scaled normals until the second loop.
        variances = np.empty(columns, np.float32)
        for c in range(columns):
            v0 = np.float32(images[0, r, c])
            v1 = np.float32(images[1, r, c])
            v2 = np.float32(images[2, r, c])
            v3 = np.float32(images[3, r, c])
            saturated = max(max(v0, v1), max(v2, v3)) >= saturation
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
            half, leak = SHADOW_FRACTION * brightest, LEAK * second
            t0, t1, t2, t3 = dark_level * g0, dark_level * g1, dark_level * g2, dark_level * g3
            w0 = one if v0 <= max(min(t0, half), leak) else zero
            w1 = one if v1 <= max(min(t1, half), leak) else zero
            w2 = one if v2 <= max(min(t2, half), leak) else zero
            w3 = one if v3 <= max(min(t3, half), leak) else zero
            count = (w0 + w1) + (w2 + w3)
            residual = (n0 * v0 + n1 * v1) + (n2 * v2 + n3 * v3)
            square = residual * residual
            # A single dark light is left out, but not for noise alone, which costs more than it
            # gains: the share of the residual that noise explains is subtracted.
            beyond = max(square - variance, zero) / max(square, _TINY)
            share = residual * beyond if count == one else zero
            s0 = v0 - share * w0 * c0
            s1 = v1 - share * w1 * c1
            s2 = v2 - share * w2 * c2
            s3 = v3 - share * w3 * c3
            p[r, c] = (pinv[0, 0] * s0 + pinv[0, 1] * s1) + (pinv[0, 2] * s2 + pinv[0, 3] * s3)
            q[r, c] = (pinv[1, 0] * s0 + pinv[1, 1] * s1) + (pinv[1, 2] * s2 + pinv[1, 3] * s3)
            albedo[r, c] = (pinv[2, 0] * s0 + pinv[2, 1] * s1) + (pinv[2, 2] * s2 + pinv[2, 3] * s3)
            index = np.uint8(w1 + two * w2 + np.float32(3.0) * w3)
            dropped[r, c] = index if share != zero else np.uint8(NO_DROPPED_LIGHT)
            tolerance = TOLERANCE * brightest
            doubtful = saturated | (
                (count == zero) & (square > _GATE * _GATE * variance + tolerance * tolerance)
            )
            bits = np.uint8((w0 + two * w1) + (np.float32(4.0) * w2 + np.float32(8.0) * w3))
            bits = bits if count > one else np.uint8(0)
            black_pixel = (v0 <= t0) & (v1 <= t1) & (v2 <= t2) & (v3 <= t3)
            bits = _NONE_LIT if black_pixel else bits
            unlit[r, c] = bits | (_DOUBTFUL if doubtful else np.uint8(0))
        for c in range(columns):
            bx, by, bz = p[r, c], q[r, c], albedo[r, c]
            rho = np.sqrt(bx * bx + by * by + bz * bz)
            least = least_bz * np.sqrt(variances[c]) * rho
            visible = (bz > max(MIN_NORMAL_Z * rho, MIN_SCALED_Z)) & (bz * bz >= least)
            inverse = -one / bz if visible else zero
            p[r, c] = bx * inverse
            q[r, c] = by * inverse
            albedo[r, c] = rho
            highlights[r, c] = False
            bits = unlit[r, c]
            lost = (bits & _NONE_LIT == 0) & (not visible)
            bits |= LOST if lost else np.uint8(0)
            unlit[r, c] = bits
            valid[r, c] = bits == 0
        doubts = 0
        for c in range(columns):
            if unlit[r, c] & _DOUBTFUL:
                marked[doubts] = c
                for k in range(4):
                    values[doubts, k] = images[k, r, c]
                values[doubts, 4] = dark_row[c]
                doubts += 1
        _settle_row(
            marked[:doubts], values, gains, saturation, noise, frames, least_bz,
            pinv, corrections, null, p[r], q[r], albedo[r], valid[r],
            dropped[r], highlights[r], unlit[r],
        )  # fmt: skip
        unsolved = 0
        for c in range(columns):
            unsolved += unlit[r, c] != 0
        row_counts[r] = unsolved


@kernel
def _settle_row(
    marked: Array, values: Array, gains: Array, saturation: np.float32,
    noise: Array, frames: np.float32, least_bz: np.float32,
    pinv: Array, corrections: Array, null: Array,
    p: Array, q: Array, albedo: Array, valid: Array,
    dropped: Array, highlights: Array, unlit: Array,
) -> None:  # fmt: skip
    """Solve the columns `marked` of a row: saturated lights, or four lights that do not agree.

    A saturated light is left out. If there is none, some light is darker than a Lambertian surface
    would be (penumbra) or brighter (highlight). The sign of the residual leaves one pair of
    lights to each: the darkest of one pair, the brightest of the other. Four values cannot
    distinguish the two explanations; the one with the flatter surface is taken.

    `values` (n, 5) holds the four pixel values and the ambient value of each of these columns. One
    call for a row, because passing the arguments takes as long as solving a pixel.
    """
    zero = np.float32(0.0)
    a, b, black = noise
    for n, c in enumerate(marked):
        dark = values[n, 4]
        variance = zero
        dark_variance = frames * (a + b * max(dark - black, zero))
        brightest, second, residual = zero, zero, zero
        bx, by, bz = zero, zero, zero
        for k in range(4):
            raw = values[n, k]
            v = (raw - dark) * gains[k]
            variance += (null[k] * gains[k]) ** 2 * (a + b * max(raw - black, zero))
            second = max(second, min(brightest, v))
            brightest = max(brightest, v)
            residual += null[k] * v
            bx += pinv[0, k] * v
            by += pinv[1, k] * v
            bz += pinv[2, k] * v
        dark_level = DARK * np.sqrt(dark_variance)
        bits, count, left_out, low, high = 0, 0, 0, 0, 0
        saturated = False
        lowest, highest = np.float32(np.inf), -np.float32(np.inf)
        for k in range(4):
            raw = values[n, k]
            v = (raw - dark) * gains[k]
            limit = max(min(dark_level * gains[k], SHADOW_FRACTION * brightest), LEAK * second)
            if raw >= saturation:
                saturated = True
            if raw >= saturation or v <= limit:
                bits |= 1 << k
                count += 1
                left_out = k
            elif null[k] * residual < zero and v < lowest:
                low, lowest = k, v
            elif null[k] * residual > zero and v > highest:
                high, highest = k, v
        if count > 1:
            unlit[c] = bits | SATURATED if saturated else bits
            valid[c] = False
            continue
        if count == 0:
            left_out = low
            if highest > zero:
                dark_z = bz - residual * corrections[2, low]
                bright_z = bz - residual * corrections[2, high]
                across_dark = (bx - residual * corrections[0, low]) ** 2 + (
                    by - residual * corrections[1, low]
                ) ** 2
                across_bright = (bx - residual * corrections[0, high]) ** 2 + (
                    by - residual * corrections[1, high]
                ) ** 2
                if bright_z > zero and (
                    dark_z <= zero or across_bright * dark_z**2 < across_dark * bright_z**2
                ):
                    left_out = high
                    highlights[c] = True
        bx -= residual * corrections[0, left_out]
        by -= residual * corrections[1, left_out]
        bz -= residual * corrections[2, left_out]
        rho = np.sqrt(bx * bx + by * by + bz * bz)
        visible = (
            bz > max(MIN_NORMAL_Z * rho, MIN_SCALED_Z)
            and bz * bz >= least_bz * np.sqrt(variance) * rho
        )
        inverse = np.float32(1.0) / bz if visible else zero
        p[c] = -bx * inverse
        q[c] = -by * inverse
        albedo[c] = rho
        dropped[c] = left_out
        if count == 1:
            v = (values[n, left_out] - dark) * gains[left_out]
            highlights[c] = v > v - residual / null[left_out]
        unlit[c] = np.uint8(0) if visible else LOST
        valid[c] = visible
