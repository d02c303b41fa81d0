"""Kernels of `in_fill`: unknown slopes, as smooth and curl-free as the known ones.

Two lights fix the scaled normal of a pixel to a line b = b0 + t d: the pixel moves along it. Pixels
with fewer lights move freely. Each kernel runs over a list of pixels. The number of threads changes
no bit of the result.
"""

from functools import partial

import numpy as np

from classify.base.arrays import Array
from classify.base.compiling import kernel, kernel_part

from .unsolved import (
    FIRST_WEIGHTS,
    NO_LINE,
    NOT_REACHED,
    NOTHING,
    SKIPPED,
    Unsolved,
    neighbour_factors,
)

# Largest distance from a solved pixel at which slopes are filled in: with one light or none, and
# with two lights. The error grows with it; test_ps4_robust.py limits the error of the slopes.
_REACH_DARK_PX, _REACH_PX = 8, 24
# Further iterations change slopes by less than the noise (test_ps4_robust.py limits the errors).
_ITERATIONS = 15
# Smallest eigenvalue that the Chebyshev iteration damps, as a share of the largest; it belongs to
# errors about ten pixels wide. A smaller one leaves more error in narrow shadows after the same
# number of iterations.
_LEAST_EIGENVALUE = 0.012
# Smallest z of a normal on the line of two lights: a slope of 75 degrees. The ends of the line are
# steeper, and a camera from above would not see such a surface.
_MIN_NZ = np.float32(0.26)
# Squared slope by which a move along a line may overshoot, as accelerated moves do at first. With
# more they diverge, with less they stop early (evidence.true_normals, thirty textures at slant 70).
_OVERSHOOT = np.float32(0.01)
# Pixels per block of `_move`; its 18 float32 buffers of this length fit in a first-level cache.
_BLOCK = 256
# Factor on the weight of the curl: every surface has zero curl, but not zero differences of slope.
_CURL_WEIGHT = 2.0
# Caps of the weights. The first binds on even albedo: at 50, 100, 200 and 1000 the rms slope error
# of filled pixels is 0.084, 0.079, 0.077 and 0.077 (mean of rock, sand, malv and ogil as in
# evidence.true_normals, slant 70), on ogil 0.103, 0.098, 0.100 and 0.106. The second binds only
# without noise: on these surfaces the weight of the curl is 9 to 25.
_MAX_ALBEDO_WEIGHT, _MAX_CURL_WEIGHT = 100.0, 30.0


_Vector3 = tuple[np.float32, np.float32, np.float32]
_Vector4 = tuple[np.float32, np.float32, np.float32, np.float32]


@kernel
def neighbour_weights(
    p: Array, q: Array, albedo: Array, unlit: Array, corners: Array
) -> tuple[np.float32, np.float32]:
    """Weights of squared steps of albedo and of squared curl, relative to squared steps of slope.

    They are from the means over solved blocks of 2 x 2 pixels with upper left `corners` (n, 2).
    """
    # Sums over blocks of squared steps: eight of slope, one of curl. Four terms of albedo, squares
    # of half a relative step, count as one step.
    slope, albedo_step, curl, count = 0.0, 0.0, 0.0, 0
    for r, c in corners:
        if unlit[r, c] | unlit[r, c + 1] | unlit[r + 1, c] | unlit[r + 1, c + 1]:
            continue
        p_nw, p_ne, p_sw, p_se = p[r, c], p[r, c + 1], p[r + 1, c], p[r + 1, c + 1]
        q_nw, q_ne, q_sw, q_se = q[r, c], q[r, c + 1], q[r + 1, c], q[r + 1, c + 1]
        slope += min((p_ne - p_nw) ** 2, 1.0) + min((q_ne - q_nw) ** 2, 1.0)
        slope += min((p_se - p_sw) ** 2, 1.0) + min((q_se - q_sw) ** 2, 1.0)
        slope += min((p_sw - p_nw) ** 2, 1.0) + min((q_sw - q_nw) ** 2, 1.0)
        slope += min((p_se - p_ne) ** 2, 1.0) + min((q_se - q_ne) ** 2, 1.0)
        nw, ne, sw, se = albedo[r, c], albedo[r, c + 1], albedo[r + 1, c], albedo[r + 1, c + 1]
        albedo_step += ((ne - nw) / (ne + nw)) ** 2 + ((se - sw) / (se + sw)) ** 2
        albedo_step += ((sw - nw) / (sw + nw)) ** 2 + ((se - ne) / (se + ne)) ** 2
        circulation = (p_sw - p_nw) + (p_se - p_ne) + (q_ne - q_nw) + (q_se - q_sw)
        curl += min(circulation**2, 1.0)
        count += 1
    if count < 16:  # too few blocks for a mean
        return np.float32(1.0), np.float32(1.0)
    # Ratios of mean squares, with an rms of 0.001 as the floor of albedo and curl.
    albedo_weight = slope / max(8.0 * albedo_step, 8e-6 * count)
    curl_weight = _CURL_WEIGHT * slope / max(8.0 * curl, 8e-6 * count)
    return (
        np.float32(min(albedo_weight, _MAX_ALBEDO_WEIGHT)),
        np.float32(min(curl_weight, _MAX_CURL_WEIGHT)),
    )


