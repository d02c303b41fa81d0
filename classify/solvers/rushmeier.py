"""Five lights or more, without the lowest and the highest value of each pixel."""

import numpy as np

from classify.base.arrays import Array, FloatMap
from classify.base.compiling import kernel
from classify.base.errors import InputError
from classify.images import ImageStack
from classify.lighting import Lighting
from classify.lights.algebra import solvable_pinv
from classify.shadow_rule import NO_DROPPED_LIGHT

from .linear import MIN_EIGENVALUE, judge_row, padded_lights, solve_lights
from .problem import Maps, Problem
from .strips import solve_strips


def solve_rushmeier(problem: Problem) -> Maps:
    """Least squares without the lowest and highest of five or more values (Rushmeier 1997)."""
    inverses = _drop_two_inverses(problem.lighting)
    floor = problem.noise_floor(solvable_pinv(problem.lighting.directions, "rushmeier"))
    padded, dropped = padded_lights(problem), np.empty(problem.shape, np.uint8)
    maps = problem.new_maps(left_out=dropped)

    def solve(stack: ImageStack, maps: Maps, first: int, last: int) -> None:
        part = maps.rows(first, last)
        _drop_extremes(
            *stack.float_rows(first, last), *padded, problem.saturation, floor, inverses,
            problem.dark_albedo, part.p, part.q, part.albedo, part.valid, part.dark_counts,
            part.left_out,
        )  # fmt: skip

    solve_strips(problem, maps, solve)
    return maps


def _drop_two_inverses(lighting: Lighting) -> FloatMap:
    """(N, N, 3, 3) inverses of L^T L without lights i and j; NaN if singular."""
    # Entries [i, i] are the inverse for all lights.
    L = lighting.directions
    count = len(L)
    if count < 5:
        raise InputError(
            f"method rushmeier drops 2 of at least 5 lights, this set has {count}; "
            "use ps4_robust for 4"
        )
    outer = L[:, :, None] * L[:, None, :]
    gram = outer.sum(axis=0) - outer[:, None] - outer[None, :]
    gram[np.arange(count), np.arange(count)] = outer.sum(axis=0)
    is_singular = np.linalg.eigvalsh(gram)[..., 0] < MIN_EIGENVALUE
    if is_singular[~np.eye(count, dtype=bool)].all():
        raise InputError(
            "whichever two lights are dropped, the others lie in one plane; rushmeier needs "
            "lights in general position"
        )
    gram[is_singular] = np.eye(3)
    inverses = np.linalg.inv(gram).astype(np.float32)
    inverses[is_singular] = np.nan
    return inverses


