"""What fewer than three lights leave open, taken from the pixels around.

Two lights leave a line of scaled normals b0 + t d, one or none leaves everything. What is missing
is chosen so that slopes and albedo change as little from pixel to pixel as elsewhere on this
surface, and that the gradient field is one of a surface: dp/dy = dq/dx.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from classify.compiling import FAST
from classify.lighting import Lighting

from .relaxation import NO_LINE, NOT_REACHED, SKIPPED, grow, neighbour_weights, relax
from .robust import LOST

__all__ = ["in_fill"]

Array = npt.NDArray[Any]

_SAMPLES = 16_384
_PAIRS = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
_FIRST, _SECOND = np.transpose(_PAIRS)
# Of the axes, for cross products.
_NEXT, _LAST = [1, 2, 0], [2, 0, 1]


def in_fill(
    images: Array,
    ambient: Array | None,
    gains: npt.NDArray[np.float32],
    saturation: np.float32,
    lighting: Lighting,
    unlit: npt.NDArray[np.uint8],
    row_counts: npt.NDArray[np.int64],
    p: npt.NDArray[np.float32],
    q: npt.NDArray[np.float32],
    albedo: npt.NDArray[np.float32],
    valid: npt.NDArray[np.bool_],
    dropped: npt.NDArray[np.uint8],
    repaired: npt.NDArray[np.bool_],
) -> None:
    """Complete the maps in place where `unlit` is not 0.

    Pixels in two lights become valid unless one was saturated; those in one or none get a slope
    and an albedo, but do not. Nothing is filled in more than 24 px from a solved pixel (8 px with
    one light or none): there p = q = 0.

    Parameters
    ----------
    images, ambient, gains, saturation
        As they were solved; values are (images - ambient) gains.
    unlit, row_counts
        From `robust_kernels.gated`.
    """
    starts = np.concatenate(([0], np.cumsum(row_counts)))
    total = int(starts[-1])
    if total == 0:
        return
    columns = np.empty(total, np.int32)
    lines = np.empty((total, 4), np.float32)
    pairs = np.empty(total, np.uint8)
    depth = np.zeros(unlit.shape, np.uint8)
    solutions, along = _lines_of_two_lights(lighting)
    _list_pixels(
        images, ambient, gains, unlit, starts, solutions, columns, lines, pairs, depth, p, q
    )
    step = max(1, math.isqrt(p.size // _SAMPLES))
    albedo_weight, curl_weight = neighbour_weights(p, q, albedo, depth, step)
    grow(starts, columns, lines, pairs, along, albedo_weight, depth, p, q, albedo)
    relax(starts, columns, lines, pairs, along, albedo_weight, curl_weight, p, q, albedo)
    _mark_pixels(images, saturation, unlit, starts, columns, depth, valid, dropped, repaired)


def _lines_of_two_lights(
    lighting: Lighting,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """(6, 3, 2) b0 = solutions[pair] (i_j, i_k), and (7, 3) unit d with d_z >= 0, 0 for no line.

    b0 is the shortest solution, the pseudo-inverse's, at right angles to d = l_j x l_k.
    """
    first, second = lighting.directions[_FIRST], lighting.directions[_SECOND]
    cosines = (first * second).sum(axis=1, keepdims=True)
    solutions = np.stack([first - cosines * second, second - cosines * first], axis=2)
    solutions /= (1.0 - cosines**2)[..., None]
    along = np.zeros((len(_PAIRS) + 1, 3), np.float32)
    d = first[:, _NEXT] * second[:, _LAST] - first[:, _LAST] * second[:, _NEXT]
    sines = np.sqrt((d * d).sum(axis=1, keepdims=True))
    along[:-1] = d / np.where(d[:, 2:] < 0.0, -sines, sines)
    return solutions.astype(np.float32), along


@njit(fastmath=FAST, cache=True, error_model="numpy", parallel=True)
def _list_pixels(
    images: Array, ambient: Array | None, gains: Array, unlit: Array, starts: Array,
    solutions: Array, columns: Array, lines: Array, pairs: Array, depth: Array, p: Array, q: Array,
) -> None:  # fmt: skip
    """List the pixels row by row, with the pair of lights and the b0 of each."""
    for r in prange(unlit.shape[0]):
        n = starts[r]
        if starts[r + 1] == n:
            continue
        for c in range(unlit.shape[1]):
            bits = unlit[r, c]
            if bits == 0:
                continue
            columns[n] = c
            pairs[n] = SKIPPED if bits == LOST else NO_LINE
            depth[r, c] = NOT_REACHED
            p[r, c] = 0.0
            q[r, c] = 0.0
            pair = 0
            for j in range(3):
                for k in range(j + 1, 4):
                    if 15 ^ (1 << j) ^ (1 << k) == bits:
                        pairs[n] = pair
                        dark = np.float32(0.0) if ambient is None else np.float32(ambient[r, c])
                        first = (np.float32(images[j, r, c]) - dark) * gains[j]
                        second = (np.float32(images[k, r, c]) - dark) * gains[k]
                        for x in range(3):
                            lines[n, x] = (
                                solutions[pair, x, 0] * first + solutions[pair, x, 1] * second
                            )
                    pair += 1
            n += 1


@njit(cache=True, parallel=True)
def _mark_pixels(
    images: Array, saturation: np.float32, unlit: Array, starts: Array, columns: Array,
    depth: Array, valid: Array, dropped: Array, repaired: Array,
) -> None:  # fmt: skip
    """The other maps of the pixels that were filled in."""
    for r in prange(valid.shape[0]):
        for n in range(starts[r], starts[r + 1]):
            c = columns[n]
            bits = unlit[r, c]
            if bits == LOST or depth[r, c] == NOT_REACHED:
                continue
            unlit_lights, first, brightest = 0, 3, np.float32(0.0)
            for k in range(4):
                brightest = max(brightest, np.float32(images[k, r, c]))
                if bits & (1 << k):
                    unlit_lights += 1
                    first = min(first, k)
            dropped[r, c] = first
            repaired[r, c] = True
            valid[r, c] = unlit_lights == 2 and brightest < saturation
