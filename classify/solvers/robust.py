"""First pass of `ps4_robust`: the noise gate, and one light left out where one is to blame.

The first loop over a row is free of branches, so that the compiler makes it eight pixels wide.
Pixels that need a decision of their own are marked there and settled one by one in the second;
what fewer than three lights can solve is left to `in_fill`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from classify.compiling import FAST
from classify.shadow_rule import MIN_NORMAL_Z, NO_DROPPED_LIGHT, SHADOW_FRACTION

__all__ = ["DARK", "GATE", "LEAK", "LOST", "TOLERANCE", "gated"]

Array = npt.NDArray[Any]

LOST = np.uint8(16)
_NONE_LIT = np.uint8(15)
_DOUBTFUL = np.uint8(128)

# A contradiction of this many standard deviations is more than noise.
GATE = np.float32(3.0)
# A light is dark that gives no more than so many standard deviations of a pixel without light;
# but no more than half of the brightest, for a dark material is all noise without being in shadow,
# and in any case this share of the second brightest, which is no highlight: shadows get light from
# the surface around them.
DARK = np.float32(3.0)
LEAK = np.float32(0.03)
# Lights are of known strength, and surfaces Lambertian, to some per cent only. All four together
# bear that better than three.
TOLERANCE = np.float32(0.05)
_TINY = np.float32(1e-30)


@njit(parallel=True, fastmath=FAST, cache=True, error_model="numpy")
def gated(
    images: Array, ambient: Array | None, gains: Array, saturation: np.float32,
    noise: Array, least_bz: np.float32, pinv: Array, corrections: Array, null: Array,
    p: Array, q: Array, albedo: Array, valid: Array,
    dropped: Array, highlights: Array, unlit: Array, row_counts: Array,
) -> None:  # fmt: skip
    """Least squares of four lights where they agree, without the one to blame where they do not.

    Parameters
    ----------
    noise
        (3,) a, b and black of the variance a + b (value - black) of a pixel value.
    least_bz
        A slope is known where bz^2 >= least_bz sigma rho, sigma that of the contradiction.
    unlit
        Out: 0 where a pixel is solved, `LOST` where its slope drowns in noise, else the bits of
        the lights in shadow or saturated, which leave fewer than three.
    row_counts
        Out: (H,) pixels of each row that are not solved.

    Notes
    -----
    Formulas as for `drop_darkest`, with a share of the contradiction r in place of all of it: none
    for least squares, all but what noise explains where a dark light k is left out, (1 - variance
    / r^2) r (the positive-part estimator of James and Stein, 1961). The solution then predicts
    i_j - nul_j (r - share) for every light, and share / nul_k less for light k.
    """
    rows, columns = p.shape
    g0, g1, g2, g3 = gains
    n0, n1, n2, n3 = null
    a, b, black = noise
    y0, y1, y2, y3 = (n0 * g0) ** 2, (n1 * g1) ** 2, (n2 * g2) ** 2, (n3 * g3) ** 2
    # The one ambient frame is in all four values, and cancels if the lights are equally strong.
    common = (n0 * g0 + n1 * g1 + n2 * g2 + n3 * g3) ** 2
    zero, one, two = np.float32(0.0), np.float32(1.0), np.float32(2.0)
    c0, c1, c2, c3 = one / n0, one / n1, one / n2, one / n3
    for r in prange(rows):
        # The scaled normals lie in the maps until the second loop.
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
            dark_variance = a
            if ambient is not None:
                dark = np.float32(ambient[r, c])
                v0 -= dark
                v1 -= dark
                v2 -= dark
                v3 -= dark
                dark_variance = a + b * max(dark - black, zero)
                variance += common * dark_variance
                dark_variance *= two
            variances[c] = variance
            dark_level = DARK * np.sqrt(dark_variance)
            v0 *= g0
            v1 *= g1
            v2 *= g2
            v3 *= g3
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
            contradiction = (n0 * v0 + n1 * v1) + (n2 * v2 + n3 * v3)
            square = contradiction * contradiction
            # One dark light is a suspect, whatever the contradiction; but what is left out for
            # noise alone costs more than it brings. So of r^2 what noise explains is taken off.
            beyond = max(square - variance, zero) / max(square, _TINY)
            share = contradiction * beyond if count == one else zero
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
                (count == zero) & (square > GATE * GATE * variance + tolerance * tolerance)
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
            visible = (bz > MIN_NORMAL_Z * rho) & (bz * bz >= least)
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
        unsolved = 0
        for c in range(columns):
            if unlit[r, c] != 0:
                if unlit[r, c] & _DOUBTFUL:
                    unlit[r, c] &= ~_DOUBTFUL
                    _settle(
                        images, ambient, gains, saturation, noise, least_bz,
                        pinv, corrections, null, r, c,
                        p, q, albedo, valid, dropped, highlights, unlit,
                    )  # fmt: skip
                unsolved += unlit[r, c] != 0
        row_counts[r] = unsolved


@njit(fastmath=FAST, cache=True, error_model="numpy")
def _settle(
    images: Array, ambient: Array | None, gains: Array, saturation: np.float32,
    noise: Array, least_bz: np.float32, pinv: Array, corrections: Array, null: Array,
    r: int, c: int, p: Array, q: Array, albedo: Array, valid: Array,
    dropped: Array, highlights: Array, unlit: Array,
) -> None:  # fmt: skip
    """A pixel with saturated lights, or with four bright lights that contradict each other.

    A saturated light is left out. Without one, some light is darker than a Lambertian surface
    would be (half shadow) or brighter (highlight), and the sign of the contradiction leaves one
    pair of lights to each: the darkest of the one, the brightest of the other. Nothing in four
    values tells these two apart; the explanation with the flatter surface is taken.
    """
    zero, two = np.float32(0.0), np.float32(2.0)
    a, b, black = noise
    dark = zero
    variance = zero
    dark_variance = a
    if ambient is not None:
        dark = np.float32(ambient[r, c])
        dark_variance = two * (a + b * max(dark - black, zero))
    brightest, second, contradiction = zero, zero, zero
    bx, by, bz = zero, zero, zero
    for k in range(4):
        raw = np.float32(images[k, r, c])
        v = (raw - dark) * gains[k]
        variance += (null[k] * gains[k]) ** 2 * (a + b * max(raw - black, zero))
        second = max(second, min(brightest, v))
        brightest = max(brightest, v)
        contradiction += null[k] * v
        bx += pinv[0, k] * v
        by += pinv[1, k] * v
        bz += pinv[2, k] * v
    dark_level = DARK * np.sqrt(dark_variance)
    bits, count, left_out, low, high = 0, 0, 0, 0, 0
    lowest, highest = np.float32(np.inf), -np.float32(np.inf)
    for k in range(4):
        raw = np.float32(images[k, r, c])
        v = (raw - dark) * gains[k]
        limit = max(min(dark_level * gains[k], SHADOW_FRACTION * brightest), LEAK * second)
        if raw >= saturation or v <= limit:
            bits |= 1 << k
            count += 1
            left_out = k
        elif null[k] * contradiction < zero and v < lowest:
            low, lowest = k, v
        elif null[k] * contradiction > zero and v > highest:
            high, highest = k, v
    if count > 1:
        unlit[r, c] = bits
        valid[r, c] = False
        return
    if count == 0:
        left_out = low
        if highest > zero:
            dark_z = bz - contradiction * corrections[2, low]
            bright_z = bz - contradiction * corrections[2, high]
            across_dark = (bx - contradiction * corrections[0, low]) ** 2 + (
                by - contradiction * corrections[1, low]
            ) ** 2
            across_bright = (bx - contradiction * corrections[0, high]) ** 2 + (
                by - contradiction * corrections[1, high]
            ) ** 2
            if bright_z > zero and (
                dark_z <= zero or across_bright * dark_z**2 < across_dark * bright_z**2
            ):
                left_out = high
                highlights[r, c] = True
    bx -= contradiction * corrections[0, left_out]
    by -= contradiction * corrections[1, left_out]
    bz -= contradiction * corrections[2, left_out]
    rho = np.sqrt(bx * bx + by * by + bz * bz)
    visible = bz > MIN_NORMAL_Z * rho and bz * bz >= least_bz * np.sqrt(variance) * rho
    inverse = np.float32(1.0) / bz if visible else zero
    p[r, c] = -bx * inverse
    q[r, c] = -by * inverse
    albedo[r, c] = rho
    dropped[r, c] = left_out
    if count == 1:
        v = (np.float32(images[left_out, r, c]) - dark) * gains[left_out]
        highlights[r, c] = v > v - contradiction / null[left_out]
    unlit[r, c] = np.uint8(0) if visible else LOST
    valid[r, c] = visible
