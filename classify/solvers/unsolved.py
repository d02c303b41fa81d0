"""The pixels that `in_fill` completes, and how each depends on its neighbours."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from classify.base.arrays import Array
from classify.base.compiling import kernel
from classify.base.threads import run_on_rows

# Marks of `Maps.unlit`: noise makes the slope too uncertain, or a light is saturated. The four
# lowest bits are the lights in shadow or saturated.
LOST, SATURATED = np.uint8(16), np.uint8(32)
NOT_REACHED = np.uint8(255)
# Codes in place of a pair of lights: fewer than two lights, or a pixel that is not changed.
NO_LINE, SKIPPED = np.uint8(6), np.uint8(7)

# Codes in place of a neighbour: it is solved, or it has no slope.
_SOLVED, NOTHING = -1, -2
# Neighbours row by row: nw, n, ne, w, e, sw, s, se. `_BESIDE` marks those that share a side with
# the pixel; the weights are for the first values.
_BESIDE = np.array([0, 1, 0, 1, 1, 0, 1, 0], np.bool_)
FIRST_WEIGHTS = np.where(_BESIDE, 1.0, 0.7).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Unsolved:
    """The pixels to be filled in, row by row, with their lights and neighbours."""

    pixels: Array  # (n,) flat indices, ascending
    lines: Array  # (n, 4) b0 and t of each pixel on its line of scaled normals; t is written
    pairs: Array  # (n,) pair of lights, `NO_LINE`, or `SKIPPED` by `relax`
    along: Array  # (8, 3) direction d of the line of each code in `pairs`
    near: Array  # (n, 8) index of each neighbour in this list, or `_SOLVED` or `NOTHING`; `relax`
    # reads n in place of both
    solved: Array  # (n, 7) sums of solved neighbours: weighted p, q, albedo, 1; parts of the minima
    values: Array  # (n + 1, 3) p, q and albedo, written; the last row is 0
    depth: Array  # (n,) the layer of each pixel, `NOT_REACHED` before; written

    @classmethod
    def of(cls, pixels: Array, lines: Array, pairs: Array, along: Array) -> Self:
        count = len(pixels)
        return cls(
            pixels, lines, pairs, along, np.empty((count, 8), np.int32),
            np.empty((count, 7), np.float32), np.zeros((count + 1, 3), np.float32),
            np.full(count, NOT_REACHED),
        )  # fmt: skip

    def run(self, function: Callable[[int, int], None], strip_px: int) -> None:
        """Call a function for parts of the list."""
        run_on_rows(function, (len(self.pixels), 1), strip_px)


def link(
    unsolved: Unsolved, unlit: Array, curl_weight: np.float32,
    p: Array, q: Array, albedo: Array, strip_px: int,
) -> None:  # fmt: skip
    """Find the neighbours of each pixel, and sum up those that are solved (`unlit` 0)."""
    # Minimised are the squared steps of slope and albedo between neighbours, and the squared curl
    # around each four pixels. At one pixel the minimum of p is a weighted mean of the mean of p at
    # the four neighbours, with weight 1, and, with weight 4 curl_weight, of (2 (p_n + p_s - p_w -
    # p_e) + p_nw + p_ne + p_sw + p_se + q_nw - q_ne - q_sw + q_se) / 4; likewise for q.
    factors = neighbour_factors(curl_weight)

    def link_part(first: int, last: int) -> None:
        _link(
            first, last, unsolved.pixels, unlit, p, q, albedo, factors,
            unsolved.near, unsolved.solved,
        )  # fmt: skip

    unsolved.run(link_part, strip_px)


def neighbour_factors(curl_weight: np.float32) -> Array:
    """(8, 4) factors of the neighbours of `link`: p and q in the minimum of p, q in that of q,
    albedo in its own.
    """
    curl = float(curl_weight)
    vertical, horizontal = 0.25 + 2.0 * curl, 0.25 - 2.0 * curl
    p_in_p = [curl, vertical, curl, horizontal, horizontal, curl, vertical, curl]
    q_in_p = [curl, 0.0, -curl, 0.0, 0.0, -curl, 0.0, curl]
    q_in_q = [curl, horizontal, curl, vertical, vertical, curl, horizontal, curl]
    albedo = np.where(_BESIDE, 0.25, 0.0)
    slopes = np.stack([p_in_p, q_in_p, q_in_q], axis=1) / (1.0 + 4.0 * curl)
    return np.column_stack([slopes, albedo]).astype(np.float32)


@kernel
def _link(
    first: int, last: int, pixels: Array, unlit: Array, p: Array, q: Array, albedo: Array,
    factors: Array, near: Array, solved: Array,
) -> None:  # fmt: skip
    """Find the neighbours of some pixels, and sum up the solved ones."""
    rows, columns = unlit.shape
    # Three pointers move through the sorted list: at the pixel, and in the rows above and below.
    above = np.searchsorted(pixels, pixels[first] - columns - 1)
    below = np.searchsorted(pixels, pixels[first] + columns - 1)
    for n in range(first, last):
        r, c = divmod(pixels[n], columns)
        solved[n] = 0.0
        while above < n and pixels[above] < pixels[n] - columns - 1:
            above += 1
        while below < len(pixels) and pixels[below] < pixels[n] + columns - 1:
            below += 1
        for j in range(8):
            place = j + (j > 3)
            y, x = r + place // 3 - 1, c + place % 3 - 1
            if y < 0 or x < 0 or y >= rows or x >= columns:
                near[n, j] = NOTHING
                continue
            if unlit[y, x] == 0:
                near[n, j] = _SOLVED
                weight = FIRST_WEIGHTS[j]
                solved[n, 0] += weight * p[y, x]
                solved[n, 1] += weight * q[y, x]
                solved[n, 2] += weight * albedo[y, x]
                solved[n, 3] += weight
                solved[n, 4] += factors[j, 0] * p[y, x] + factors[j, 1] * q[y, x]
                solved[n, 5] += factors[j, 1] * p[y, x] + factors[j, 2] * q[y, x]
                solved[n, 6] += factors[j, 3] * albedo[y, x]
                continue
            pixel = y * columns + x
            m = max(n - 1, 0) if y == r else above if y < r else below
            while m < len(pixels) and pixels[m] < pixel:
                m += 1
            near[n, j] = m if m < len(pixels) and pixels[m] == pixel else NOTHING
