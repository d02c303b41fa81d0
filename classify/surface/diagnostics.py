"""A solution compared with images: residual, shadow, highlights, darkest light."""

import numpy as np

from classify.base.arrays import Array, FloatMap
from classify.base.compiling import kernel
from classify.images import SIGMA_PER_MAD
from classify.shadow_rule import SHADOW_FLOOR, SHADOW_FRACTION

# A highlight is at least `_HIGHLIGHT_FRACTION` times as bright as the Lambertian prediction, which
# counts as at least `_HIGHLIGHT_FLOOR` times the albedo: the counterpart of the shadow rule.
# tests/classify/surface/test_diagnostics.py tests both.
_HIGHLIGHT_FRACTION, _HIGHLIGHT_FLOOR = np.float32(1.5), np.float32(0.2)
# Its ratio to the prediction also exceeds the median ratio of its light by this many robust
# standard deviations. Of 72 lights of a matt surface, one has such pixels: 0.2 % of the frame.
_HIGHLIGHT_DEVIATIONS = 4.0


@kernel
def fit_residual(
    images: Array, ambient: Array, gains: Array, weights: Array, directions: Array,
    plane: Array, excess: Array, x: Array, y: Array, residual: Array,
) -> None:  # fmt: skip
    """Rms difference from the least squares surface b' = weights i.

    For plane, excess, x and y see `near_light`.
    """
    lights = images.shape[0]
    rows, columns = residual.shape
    share = np.float32(1.0 / lights)
    one = np.float32(1.0)
    for r in range(rows):
        dark = ambient[min(r, len(ambient) - 1)]
        bx = np.zeros(columns, np.float32)
        by = np.zeros(columns, np.float32)
        bz = np.zeros(columns, np.float32)
        squares = np.zeros(columns, np.float32)
        for k in range(lights):
            for c in range(columns):
                v = (images[k, r, c] - dark[c]) * gains[k]
                bx[c] += weights[0, k] * v
                by[c] += weights[1, k] * v
                bz[c] += weights[2, k] * v
        # b . X
        inner = np.empty(columns, np.float32)
        for c in range(columns):
            divisor = one - plane[0] * x[c] - plane[1] * y[r]
            inner[c] = (bx[c] * x[c] + by[c] * y[r]) / divisor
        for k in range(lights):
            lx, ly, lz = directions[k]
            for c in range(columns):
                v = (images[k, r, c] - dark[c]) * gains[k]
                error = v - (lx * bx[c] + ly * by[c] + lz * bz[c]) - excess[k] * inner[c]
                squares[c] += error * error
        for c in range(columns):
            residual[r, c] = np.sqrt(squares[c] * share)


@kernel
def compare_with_prediction(
    images: Array, ambient: Array, gains: Array, directions: Array,
    inverse_distances: Array, x: Array, y: Array,
    p: Array, q: Array, albedo: Array, determined: Array, limits: Array,
    shadow_count: Array, highlights: Array,
) -> None:  # fmt: skip
    """Count shadows, and mark highlights from `limits[k]` on, where `determined`.

    The prediction is b . (l - X / R).
    """
    rows, columns = p.shape
    one = np.float32(1.0)
    for r in range(rows):
        dark = ambient[min(r, len(ambient) - 1)]
        scales = np.empty(columns, np.float32)
        for c in range(columns):
            scales[c] = albedo[r, c] / np.sqrt(one + p[r, c] * p[r, c] + q[r, c] * q[r, c])
            shadow_count[r, c] = 0
            highlights[r, c] = False
        for k in range(images.shape[0]):
            lx, ly, lz = directions[k]
            limit, inverse_distance = limits[k], inverse_distances[k]
            for c in range(columns):
                v = (images[k, r, c] - dark[c]) * gains[k]
                inner = x[c] * p[r, c] + y[r] * q[r, c]
                s = scales[c] * (lz - lx * p[r, c] - ly * q[r, c] + inverse_distance * inner)
                rho = albedo[r, c]
                has_slope = determined[r, c]
                shadow_count[r, c] += has_slope & (
                    v <= SHADOW_FRACTION * max(s, SHADOW_FLOOR * rho)
                )
                highlights[r, c] |= has_slope & (v >= limit * max(s, _HIGHLIGHT_FLOOR * rho))


def highlight_limits(
    values: Array, directions: Array, inverse_distances: Array, x: Array, y: Array,
    p: Array, q: Array, albedo: Array,
) -> FloatMap:  # fmt: skip
    """(N,) multiples of the prediction of (N, n) `values`, from which a light is a highlight."""
    predicted = directions @ np.stack([-p, -q, np.ones_like(p)])
    predicted += inverse_distances[:, None] * (p * x + q * y)
    predicted *= albedo
    predicted /= np.sqrt(1.0 + p * p + q * q)
    limits = np.full(len(values), _HIGHLIGHT_FRACTION)
    for k, (light, prediction) in enumerate(zip(values, predicted, strict=True)):
        facing = prediction > _HIGHLIGHT_FLOOR * albedo
        if facing.any():
            ratios = light[facing] / prediction[facing]
            typical = float(np.median(ratios))
            spread = SIGMA_PER_MAD * float(np.median(np.abs(ratios - typical)))
            limits[k] = max(limits[k], typical + _HIGHLIGHT_DEVIATIONS * spread)
    return limits


@kernel
def find_darkest(images: Array, ambient: Array, gains: Array, darkest: Array) -> None:
    """Find the index of the light with the lowest value, the first of equal ones."""
    rows, columns = darkest.shape
    for r in range(rows):
        dark = ambient[min(r, len(ambient) - 1)]
        lowest = np.full(columns, np.float32(np.inf))
        for k in range(images.shape[0]):
            for c in range(columns):
                v = (images[k, r, c] - dark[c]) * gains[k]
                darkest[r, c] = np.uint8(k) if v < lowest[c] else darkest[r, c]
                lowest[c] = min(lowest[c], v)