@kernel
def _drop_extremes(
    images: Array, ambient: Array, lights: Array, gains: Array, directions: Array,
    saturation: np.float32, noise_floor: np.float32, inverses: Array, dark_albedo: np.float32,
    p: Array, q: Array, albedo: Array, valid: Array, dark_counts: Array, dropped: Array,
) -> None:  # fmt: skip
    """Solve rows without the lowest and highest value of each pixel."""
    # `inverses` (N, N, 3, 3) are those of L^T L without two lights. Saturated values count as the
    # highest.
    rows, columns = p.shape
    floors = np.full(columns, noise_floor)
    zero, one = np.float32(0.0), np.float32(1.0)
    for r in range(rows):
        dark = ambient[min(r, len(ambient) - 1)]
        # L^T i of all lights until the pixel is solved, then its scaled normal b.
        bx = np.zeros(columns, np.float32)
        by = np.zeros(columns, np.float32)
        bz = np.zeros(columns, np.float32)
        lowest = np.full(columns, np.float32(np.inf))
        highest = np.full(columns, np.float32(-np.inf))
        for k in range(len(images)):
            x, y, z = directions[:, k]
            gain = gains[k]
            for c in range(columns):
                v = (images[k, r, c] - dark[c]) * gain
                bx[c] += x * v
                by[c] += y * v
                bz[c] += z * v
                lowest[c] = min(lowest[c], v)
                highest[c] = max(highest[c], v)
        # Number of lights with the lowest value, and the sum of their indices, which is the index
        # of the light if there is only one; likewise for the highest value.
        lowest_count = np.zeros(columns, np.float32)
        lowest_index = np.zeros(columns, np.float32)
        highest_count = np.zeros(columns, np.float32)
        highest_index = np.zeros(columns, np.float32)
        brightest = np.zeros(columns, np.float32)
        for k in range(len(images)):
            gain, index = gains[k], np.float32(k)
            for c in range(columns):
                raw = images[k, r, c]
                brightest[c] = max(brightest[c], raw)
                v = (raw - dark[c]) * gain
                lowest_count[c] += one if v <= lowest[c] else zero
                lowest_index[c] += index if v <= lowest[c] else zero
                highest_count[c] += one if v >= highest[c] else zero
                highest_index[c] += index if v >= highest[c] else zero
        for c in range(columns):
            i, j = int(lowest_index[c]), int(highest_index[c])
            if brightest[c] >= saturation:
                i, x, y, z = _without_saturated(
                    images, dark[c], lights, gains, directions, saturation, r, c
                )
                bx[c], by[c], bz[c] = x, y, z
            elif lowest[c] == highest[c]:
                # All values are equal. The diagonal of `inverses` is that of all lights.
                i = NO_DROPPED_LIGHT
                bx[c], by[c], bz[c] = _times(inverses[0, 0], bx[c], by[c], bz[c])
            elif lowest_count[c] > one or highest_count[c] > one:
                i, x, y, z = _mean_of_ties(
                    images, dark[c], gains, inverses, directions, r, c,
                    lowest[c], highest[c], bx[c], by[c], bz[c],
                )  # fmt: skip
                bx[c], by[c], bz[c] = x, y, z
            else:
                inverse = inverses[i, j]
                x = bx[c] - lowest[c] * directions[0, i] - highest[c] * directions[0, j]
                y = by[c] - lowest[c] * directions[1, i] - highest[c] * directions[1, j]
                z = bz[c] - lowest[c] * directions[2, i] - highest[c] * directions[2, j]
                # NaN: the other lights lie in one plane. b = 0 makes the pixel invalid.
                if np.isnan(inverse[0, 0]):
                    bx[c], by[c], bz[c] = zero, zero, zero
                else:
                    bx[c], by[c], bz[c] = _times(inverse, x, y, z)
            dropped[r, c] = i  # the darkest of the two: see `SurfaceEstimate.dropped`
        judge_row(
            images, dark, lights, gains, directions, r, bx, by, bz, floors, dark_albedo,
            p, q, albedo, valid, dark_counts,
        )  # fmt: skip


@kernel
def _times(
    matrix: Array, x: np.float32, y: np.float32, z: np.float32
) -> tuple[np.float32, np.float32, np.float32]:
    return (
        matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z,
        matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z,
        matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z,
    )


@kernel
def _without_saturated(
    images: Array, dark: np.float32, lights: Array, gains: Array, directions: Array,
    saturation: np.float32, r: int, c: int,
) -> tuple[int, np.float32, np.float32, np.float32]:  # fmt: skip
    """Solve without the lowest and the saturated lights.

    Returns the index of the lowest light, and b, which is 0 if too few lights remain.
    """
    count = len(images)
    used = np.ones(count, np.bool_)
    low, lowest = 0, np.float32(np.inf)
    for k in range(count):
        used[k] = images[k, r, c] < saturation
        v = (images[k, r, c] - dark) * gains[k]
        if v < lowest:
            low, lowest = k, v
    used[low] = False
    _, x, y, z = solve_lights(images, dark, lights, gains, directions, used, r, c)
    return low, x, y, z


@kernel
def _mean_of_ties(
    images: Array, dark: np.float32, gains: Array, inverses: Array, directions: Array,
    r: int, c: int, lowest: np.float32, highest: np.float32,
    sum_x: np.float32, sum_y: np.float32, sum_z: np.float32,
) -> tuple[int, np.float32, np.float32, np.float32]:  # fmt: skip
    """Mean of b over all pairs of a lowest and a highest light that are left out.

    Returns also the index of the first lowest light.
    """
    lights = images.shape[0]
    count, first = 0, lights
    bx, by, bz = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for i in range(lights):
        if (images[i, r, c] - dark) * gains[i] > lowest:
            continue
        first = min(first, i)
        for j in range(lights):
            if (images[j, r, c] - dark) * gains[j] < highest:
                continue
            inverse = inverses[i, j]
            if not np.isnan(inverse[0, 0]):
                x, y, z = _times(
                    inverse,
                    sum_x - lowest * directions[0, i] - highest * directions[0, j],
                    sum_y - lowest * directions[1, i] - highest * directions[1, j],
                    sum_z - lowest * directions[2, i] - highest * directions[2, j],
                )
                bx += x
                by += y
                bz += z
                count += 1
    share = np.float32(1.0) / np.float32(max(count, 1))
    return first, bx * share, by * share, bz * share
