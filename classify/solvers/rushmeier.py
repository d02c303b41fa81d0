"""Five lights and more without the lowest and the highest value of each pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from classify.compiling import FAST
from classify.shadow_rule import NO_DROPPED_LIGHT

from .linear import judge_row, solve_lights

__all__ = ["rushmeier"]

Array = npt.NDArray[Any]


@njit(parallel=True, fastmath=FAST, cache=True, error_model="numpy")
def rushmeier(
    images: Array, ambient: Array | None, gains: Array, saturation: np.float32,
    noise_floor: np.float32, inverses: Array, directions: Array,
    p: Array, q: Array, albedo: Array, valid: Array, dropped: Array,
) -> None:  # fmt: skip
    """Drop the lowest and the highest of five or more values, least squares of the rest.

    After Rushmeier, Taubin and Gueziec (1997), who have five lights.

    Parameters
    ----------
    inverses
        (N, N, 3, 3) inverse of L^T L without the two lights, NaN where that is singular; what
        stands at [k, k] is that of all lights.

    Notes
    -----
    Where several lights are equally dark, or equally bright, the mean of their solutions is taken
    (as in `drop_darkest`); where all are equal none stands out and all are used. Saturated lights
    are the highest, however many they are.
    """
    lights = images.shape[0]
    rows, columns = p.shape
    every = np.ones(lights, np.bool_)
    zero, one = np.float32(0.0), np.float32(1.0)
    for r in prange(rows):
        bx = np.zeros(columns, np.float32)
        by = np.zeros(columns, np.float32)
        bz = np.zeros(columns, np.float32)
        lowest = np.full(columns, np.float32(np.inf))
        highest = np.full(columns, np.float32(-np.inf))
        for k in range(lights):
            x, y, z = directions[k]
            gain = gains[k]
            for c in range(columns):
                v = np.float32(images[k, r, c])
                if ambient is not None:
                    v -= np.float32(ambient[r, c])
                v *= gain
                bx[c] += x * v
                by[c] += y * v
                bz[c] += z * v
                lowest[c] = min(lowest[c], v)
                highest[c] = max(highest[c], v)
        # How many lights are as low, and the sum of their indices: where it is one, its index.
        lows = np.zeros(columns, np.float32)
        low = np.zeros(columns, np.float32)
        highs = np.zeros(columns, np.float32)
        high = np.zeros(columns, np.float32)
        brightest = np.zeros(columns, np.float32)
        for k in range(lights):
            gain, index = gains[k], np.float32(k)
            for c in range(columns):
                v = np.float32(images[k, r, c])
                brightest[c] = max(brightest[c], v)
                if ambient is not None:
                    v -= np.float32(ambient[r, c])
                v *= gain
                lows[c] += one if v <= lowest[c] else zero
                low[c] += index if v <= lowest[c] else zero
                highs[c] += one if v >= highest[c] else zero
                high[c] += index if v >= highest[c] else zero
        lost = np.zeros(columns, np.float32)
        for c in range(columns):
            i, j = int(low[c]), int(high[c])
            if brightest[c] >= saturation:
                solved, i, x, y, z = _without_saturated(
                    images, ambient, gains, saturation, directions, r, c
                )
                lost[c] = not solved
                bx[c], by[c], bz[c] = x, y, z
            elif lowest[c] == highest[c]:
                i = NO_DROPPED_LIGHT
                bx[c], by[c], bz[c] = _times(inverses[0, 0], bx[c], by[c], bz[c])
            elif lows[c] > one or highs[c] > one:
                solved, i, x, y, z = _mean_of_ties(
                    images, ambient, gains, inverses, directions, r, c,
                    lowest[c], highest[c], bx[c], by[c], bz[c],
                )  # fmt: skip
                lost[c] = not solved
                bx[c], by[c], bz[c] = x, y, z
            else:
                inverse = inverses[i, j]
                x = bx[c] - lowest[c] * directions[i, 0] - highest[c] * directions[j, 0]
                y = by[c] - lowest[c] * directions[i, 1] - highest[c] * directions[j, 1]
                z = bz[c] - lowest[c] * directions[i, 2] - highest[c] * directions[j, 2]
                if np.isnan(inverse[0, 0]):
                    lost[c] = one
                    bx[c], by[c], bz[c] = zero, zero, zero
                else:
                    bx[c], by[c], bz[c] = _times(inverse, x, y, z)
            dropped[r, c] = i
        judge_row(
            images, ambient, gains, directions, every, r, bx, by, bz,
            np.full(columns, noise_floor), lost, p, q, albedo, valid,
        )  # fmt: skip


@njit(fastmath=FAST, cache=True, error_model="numpy", inline="always")
def _times(
    matrix: Array, x: np.float32, y: np.float32, z: np.float32
) -> tuple[np.float32, np.float32, np.float32]:
    return (
        matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z,
        matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z,
        matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z,
    )


@njit(fastmath=FAST, cache=True, error_model="numpy")
def _without_saturated(
    images: Array, ambient: Array | None, gains: Array, saturation: np.float32,
    directions: Array, r: int, c: int,
) -> tuple[bool, int, np.float32, np.float32, np.float32]:  # fmt: skip
    """Whether there is one, the lowest light, and b from all but that and the saturated ones."""
    lights = images.shape[0]
    used = np.ones(lights, np.bool_)
    low, lowest = 0, np.float32(np.inf)
    for k in range(lights):
        v = np.float32(images[k, r, c])
        used[k] = v < saturation
        if ambient is not None:
            v -= np.float32(ambient[r, c])
        if v * gains[k] < lowest:
            low, lowest = k, v * gains[k]
    used[low] = False
    solved, x, y, z = solve_lights(images, ambient, gains, directions, used, r, c)
    return solved, low, x, y, z


@njit(fastmath=FAST, cache=True, error_model="numpy")
def _mean_of_ties(
    images: Array, ambient: Array | None, gains: Array, inverses: Array, directions: Array,
    r: int, c: int, lowest: np.float32, highest: np.float32,
    sum_x: np.float32, sum_y: np.float32, sum_z: np.float32,
) -> tuple[bool, int, np.float32, np.float32, np.float32]:  # fmt: skip
    """Whether there is one, the first lowest light, and the mean b over all pairs of ties."""
    lights = images.shape[0]
    dark = np.float32(0.0) if ambient is None else np.float32(ambient[r, c])
    count, first = 0, lights
    bx, by, bz = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for i in range(lights):
        if (np.float32(images[i, r, c]) - dark) * gains[i] > lowest:
            continue
        first = min(first, i)
        for j in range(lights):
            if (np.float32(images[j, r, c]) - dark) * gains[j] < highest:
                continue
            inverse = inverses[i, j]
            if not np.isnan(inverse[0, 0]):
                x, y, z = _times(
                    inverse,
                    sum_x - lowest * directions[i, 0] - highest * directions[j, 0],
                    sum_y - lowest * directions[i, 1] - highest * directions[j, 1],
                    sum_z - lowest * directions[i, 2] - highest * directions[j, 2],
                )
                bx += x
                by += y
                bz += z
                count += 1
    share = np.float32(1.0) / np.float32(max(count, 1))
    return count > 0, first, bx * share, by * share, bz * share
