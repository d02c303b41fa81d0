"""The kernels of `in_fill`: unknown slopes as smooth and as free of curl as those around them.

Each kernel runs over a list of pixels ordered by rows. The number of threads changes no bit of the
result.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from classify.compiling import kernel
from classify.threads import run_on_rows

Array = npt.NDArray[Any]

NOT_REACHED = np.uint8(255)
# In place of the index of a pair of lights: fewer than two lights, or a pixel to be left alone.
NO_LINE, SKIPPED = np.uint8(6), np.uint8(7)

# Largest distance from a solved pixel at which slopes are filled in, with one light or none and
# with two. The error grows with it; test_ps4_robust.py limits the error of the slopes.
_REACH_DARK_PX, _REACH_PX = 8, 24
# More steps take more time for less than the noise (test_ps4_robust.py).
_STEPS = 15
# Smallest eigenvalue that is iterated for, as a share of the largest.
_SMALLEST = 0.012
# Smallest z of a normal on the line of two lights: a slope of 75 degrees. The ends of the line are
# steeper, and a camera from above would not see such a surface.
_MIN_NZ = np.float32(0.26)
# Additional weight of the curl, which is zero for every surface, while steps of slope are not.
_CURL = 2.0


@dataclass(frozen=True, eq=False)
class Unsolved:
    """The pixels to be filled in, row by row.

    Attributes
    ----------
    starts, columns
        (H + 1,) where the pixels of each row begin in the list, (n,) the column of each.
    lines
        (n, 4) b0 and t of each pixel on its line of scaled normals; t is written.
    pairs, along
        (n,) the pair of lights of each pixel, or `NO_LINE` or `SKIPPED`, and (7, 3) the direction
        d of the line of each pair. Pixels that `relax` must leave alone become `SKIPPED`.
    depth
        (H, W) 0 where solved, `NOT_REACHED` where listed; written: the layer of each pixel.
    """

    starts: Array
    columns: Array
    lines: Array
    pairs: Array
    along: Array
    depth: Array


@kernel
def neighbour_weights(
    p: Array, q: Array, albedo: Array, depth: Array, squares: Array
) -> tuple[np.float32, np.float32]:
    """Weights of a relative step of albedo and of a curl, relative to a step of slope.

    Each is the inverse of its mean square over squares of four solved pixels (`depth` 0), of which
    `squares` (n, 2) are the row and column with the lowest indices. So the smoother of albedo and
    relief on this surface gets the larger weight, noise included. A step of more than 1 is an edge
    and counts as 1.
    """
    slope, relative, curl, count = 0.0, 0.0, 0.0, 0
    for r, c in squares:
        if depth[r, c] | depth[r, c + 1] | depth[r + 1, c] | depth[r + 1, c + 1]:
            continue
        p_nw, p_ne, p_sw, p_se = p[r, c], p[r, c + 1], p[r + 1, c], p[r + 1, c + 1]
        q_nw, q_ne, q_sw, q_se = q[r, c], q[r, c + 1], q[r + 1, c], q[r + 1, c + 1]
        slope += min((p_ne - p_nw) ** 2, 1.0) + min((q_ne - q_nw) ** 2, 1.0)
        slope += min((p_se - p_sw) ** 2, 1.0) + min((q_se - q_sw) ** 2, 1.0)
        slope += min((p_sw - p_nw) ** 2, 1.0) + min((q_sw - q_nw) ** 2, 1.0)
        slope += min((p_se - p_ne) ** 2, 1.0) + min((q_se - q_ne) ** 2, 1.0)
        nw, ne, sw, se = albedo[r, c], albedo[r, c + 1], albedo[r + 1, c], albedo[r + 1, c + 1]
        relative += ((ne - nw) / (ne + nw)) ** 2 + ((se - sw) / (se + sw)) ** 2
        relative += ((sw - nw) / (sw + nw)) ** 2 + ((se - ne) / (se + ne)) ** 2
        around = (p_sw - p_nw) + (p_se - p_ne) + (q_ne - q_nw) + (q_se - q_sw)
        curl += min(around**2, 1.0)
        count += 1
    if count < 16:
        return np.float32(1.0), np.float32(1.0)
    # There are four steps of albedo, each half of the relative step, to eight steps of slope.
    albedo_weight = slope / max(8.0 * relative, 8e-6 * count)
    curl_weight = _CURL * slope / max(8.0 * curl, 8e-6 * count)
    return np.float32(min(albedo_weight, 100.0)), np.float32(min(curl_weight, 30.0))


@kernel
def _first_on_line(
    lines: Array, n: int, d: Array,
    P: np.float32, Q: np.float32, A: np.float32, albedo_weight: np.float32,
) -> tuple[np.float32, np.float32, np.float32]:  # fmt: skip
    """Find the point of a line that is nearest to slopes P, Q and albedo A.

    The distance in albedo has two minima on a line, one on each side of b0: hence the search.
    """
    one = np.float32(1.0)
    x, y, z = lines[n, 0], lines[n, 1], lines[n, 2]
    # b0 is perpendicular to d, so that |b|^2 = |b0|^2 + t^2.
    square = x * x + y * y + z * z
    start = A / np.sqrt(one + P * P + Q * Q) * (d[2] - P * d[0] - Q * d[1])
    least, best = np.float32(np.inf), np.float32(0.0)
    p, q, rho = P, Q, A
    for i in range(-8, 9):
        t = start + np.float32(0.1875 * i) * A
        length = np.sqrt(square + t * t)
        below = _MIN_NZ * length - z - t * d[2]
        inverse = one / max(z + t * d[2], _MIN_NZ * length)
        slope_x, slope_y = -(x + t * d[0]) * inverse, -(y + t * d[1]) * inverse
        error = (slope_x - P) ** 2 + (slope_y - Q) ** 2 + albedo_weight * (length / A - one) ** 2
        if below > 0.0:
            error += np.float32(1e3) * (one + below / A)
        if error < least:
            least, best = error, t
            p, q, rho = slope_x, slope_y, length
    lines[n, 3] = best
    return p, q, rho


@kernel
def _step_along_line(
    t: np.float32, z: np.float32, d: Array, p: np.float32, q: np.float32, rho: np.float32,
    P: np.float32, Q: np.float32, A: np.float32,
    slope_weight: np.float32, albedo_weight: np.float32,
) -> np.float32:  # fmt: skip
    """Find the Gauss-Newton step of t along a line, from p, q, rho towards P, Q, A.

    `z` is that of b0.
    """
    inverse = np.float32(1.0) / (z + t * d[2])
    dp, dq = -(d[0] + p * d[2]) * inverse, -(d[1] + q * d[2]) * inverse
    dr = t / rho
    relative = albedo_weight / (A * A)
    slope = slope_weight * ((p - P) * dp + (q - Q) * dq) + relative * (rho - A) * dr
    curvature = slope_weight * (dp * dp + dq * dq) + relative * dr * dr
    return np.float32(-slope / curvature)


def grow(
    unsolved: Unsolved, albedo_weight: np.float32, p: Array, q: Array, albedo: Array, strip_px: int
) -> None:
    """Set first values, layer by layer inwards, to the mean of the layers before."""

    def grow_rows(layer: int, counts: list[int], first: int, last: int) -> None:
        count = _grow_layer(
            first, last, layer, unsolved.starts, unsolved.columns, unsolved.lines,
            unsolved.pairs, unsolved.along, albedo_weight, unsolved.depth, p, q, albedo,
        )  # fmt: skip
        counts.append(count)

    for layer in range(1, _REACH_PX + 1):
        counts: list[int] = []
        run_on_rows(partial(grow_rows, layer, counts), p.shape, strip_px)
        if not any(counts):
            break
    _skip_edges(unsolved.starts, unsolved.columns, unsolved.pairs, unsolved.depth)


def relax(
    unsolved: Unsolved, albedo_weight: np.float32, curl_weight: np.float32,
    p: Array, q: Array, albedo: Array, strip_px: int,
) -> None:  # fmt: skip
    """Smooth the values of the unsolved pixels, all of them at once in each step.

    Minimised is the sum of the squared steps of slope and of albedo between neighbours, and of the
    squared curl around each four pixels by the trapezoid rule. At one pixel, with the others held,
    the minimum in p is a weighted mean: of the mean of p at the four neighbours with weight 1, and
    of (2 (p_n + p_s - p_w - p_e) + p_nw + p_ne + p_sw + p_se + q_nw - q_ne - q_sw + q_se) / 4
    with weight 4 curl_weight; likewise for q. A pixel with two lights comes as near to that as its
    line does.

    The steps towards these minima are those of the Chebyshev semi-iteration (Golub and Varga,
    1961): as fast as successive over-relaxation, but without an order of the pixels, which would
    prefer a direction.
    """
    # Largest eigenvalue of the iteration: 2 for the steps between neighbours, 4 for the curl.
    largest = (2.0 + 16.0 * float(curl_weight)) / (1.0 + 4.0 * float(curl_weight))
    middle, radius = 0.5 * largest * (1.0 + _SMALLEST), 0.5 * largest * (1.0 - _SMALLEST)
    moves = np.zeros((len(unsolved.columns), 3), np.float32)
    step, momentum, ratio = 1.0 / middle, 0.0, radius / middle

    def move_rows(step: np.float32, momentum: np.float32, first: int, last: int) -> None:
        _find_moves(
            first, last, unsolved.starts, unsolved.columns, unsolved.lines, unsolved.pairs,
            unsolved.along, albedo_weight, curl_weight, step, momentum, p, q, albedo, moves,
        )  # fmt: skip

    def apply_rows(first: int, last: int) -> None:
        _apply_moves(
            first, last, unsolved.starts, unsolved.columns, unsolved.lines, unsolved.pairs,
            unsolved.along, moves, p, q, albedo,
        )  # fmt: skip

    for _ in range(_STEPS):
        move = partial(move_rows, np.float32(step), np.float32(momentum))
        run_on_rows(move, p.shape, strip_px)
        run_on_rows(apply_rows, p.shape, strip_px)
        previous, ratio = ratio, 1.0 / (2.0 * middle / radius - ratio)
        step, momentum = 2.0 * ratio / radius, ratio * previous


@kernel
def _grow_layer(
    first: int, last: int, layer: int, starts: Array, columns: Array, lines: Array, pairs: Array,
    along: Array, albedo_weight: np.float32, depth: Array, p: Array, q: Array, albedo: Array,
) -> int:  # fmt: skip
    """Give a value to the pixels beside the layers before, and return how many there are."""
    rows, width = p.shape
    reached = 0
    for r in range(first, last):
        for n in range(starts[r], starts[r + 1]):
            c = columns[n]
            dark = pairs[n] >= NO_LINE
            if depth[r, c] != NOT_REACHED or (dark and layer > _REACH_DARK_PX):
                continue
            if pairs[n] == SKIPPED:
                continue
            P, Q, A, total = np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
            for y in range(max(r - 1, 0), min(r + 2, rows)):
                for x in range(max(c - 1, 0), min(c + 2, width)):
                    if depth[y, x] < layer:
                        weight = np.float32(1.0) if y == r or x == c else np.float32(0.7)
                        P += weight * p[y, x]
                        Q += weight * q[y, x]
                        A += weight * albedo[y, x]
                        total += weight
            if total == 0.0:
                continue
            reached += 1
            P /= total
            Q /= total
            A /= total
            if not dark:
                P, Q, A = _first_on_line(lines, n, along[pairs[n]], P, Q, A, albedo_weight)
            depth[r, c] = layer
            p[r, c] = P
            q[r, c] = Q
            albedo[r, c] = A
    return reached


@kernel
def _skip_edges(starts: Array, columns: Array, pairs: Array, depth: Array) -> None:
    """Keep the first values at the border of the frame and beside pixels without a slope."""
    rows, width = depth.shape
    for r in range(rows):
        for n in range(starts[r], starts[r + 1]):
            c = columns[n]
            if r == 0 or c == 0 or r == rows - 1 or c == width - 1:
                pairs[n] = SKIPPED
            for y in range(max(r - 1, 0), min(r + 2, rows)):
                for x in range(max(c - 1, 0), min(c + 2, width)):
                    if depth[y, x] == NOT_REACHED:
                        pairs[n] = SKIPPED


@kernel
def _find_moves(
    first: int, last: int, starts: Array, columns: Array, lines: Array, pairs: Array,
    along: Array, albedo_weight: np.float32, curl_weight: np.float32,
    step: np.float32, momentum: np.float32, p: Array, q: Array, albedo: Array, moves: Array,
) -> None:  # fmt: skip
    """Find the next move of each pixel: in p, q and albedo, or in t along its line."""
    quarter, two = np.float32(0.25), np.float32(2.0)
    slope_weight = np.float32(1.0) + np.float32(4.0) * curl_weight
    for r in range(first, last):
        for n in range(starts[r], starts[r + 1]):
            if pairs[n] == SKIPPED:
                continue
            c = columns[n]
            p_rows, p_columns = p[r - 1, c] + p[r + 1, c], p[r, c - 1] + p[r, c + 1]
            q_rows, q_columns = q[r - 1, c] + q[r + 1, c], q[r, c - 1] + q[r, c + 1]
            p_nw, p_ne, p_sw, p_se = (
                p[r - 1, c - 1], p[r - 1, c + 1], p[r + 1, c - 1], p[r + 1, c + 1]
            )  # fmt: skip
            q_nw, q_ne, q_sw, q_se = (
                q[r - 1, c - 1], q[r - 1, c + 1], q[r + 1, c - 1], q[r + 1, c + 1]
            )  # fmt: skip
            P = quarter * (p_rows + p_columns) + curl_weight * (
                two * (p_rows - p_columns)
                + (p_nw + p_ne + p_sw + p_se)
                + (q_nw - q_ne - q_sw + q_se)
            )
            Q = quarter * (q_rows + q_columns) + curl_weight * (
                two * (q_columns - q_rows)
                + (q_nw + q_ne + q_sw + q_se)
                + (p_nw - p_ne - p_sw + p_se)
            )
            P /= slope_weight
            Q /= slope_weight
            A = quarter * (
                albedo[r - 1, c] + albedo[r + 1, c] + albedo[r, c - 1] + albedo[r, c + 1]
            )
            here_p, here_q, here = p[r, c], q[r, c], albedo[r, c]
            if pairs[n] == NO_LINE:
                moves[n, 0] = step * (P - here_p) + momentum * moves[n, 0]
                moves[n, 1] = step * (Q - here_q) + momentum * moves[n, 1]
                moves[n, 2] = step * (A - here) + momentum * moves[n, 2]
            else:
                towards = _step_along_line(
                    lines[n, 3], lines[n, 2], along[pairs[n]], here_p, here_q, here, P, Q, A,
                    slope_weight, albedo_weight,
                )  # fmt: skip
                moves[n, 0] = step * towards + momentum * moves[n, 0]


@kernel
def _apply_moves(
    first: int, last: int, starts: Array, columns: Array, lines: Array, pairs: Array,
    along: Array, moves: Array, p: Array, q: Array, albedo: Array,
) -> None:  # fmt: skip
    """Apply the moves; one that leaves the allowed part of a line is shortened."""
    for r in range(first, last):
        for n in range(starts[r], starts[r + 1]):
            if pairs[n] == SKIPPED:
                continue
            c = columns[n]
            if pairs[n] == NO_LINE:
                p[r, c] += moves[n, 0]
                q[r, c] += moves[n, 1]
                albedo[r, c] += moves[n, 2]
                continue
            d = along[pairs[n]]
            for _ in range(4):
                t = lines[n, 3] + moves[n, 0]
                bx, by, bz = lines[n, 0] + t * d[0], lines[n, 1] + t * d[1], lines[n, 2] + t * d[2]
                rho = np.sqrt(bx * bx + by * by + bz * bz)
                if bz >= _MIN_NZ * rho:
                    inverse = np.float32(1.0) / bz
                    lines[n, 3] = t
                    p[r, c], q[r, c], albedo[r, c] = -bx * inverse, -by * inverse, rho
                    break
                moves[n, 0] *= np.float32(0.3)
            else:
                moves[n, 0] = 0.0
