"""Four lights or more, without those whose values are inconsistent with the others."""

from typing import Any

import numpy as np
import numpy.typing as npt

from classify.compiling import kernel
from classify.images.noise import BEYOND_NOISE, chi_squared
from classify.lights.algebra import least_squares_weights
from classify.shadow_rule import NO_DROPPED_LIGHT, SHADOW_FRACTION
from classify.threads import run_on_rows

from .linear import judge_row, solve_lights
from .problem import Maps, Problem, slope_noise
from .robust import DARK, LEAK, TOLERANCE

Array = npt.NDArray[Any]


def solve_drbohlav(problem: Problem) -> Maps:
    """Replace values that are inconsistent with the rest by their prediction, solve from all.

    After Drbohlav and Leonardis (1998) and Barsky and Petrou (2003); four lights or more. Four
    light vectors are linearly dependent, l_k = sum c_j l_j, and so are the values of a Lambertian
    pixel without shadow or highlight, i_k = sum c_j i_j. A value replaced by the prediction of the
    others has no residual, so that the solution from all is that of the others: the light is left
    out.
    """
    weights = least_squares_weights(problem.lighting, "drbohlav")
    least_bz, limits = slope_noise(weights), gates(len(problem.lighting))
    dropped, highlights = np.empty(problem.shape, np.uint8), np.empty(problem.shape, np.bool_)
    maps = problem.new_maps(left_out=dropped, highlights=highlights)

    def solve(first: int, last: int) -> None:
        _drop_inconsistent(
            *problem.stack.float_rows(first, last), problem.gains, problem.saturation,
            problem.variance, problem.frames, least_bz, limits, weights, problem.directions,
            *maps.slope_rows(first, last), dropped[first:last], highlights[first:last],
        )  # fmt: skip

    run_on_rows(solve, problem.shape)
    return maps


def gates(lights: int) -> npt.NDArray[np.float32]:
    """(N + 1,) largest sum of squared residuals of n lights that is noise, in variances.

    The 99.7 % quantile of chi-squared with n - 3 degrees of freedom: 9 for four lights; infinite
    for three, which always agree.
    """
    limits = [np.inf if n < 4 else chi_squared(n - 3, BEYOND_NOISE) for n in range(lights + 1)]
    return np.array(limits, np.float32)


@kernel
def _drop_inconsistent(
    images: Array, ambient: Array, gains: Array, saturation: np.float32,
    noise: Array, frames: np.float32, least_bz: np.float32, gates: Array, weights: Array,
    directions: Array,
    p: Array, q: Array, albedo: Array, valid: Array, dropped: Array, highlights: Array,
) -> None:  # fmt: skip
    """Solve rows from all lights, or without those that are inconsistent.

    `noise`, `frames` and `least_bz` are those of `robust._gate`, with sigma the rms noise of the
    values.
    """
    lights = images.shape[0]
    rows, columns = p.shape
    a, slope, black = noise
    zero = np.float32(0.0)
    every = np.ones(lights, np.bool_)
    for r in range(rows):
        dark = ambient[min(r, len(ambient) - 1)]
        bx = np.zeros(columns, np.float32)
        by = np.zeros(columns, np.float32)
        bz = np.zeros(columns, np.float32)
        squares = np.zeros(columns, np.float32)
        variance = np.zeros(columns, np.float32)
        brightest = np.zeros(columns, np.float32)
        most = np.zeros(columns, np.float32)
        lost = np.zeros(columns, np.float32)
        for k in range(lights):
            share = gains[k] * gains[k] / np.float32(lights)
            for c in range(columns):
                raw = images[k, r, c]
                brightest[c] = max(brightest[c], raw)
                variance[c] += share * (a + slope * max(raw - black, zero))
                v = (raw - dark[c]) * gains[k]
                most[c] = max(most[c], v)
                bx[c] += weights[0, k] * v
                by[c] += weights[1, k] * v
                bz[c] += weights[2, k] * v
        for k in range(lights):
            x, y, z = directions[k]
            for c in range(columns):
                s = x * bx[c] + y * by[c] + z * bz[c]
                squares[c] += ((images[k, r, c] - dark[c]) * gains[k] - s) ** 2
        for c in range(columns):
            dropped[r, c] = NO_DROPPED_LIGHT
            highlights[r, c] = False
            gate = gates[lights] * variance[c] + (TOLERANCE * most[c]) ** 2
            if squares[c] > gate or brightest[c] >= saturation:
                dark_variance = frames * (a + slope * max(dark[c] - black, zero))
                solved, dropped[r, c], highlights[r, c], x, y, z = _replace(
                    images, dark[c], dark_variance, gains, saturation, gates, directions,
                    variance[c], r, c,
                )  # fmt: skip
                lost[c] = not solved
                bx[c], by[c], bz[c] = x, y, z
        floors = least_bz * np.sqrt(variance)
        judge_row(
            images, dark, gains, directions, every, r, bx, by, bz, floors, lost, p, q, albedo, valid
        )


