"""The pixels that `in_fill` completes, and how each depends on its neighbours."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from classify.base.arrays import Array
from classify.base.compiling import kernel
from classify.base.threads import run_on_rows

# Bits of `Maps.unlit`. LIGHTS: those of the four lights, set if in shadow or saturated. LOST: noise
# makes the slope too uncertain. SATURATED: one of those lights is saturated.
LIGHTS, LOST, SATURATED = np.uint8(15), np.uint8(16), np.uint8(32)
# Value of `Unsolved.layers` of a pixel in no layer yet.
NOT_REACHED = np.uint8(255)
# Values of `Unsolved.pairs` without a pair of lights: fewer than two lights, or a pixel that keeps
# its initial values.
NO_LINE, SKIPPED = np.uint8(6), np.uint8(7)

# Values of `Unsolved.neighbours` for a neighbour that is solved, and for one without a slope.
_SOLVED, NOTHING = -1, -2
# Neighbours row by row: nw, n, ne, w, e, sw, s, se. `_BESIDE` marks those that share a side with
# the pixel; `FIRST_WEIGHTS` are their weights in its initial values.
_BESIDE = np.array([0, 1, 0, 1, 1, 0, 1, 0], np.bool_)
FIRST_WEIGHTS = np.where(_BESIDE, 1.0, 0.7).astype(np.float32)

PART_PIXELS = 4096
"""Pixels of the part of the list that is passed to a thread.

A step takes 25 ns per pixel, and passing a part 25 us: shorter parts would cost as much as they
save.
"""


@dataclass(frozen=True, eq=False)
class Unsolved:
    """The pixels to be filled in, row by row, with their lights and neighbours."""

    pixels: Array  # (n,) flat indices, ascending
    lines: Array  # (n, 4) b0 and t of each pixel on its line of scaled normals; t is written
    pairs: Array  # (n,) pair of lights, `NO_LINE`, or `SKIPPED` by `relax`
    line_directions: Array  # (8, 3) direction d of the line of each code in `pairs`
    # (n, 8) index of each neighbour in this list, or `_SOLVED` or `NOTHING`; `grow` replaces both
    # by n, the last row of `values`.
    neighbours: Array
    # (n, 7) sums over the solved neighbours: p, q, albedo and 1 by `FIRST_WEIGHTS`, then p, q and
    # albedo by `neighbour_factors`.
    solved_sums: Array
    values: Array  # (n + 1, 3) p, q and albedo, written; the last row is 0
    layers: Array  # (n,) the layer of each pixel, `NOT_REACHED` before; written

    @classmethod
    def of(cls, pixels: Array, lines: Array, pairs: Array, line_directions: Array) -> Self:
        count = len(pixels)
        return cls(
            pixels, lines, pairs, line_directions, np.empty((count, 8), np.int32),
            np.empty((count, 7), np.float32), np.zeros((count + 1, 3), np.float32),
            np.full(count, NOT_REACHED),
        )  # fmt: skip

    def run(self, function: Callable[[int, int], None]) -> None:
        """Call `function(first, last)` for parts of the list, on any number of threads."""
        run_on_rows(function, (len(self.pixels), 1), PART_PIXELS)


def link(
    unsolved: Unsolved, unlit: Array, curl_weight: np.float32, p: Array, q: Array, albedo: Array
) -> None:
    """Find the neighbours of each pixel, and sum up those that are solved (`unlit` 0)."""
    # `relax` minimises the squared differences of slope and albedo between neighbours, and the
    # squared curl of each block of 2 x 2 pixels. At one pixel the best p is a weighted mean of two
    # terms: the mean of p at the four neighbours beside it, with weight 1, and (2 (p_n + p_s - p_w
    # - p_e) + p_nw + p_ne + p_sw + p_se + q_nw - q_ne - q_sw + q_se) / 4, with weight 4
    # curl_weight. Likewise for q.
    factors = neighbour_factors(curl_weight)

    def link_part(first: int, last: int) -> None:
        _link(
            first, last, unsolved.pixels, unlit, p, q, albedo, factors,
            unsolved.neighbours, unsolved.solved_sums,
        )  # fmt: skip

    unsolved.run(link_part)


def neighbour_factors(curl_weight: np.float32) -> Array:
    """(8, 4) factors of p in the best p, q in p, q in q, and albedo in albedo; see `link`.

    The factor of p in the best q is that of q in the best p.
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
    factors: Array, neighbours: Array, solved_sums: Array,
) -> None:  # fmt: skip
    """Find the neighbours of some pixels, and sum up the solved ones."""
    rows, columns = unlit.shape
    # Three pointers move through the sorted list: at the pixel, and in the rows above and below.
    above = np.searchsorted(pixels, pixels[first] - columns - 1)
    below = np.searchsorted(pixels, pixels[first] + columns - 1)
    for n in range(first, last):
        r, c = divmod(pixels[n], columns)
        solved_sums[n] = 0.0
        while above < n and pixels[above] < pixels[n] - columns - 1:
            above += 1
        while below < len(pixels) and pixels[below] < pixels[n] + columns - 1:
            below += 1
        for j in range(8):
            index = j + (j > 3)  # in the 3 x 3 pixels
            y, x = r + index // 3 - 1, c + index % 3 - 1
            if y < 0 or x < 0 or y >= rows or x >= columns:
                neighbours[n, j] = NOTHING
                continue
            if unlit[y, x] == 0:
                neighbours[n, j] = _SOLVED
                weight = FIRST_WEIGHTS[j]
                solved_sums[n, 0] += weight * p[y, x]
                solved_sums[n, 1] += weight * q[y, x]
                solved_sums[n, 2] += weight * albedo[y, x]
                solved_sums[n, 3] += weight
                solved_sums[n, 4] += factors[j, 0] * p[y, x] + factors[j, 1] * q[y, x]
                solved_sums[n, 5] += factors[j, 1] * p[y, x] + factors[j, 2] * q[y, x]
                solved_sums[n, 6] += factors[j, 3] * albedo[y, x]
                continue
            pixel = y * columns + x
            m = max(n - 1, 0) if y == r else above if y < r else below
            while m < len(pixels) and pixels[m] < pixel:
                m += 1
            neighbours[n, j] = m if m < len(pixels) and pixels[m] == pixel else NOTHING