@kernel_part
def _line(lines: Array, n: int) -> _Vector4:
    """A line and its t as scalars: arrays cost the functions below a fifth of their time."""
    return lines[n, 0], lines[n, 1], lines[n, 2], lines[n, 3]


@kernel_part
def _direction(line_directions: Array, pair: np.uint8) -> _Vector3:
    return line_directions[pair, 0], line_directions[pair, 1], line_directions[pair, 2]


@kernel
def _first_on_line(
    line: _Vector4, d: _Vector3,
    P: np.float32, Q: np.float32, A: np.float32, albedo_weight: np.float32,
) -> _Vector4:  # fmt: skip
    """Slopes, albedo and t of the point of a line that is nearest to slopes P, Q and albedo A."""
    # It is found by a search over 17 values of t.
    one = np.float32(1.0)
    x, y, z, _ = line
    # b0 is perpendicular to d, so that |b|^2 = |b0|^2 + t^2.
    square = x * x + y * y + z * z
    start = A / np.sqrt(one + P * P + Q * Q) * (d[2] - P * d[0] - Q * d[1])
    smallest_error, best_t = np.float32(np.inf), np.float32(0.0)
    p, q, rho = P, Q, A
    # From -1.5 A to 1.5 A around the projection of the target on d; `relax` refines the result.
    for i in range(-8, 9):
        t = start + np.float32(0.1875 * i) * A
        length = np.sqrt(square + t * t)
        z_deficit = _MIN_NZ * length - z - t * d[2]
        inverse = one / max(z + t * d[2], _MIN_NZ * length)
        slope_x, slope_y = -(x + t * d[0]) * inverse, -(y + t * d[1]) * inverse
        error = (slope_x - P) ** 2 + (slope_y - Q) ** 2 + albedo_weight * (length / A - one) ** 2
        if z_deficit > 0.0:
            # Steeper than `_MIN_NZ`: chosen only if all other points are as well.
            error += np.float32(1e3) * (one + z_deficit / A)
        if error < smallest_error:
            smallest_error, best_t = error, t
            p, q, rho = slope_x, slope_y, length
    return p, q, rho, best_t


@kernel_part
def _step_along_line(
    line: _Vector4, d: _Vector3, start: _Vector3, target: _Vector3,
    slope_weight: np.float32, albedo_weight: np.float32,
) -> np.float32:  # fmt: skip
    """Gauss-Newton step of t along a line, from slopes and albedo `start` towards `target`."""
    (p, q, rho), (P, Q, A), (_, _, z, t) = start, target, line
    inverse = np.float32(1.0) / (z + t * d[2])
    dp, dq = -(d[0] + p * d[2]) * inverse, -(d[1] + q * d[2]) * inverse
    dr = t / rho
    relative = albedo_weight / (A * A)
    gradient = slope_weight * ((p - P) * dp + (q - Q) * dq) + relative * (rho - A) * dr
    curvature = slope_weight * (dp * dp + dq * dq) + relative * dr * dr
    return np.float32(-gradient / curvature)