@kernel
def _replace(
    images: Array, dark: np.float32, dark_variance: np.float32, gains: Array,
    saturation: np.float32, gates: Array, directions: Array, variance: np.float32, r: int, c: int,
) -> tuple[bool, int, bool, np.float32, np.float32, np.float32]:  # fmt: skip
    """Leave out one light after the other until the rest agree.

    Dark lights go first. Of five lights and more, the one goes whose absence leaves the smallest
    residuals. Of four lights any three agree: there the darkest goes if it is dark, else the
    darkest light that is too dark or the brightest that is too bright: the one without which the
    surface is flatter (as in `robust._settle_row`).

    Returns
    -------
    Whether the rest determine the pixel, the first light left out, if one was a highlight, and b.
    """
    lights = images.shape[0]
    used = np.ones(lights, np.bool_)
    values = np.empty(lights, np.float32)
    first, highlight, remaining = NO_DROPPED_LIGHT, False, lights
    for k in range(lights):
        raw = images[k, r, c]
        values[k] = (raw - dark) * gains[k]
        if raw >= saturation:
            used[k] = False
            remaining -= 1
            first = min(first, k)
    brightest, second = np.float32(0.0), np.float32(0.0)
    for k in range(lights):
        second = max(second, min(brightest, values[k]))
        brightest = max(brightest, values[k])
    dark_level = DARK * np.sqrt(dark_variance)
    levels = np.maximum(np.minimum(dark_level * gains, SHADOW_FRACTION * brightest), LEAK * second)
    tolerance = TOLERANCE * brightest
    solved, bx, by, bz = solve_lights(images, dark, gains, directions, used, r, c)
    while solved and remaining > 3:
        squares = np.float32(0.0)
        for k in range(lights):
            if used[k]:
                squares += (values[k] - _dot(directions, k, bx, by, bz)) ** 2
        if squares <= gates[remaining] * variance + tolerance * tolerance:
            break
        any_dark = False
        for k in range(lights):
            any_dark |= used[k] and values[k] <= levels[k]
        chosen, least, low, high = -1, np.float32(np.inf), -1, -1
        for k in range(lights):
            if not used[k] or (any_dark and values[k] > levels[k]):
                continue
            if remaining == 4:
                # The residuals do not decide: any three lights agree.
                error = values[k] - _dot(directions, k, bx, by, bz)
                if any_dark and values[k] < least:
                    chosen, least = k, values[k]
                if error < 0.0 and (low < 0 or values[k] < values[low]):
                    low = k
                if error > 0.0 and (high < 0 or values[k] > values[high]):
                    high = k
                continue
            used[k] = False
            possible, x, y, z = solve_lights(images, dark, gains, directions, used, r, c)
            if possible:
                squares = np.float32(0.0)
                for j in range(lights):
                    if used[j]:
                        squares += (values[j] - _dot(directions, j, x, y, z)) ** 2
                if squares < least:
                    chosen, least = k, squares
            used[k] = True
        if chosen < 0 and low >= 0:
            chosen = low
            steep = _steepness(images, dark, gains, directions, used, low, r, c)
            if _steepness(images, dark, gains, directions, used, high, r, c) < steep:
                chosen = high
        if chosen < 0:
            break
        predicted = _dot(directions, chosen, bx, by, bz)
        used[chosen] = False
        possible, x, y, z = solve_lights(images, dark, gains, directions, used, r, c)
        if not possible:
            break
        bx, by, bz = x, y, z
        remaining -= 1
        first = chosen if first == NO_DROPPED_LIGHT else first
        highlight |= values[chosen] > max(predicted, LEAK * second)
    return solved, first, highlight, bx, by, bz


@kernel
def _dot(directions: Array, k: int, x: np.float32, y: np.float32, z: np.float32) -> np.float32:
    return np.float32(directions[k, 0] * x + directions[k, 1] * y + directions[k, 2] * z)


@kernel
def _steepness(
    images: Array, dark: np.float32, gains: Array, directions: Array, used: Array,
    without: int, r: int, c: int,
) -> np.float32:  # fmt: skip
    """Squared slope of the surface without one more light, infinite if that cannot be solved."""
    if without < 0:
        return np.float32(np.inf)
    used[without] = False
    solved, x, y, z = solve_lights(images, dark, gains, directions, used, r, c)
    used[without] = True
    if not solved or z <= 0.0:
        return np.float32(np.inf)
    return np.float32((x * x + y * y) / (z * z))
