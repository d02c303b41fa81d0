"""Second pass of `ps4_robust`: pixels with fewer than three lights, from those around them.

Two lights leave a line of scaled normals b0 + t d, one light or none leaves slope and albedo open.
They are chosen so that they change as little from pixel to pixel as elsewhere on this surface,
and that the gradient field is one of a surface: dp/dy = dq/dx.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from classify.compiling import kernel
from classify.images.sampling import sample_pixels
from classify.lighting import Lighting
from classify.threads import run_on_rows

from .dark import judge_dark_pixels
from .problem import Maps, Problem
from .relaxation import NO_LINE, NOT_REACHED, SKIPPED, Unsolved, grow, neighbour_weights, relax

Array = npt.NDArray[Any]

# Marks of unsolved pixels: the slope drowns in noise, or a light is saturated. The four lowest bits
# are the lights in shadow or saturated.
LOST, SATURATED = np.uint8(16), np.uint8(32)
_LIGHTS = np.uint8(15)

# Number of squares of four pixels from which the smoothness of the surface is estimated.
_SAMPLES = 16_384
_PAIRS = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
_FIRST, _SECOND = np.transpose(_PAIRS)
# Of the axes, for cross products.
_NEXT, _LAST = [1, 2, 0], [2, 0, 1]


def in_fill(
    problem: Problem,
    maps: Maps,
    unlit: npt.NDArray[np.uint8],
    row_counts: npt.NDArray[np.int64],
    strip_px: int,
) -> None:
    """Complete the maps in place where `unlit` is not 0.

    Pixels in two lights become valid unless one was saturated. Those in one or none get a slope
    and an albedo, but stay invalid. Nothing is filled in more than 24 px from a solved pixel (8 px
    with one light or none), nor at dark pixels that are not valid: there p = q = 0. `row_counts`
    (H,) is the number of pixels to be completed in each row, and `strip_px` that of all pixels in
    a strip of rows.
    """
    dark = judge_dark_pixels(problem, maps)
    unlit.ravel()[dark] = LOST
    row_counts += np.bincount(dark // problem.shape[1], minlength=len(row_counts))
    starts = np.concatenate(([0], np.cumsum(row_counts)))
    total = int(starts[-1])
    if total == 0:
        return
    solutions, along = _lines_of_two_lights(problem.lighting)
    unsolved = Unsolved(
        starts, np.empty(total, np.int32), np.empty((total, 4), np.float32),
        np.empty(total, np.uint8), along, np.zeros(problem.shape, np.uint8),
    )  # fmt: skip

    def list_pixels(first: int, last: int) -> None:
        if starts[first] < starts[last]:
            _list_pixels(
                *problem.stack.float_rows(first, last), problem.gains, problem.dark_level,
                solutions,
                unlit[first:last], starts[first : last + 1], unsolved.columns, unsolved.lines,
                unsolved.pairs, unsolved.depth[first:last], maps.p[first:last], maps.q[first:last],
            )  # fmt: skip

    run_on_rows(list_pixels, problem.shape, strip_px)
    planes = maps.p, maps.q, maps.albedo
    rows, columns = problem.shape
    corners = sample_pixels((rows - 1, columns - 1), _SAMPLES)
    squares = np.stack(np.divmod(corners, max(columns - 1, 1)), axis=1)
    albedo_weight, curl_weight = neighbour_weights(*planes, unsolved.depth, squares)
    # The pixels of a strip that are unsolved are few: larger strips.
    grow(unsolved, albedo_weight, *planes, 4 * strip_px)
    relax(unsolved, albedo_weight, curl_weight, *planes, 4 * strip_px)
    _mark_pixels(
        unlit, starts, unsolved.columns, unsolved.depth, maps.valid, maps.left_out, maps.repaired
    )


def _lines_of_two_lights(
    lighting: Lighting,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """(6, 3, 2) b0 = solutions[pair] (i_j, i_k), and (7, 3) unit d with d_z >= 0, 0 for no line.

    b0 is the shortest solution, that of the pseudo-inverse, perpendicular to d = l_j x l_k.
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


@kernel
def _list_pixels(
    images: Array, ambient: Array, gains: Array, dark_level: np.float32, solutions: Array,
    unlit: Array, starts: Array, columns: Array, lines: Array, pairs: Array, depth: Array,
    p: Array, q: Array,
) -> None:  # fmt: skip
    """List the marked pixels row by row, with the pair of lights and the b0 of each.

    Two lights of a dark pixel are not used (see `dark`): it is marked as without light.
    """
    for r in range(unlit.shape[0]):
        n = starts[r]
        if starts[r + 1] == n:
            continue
        dark = ambient[min(r, len(ambient) - 1)]
        for c in range(unlit.shape[1]):
            if unlit[r, c] == 0:
                continue
            total = np.float32(0.0)
            for k in range(4):
                total += (images[k, r, c] - dark[c]) * gains[k]
            if unlit[r, c] != LOST and total < np.float32(4.0) * dark_level:
                unlit[r, c] |= _LIGHTS
            columns[n] = c
            pairs[n] = SKIPPED if unlit[r, c] == LOST else NO_LINE
            depth[r, c] = NOT_REACHED
            p[r, c] = 0.0
            q[r, c] = 0.0
            lit = _LIGHTS ^ (unlit[r, c] & _LIGHTS)
            pair = 0
            for j in range(3):
                for k in range(j + 1, 4):
                    if lit == (1 << j) | (1 << k):
                        pairs[n] = pair
                        first = (images[j, r, c] - dark[c]) * gains[j]
                        second = (images[k, r, c] - dark[c]) * gains[k]
                        for x in range(3):
                            lines[n, x] = (
                                solutions[pair, x, 0] * first + solutions[pair, x, 1] * second
                            )
                    pair += 1
            n += 1


@kernel
def _mark_pixels(
    unlit: Array, starts: Array, columns: Array, depth: Array,
    valid: Array, left_out: Array, repaired: Array,
) -> None:  # fmt: skip
    """Complete the other maps of the pixels that were filled in."""
    for r in range(valid.shape[0]):
        for n in range(starts[r], starts[r + 1]):
            c = columns[n]
            bits = unlit[r, c]
            if bits == LOST or depth[r, c] == NOT_REACHED:
                continue
            unlit_lights, first = 0, 3
            for k in range(4):
                if bits & (1 << k):
                    unlit_lights += 1
                    first = min(first, k)
            left_out[r, c] = first
            repaired[r, c] = True
            valid[r, c] = unlit_lights == 2 and bits & SATURATED == 0