@kernel_part
def _moved_along_line(
    line: _Vector4, d: _Vector3, move: np.float32, start: _Vector3, target: _Vector3,
    slope_weight: np.float32, albedo_weight: np.float32,
) -> tuple[_Vector3, bool]:  # fmt: skip
    """Slopes and albedo after a move of t, and whether the move is allowed."""
    # An allowed move stays on the visible part of the line, and does not overshoot.
    (p, q, rho), (P, Q, A), (x, y, z, t) = start, target, line
    relative = albedo_weight / (A * A)
    error = slope_weight * ((p - P) ** 2 + (q - Q) ** 2) + relative * (rho - A) ** 2
    error += slope_weight * _OVERSHOOT
    t += move
    bx, by, bz = x + t * d[0], y + t * d[1], z + t * d[2]
    length = np.sqrt(bx * bx + by * by + bz * bz)
    inverse = np.float32(1.0) / bz
    slope_x, slope_y = -bx * inverse, -by * inverse
    slopes = (slope_x - P) ** 2 + (slope_y - Q) ** 2
    after = slope_weight * slopes + relative * (length - A) ** 2
    return (slope_x, slope_y, length), (bz >= _MIN_NZ * length) & (after <= error)


def grow(unsolved: Unsolved, albedo_weight: np.float32) -> None:
    """Initialise unsolved pixels layer by layer, each from the mean of its neighbours."""

    def grow_part(layer: int, counts: list[int], first: int, last: int) -> None:
        count = _grow_layer(
            first, last, layer, unsolved.lines, unsolved.pairs, unsolved.line_directions,
            unsolved.neighbours, unsolved.solved_sums, albedo_weight, unsolved.values,
            unsolved.layers,
        )  # fmt: skip
        counts.append(count)

    for layer in range(1, _REACH_PX + 1):
        counts: list[int] = []
        unsolved.run(partial(grow_part, layer, counts))
        if not any(counts):
            break
    _skip_edges(unsolved.neighbours, unsolved.pairs, unsolved.layers)


def relax(unsolved: Unsolved, albedo_weight: np.float32, curl_weight: np.float32) -> None:
    """Minimise squared differences of neighbours, and squared curl, over the unsolved pixels."""
    # Chebyshev semi-iteration (Golub and Varga 1961) on the equations of `link`: all pixels move at
    # once, so no direction is preferred. The largest eigenvalue is the weighted mean of 2, of
    # differences between neighbours with weight 1, and 4, of the curl with weight 4 curl_weight.
    largest = (2.0 + 16.0 * float(curl_weight)) / (1.0 + 4.0 * float(curl_weight))
    middle = 0.5 * largest * (1.0 + _LEAST_EIGENVALUE)
    radius = 0.5 * largest * (1.0 - _LEAST_EIGENVALUE)
    step, momentum, ratio = np.float32(1.0 / middle), np.float32(0.0), radius / middle
    factors, moves = neighbour_factors(curl_weight), np.zeros_like(unsolved.values)
    values, new_values = unsolved.values.copy(), unsolved.values

    def move_part(first: int, last: int) -> None:
        _move(
            first, last, unsolved.lines, unsolved.pairs, unsolved.line_directions,
            unsolved.neighbours, unsolved.solved_sums, factors, albedo_weight, curl_weight, step,
            momentum, values, moves, new_values,
        )  # fmt: skip

    for _ in range(_ITERATIONS):
        unsolved.run(move_part)
        values, new_values = new_values, values
        previous, ratio = ratio, 1.0 / (2.0 * middle / radius - ratio)
        step, momentum = np.float32(2.0 * ratio / radius), np.float32(ratio * previous)
    unsolved.values[:] = values


@kernel
def _grow_layer(
    first: int, last: int, layer: int, lines: Array, pairs: Array, line_directions: Array,
    neighbours: Array, solved_sums: Array, albedo_weight: np.float32, values: Array, layers: Array,
) -> int:  # fmt: skip
    """Initialise the pixels beside the layers before, and return their number."""
    reached = 0
    for n in range(first, last):
        dark = pairs[n] >= NO_LINE
        if layers[n] != NOT_REACHED or (dark and layer > _REACH_DARK_PX):
            continue
        P, Q, A, total = solved_sums[n, 0], solved_sums[n, 1], solved_sums[n, 2], solved_sums[n, 3]
        for j in range(8):
            m = neighbours[n, j]
            if m >= 0 and layers[m] < layer:
                weight = FIRST_WEIGHTS[j]
                P += weight * values[m, 0]
                Q += weight * values[m, 1]
                A += weight * values[m, 2]
                total += weight
        if total == 0.0:
            continue
        reached += 1
        P /= total
        Q /= total
        A /= total
        if not dark:
            line, d = _line(lines, n), _direction(line_directions, pairs[n])
            P, Q, A, lines[n, 3] = _first_on_line(line, d, P, Q, A, albedo_weight)
        layers[n] = layer
        values[n, 0], values[n, 1], values[n, 2] = P, Q, A
    return reached


@kernel
def _skip_edges(neighbours: Array, pairs: Array, layers: Array) -> None:
    """Mark pixels at the border of the frame, and beside pixels without a slope, as `SKIPPED`."""
    for n in range(len(pairs)):
        for j in range(8):
            m = neighbours[n, j]
            if m == NOTHING or (m >= 0 and layers[m] == NOT_REACHED):
                pairs[n] = SKIPPED
            # The last row of `values` is 0: this neighbour adds nothing.
            if m < 0:
                neighbours[n, j] = len(pairs)
        if layers[n] == NOT_REACHED:
            pairs[n] = SKIPPED


@kernel
def _move(
    first: int, last: int, lines: Array, pairs: Array, line_directions: Array, neighbours: Array,
    solved_sums: Array, factors: Array, albedo_weight: np.float32, curl_weight: np.float32,
    step: np.float32, momentum: np.float32, values: Array, moves: Array, new_values: Array,
) -> None:  # fmt: skip
    """Move each pixel from `values` to `new_values`: in p, q and albedo, or in t along its line."""
    slope_weight = np.float32(1.0) + np.float32(4.0) * curl_weight
    # The compiler knows that these copies do not overlap, and vectorises the second loop.
    x, y, z, t, dx, dy, dz, p, q, rho, P, Q, A, move, new_p, new_q, new_rho, allowed = np.empty(
        (18, _BLOCK), np.float32
    )
    for begin in range(first, last, _BLOCK):
        count = min(_BLOCK, last - begin)
        for i in range(count):
            n = begin + i
            x[i], y[i], z[i], t[i] = _line(lines, n)
            dx[i], dy[i], dz[i] = _direction(line_directions, pairs[n])
            p[i], q[i], rho[i] = values[n, 0], values[n, 1], values[n, 2]
            P_sum, Q_sum, A_sum = solved_sums[n, 4], solved_sums[n, 5], solved_sums[n, 6]
            for j in range(8):
                m = neighbours[n, j]
                P_sum += factors[j, 0] * values[m, 0] + factors[j, 1] * values[m, 1]
                Q_sum += factors[j, 1] * values[m, 0] + factors[j, 2] * values[m, 1]
                A_sum += factors[j, 3] * values[m, 2]
            P[i], Q[i], A[i], move[i] = P_sum, Q_sum, A_sum, momentum * moves[n, 0]
        for i in range(count):
            line, d = (x[i], y[i], z[i], t[i]), (dx[i], dy[i], dz[i])
            start, target = (p[i], q[i], rho[i]), (P[i], Q[i], A[i])
            move[i] += step * _step_along_line(line, d, start, target, slope_weight, albedo_weight)
            (new_p[i], new_q[i], new_rho[i]), is_allowed = _moved_along_line(
                line, d, move[i], start, target, slope_weight, albedo_weight
            )
            allowed[i] = np.float32(1.0) if is_allowed else np.float32(0.0)
        for i in range(count):
            n = begin + i
            if pairs[n] == SKIPPED:
                continue
            start, target = (p[i], q[i], rho[i]), (P[i], Q[i], A[i])
            if pairs[n] == NO_LINE:
                for k in range(3):
                    moves[n, k] = step * (target[k] - start[k]) + momentum * moves[n, k]
                    new_values[n, k] = start[k] + moves[n, k]
                continue
            line, d = (x[i], y[i], z[i], t[i]), (dx[i], dy[i], dz[i])
            shorter, end, is_allowed = move[i], (new_p[i], new_q[i], new_rho[i]), allowed[i] > 0.0
            # Backtracking line search.
            for _ in range(3):
                if is_allowed:
                    break
                shorter *= np.float32(0.3)
                end, is_allowed = _moved_along_line(
                    line, d, shorter, start, target, slope_weight, albedo_weight
                )
            if not is_allowed:
                shorter, end = np.float32(0.0), start
            moves[n, 0] = shorter
            new_values[n, 0], new_values[n, 1], new_values[n, 2] = end
            lines[n, 3] = t[i] + shorter
