"""Least squares of four lights or more, without lights that are inconsistent with the others."""

import numpy as np

from classify.base.arrays import Array, FloatMap
from classify.base.compiling import kernel
from classify.base.errors import InputError
from classify.images import BEYOND_NOISE, ImageStack, chi_squared
from classify.lights.algebra import solvable_pinv
from classify.shadow_rule import DARK, LEAK, NO_DROPPED_LIGHT, SHADOW_FRACTION

from .linear import invert, judge_row, least_determinant, padded_lights, solve_lights
from .problem import Maps, Problem, noise_floor_factor
from .robust import TOLERANCE
from .strips import solve_strips


def solve_drbohlav(problem: Problem) -> Maps:
    """Least squares without values that break the linear dependence of four lights."""
    # Drbohlav and Leonardis 1998, Barsky and Petrou 2003.
    count = len(problem.lighting)
    if count < 4:
        raise InputError(
            f"method drbohlav compares at least 4 lights, this set has {count}; use least_squares"
        )
    weights = solvable_pinv(problem.lighting.directions, "drbohlav")
    least_bz, limits = noise_floor_factor(weights), residual_limits(count)
    padded = padded_lights(problem)
    dropped, highlights = np.empty(problem.shape, np.uint8), np.empty(problem.shape, np.bool_)
    maps = problem.new_maps(left_out=dropped, highlights=highlights)

    def solve(stack: ImageStack, maps: Maps, first: int, last: int) -> None:
        part = maps.rows(first, last)
        _drop_inconsistent(
            *stack.float_rows(first, last), *padded, problem.saturation,
            problem.noise_coefficients, problem.frames, least_bz, limits, weights,
            problem.dark_albedo, part.p, part.q, part.albedo, part.valid, part.dark_counts,
            part.left_out, part.highlights,
        )  # fmt: skip

    solve_strips(problem, maps, solve)
    return maps


def residual_limits(lights: int) -> FloatMap:
    """(N + 1,) limits of the squared residuals of n lights, over the noise variance."""
    # 99.7 % of chi-squared of n - 3 degrees of freedom; infinite up to n = 3.
    limits = [np.inf if n < 4 else chi_squared(n - 3, BEYOND_NOISE) for n in range(lights + 1)]
    return np.array(limits, np.float32)


@kernel
def _drop_inconsistent(
    images: Array, ambient: Array, lights: Array, gains: Array, directions: Array,
    saturation: np.float32, noise: Array, frames: np.float32, least_bz: np.float32,
    limits: Array, weights: Array, dark_albedo: np.float32,
    p: Array, q: Array, albedo: Array, valid: Array, dark_counts: Array,
    dropped: Array, highlights: Array,
) -> None:  # fmt: skip
    """Solve rows without inconsistent lights."""
    # `noise` (3,) is a, b and black of the variance a + b (value - black); `ambient` is (1, W) or
    # (H, W).
    count = len(images)
    rows, columns = p.shape
    a, b, black = noise
    zero = np.float32(0.0)
    limit = limits[count]
    for r in range(rows):
        dark = ambient[min(r, len(ambient) - 1)]
        bx = np.zeros(columns, np.float32)
        by = np.zeros(columns, np.float32)
        bz = np.zeros(columns, np.float32)
        squares = np.zeros(columns, np.float32)
        variance = np.zeros(columns, np.float32)
        highest_raw = np.zeros(columns, np.float32)
        brightest = np.zeros(columns, np.float32)
        for k in range(count):
            # `variance` is the mean over the lights of the variances of the values.
            gain, mean_weight = gains[k], gains[k] * gains[k] / np.float32(count)
            x, y, z = weights[:, k]
            for c in range(columns):
                raw = images[k, r, c]
                highest_raw[c] = max(highest_raw[c], raw)
                variance[c] += mean_weight * (a + b * max(raw - black, zero))
                v = (raw - dark[c]) * gain
                brightest[c] = max(brightest[c], v)
                bx[c] += x * v
                by[c] += y * v
                bz[c] += z * v
        for k in range(count):
            gain = gains[k]
            x, y, z = directions[:, k]
            for c in range(columns):
                s = x * bx[c] + y * by[c] + z * bz[c]
                squares[c] += ((images[k, r, c] - dark[c]) * gain - s) ** 2
        dropped[r] = NO_DROPPED_LIGHT
        highlights[r] = False
        gate = limit * variance + (TOLERANCE * brightest) ** 2
        for column in np.flatnonzero((squares > gate) | (highest_raw >= saturation)):
            dark_variance = frames * (a + b * max(dark[column] - black, zero))
            dropped_light, highlight, x, y, z = _solve_consistent(
                images, dark[column], dark_variance, lights, gains, directions, saturation, limits,
                variance[column], r, column,
            )  # fmt: skip
            dropped[r, column], highlights[r, column] = dropped_light, highlight
            bx[column], by[column], bz[column] = x, y, z
        floors = least_bz * np.sqrt(variance)
        judge_row(
            images, dark, lights, gains, directions, r, bx, by, bz, floors, dark_albedo,
            p, q, albedo, valid, dark_counts,
        )  # fmt: skip


@kernel
def _solve_consistent(
    images: Array, dark: np.float32, dark_variance: np.float32, lights: Array, gains: Array,
    directions: Array, saturation: np.float32, limits: Array, variance: np.float32, r: int, c: int,
) -> tuple[int, bool, np.float32, np.float32, np.float32]:  # fmt: skip
    """Leave out lights until the others agree.

    Returns the first light left out, whether one was a highlight, and b.
    """
    # Dark lights go first, then the one whose absence leaves the smallest residuals; of four, see
    # `_one_of_four`. Let e be the residual of light l, and h = l . (L^T L)^-1 l its leverage. Its
    # absence subtracts e^2 / (1 - h) from the sum of squared residuals and multiplies the
    # determinant of L^T L by 1 - h (Cook and Weisberg 1982, Residuals and Influence in Regression,
    # chapter 2).
    count = len(images)
    used = np.ones(count, np.bool_)
    values = np.empty(count, np.float32)
    first_dropped, highlight, remaining = NO_DROPPED_LIGHT, False, count
    for k in range(count):
        raw = images[k, r, c]
        values[k] = (raw - dark) * gains[k]
        if raw >= saturation:
            used[k] = False
            remaining -= 1
            first_dropped = min(first_dropped, k)
    brightest, second_brightest = np.float32(0.0), np.float32(0.0)
    for k in range(count):
        second_brightest = max(second_brightest, min(brightest, values[k]))
        brightest = max(brightest, values[k])
    dark_level = DARK * np.sqrt(dark_variance)
    tolerance = TOLERANCE * brightest
    is_dark, bright_count = np.empty(count, np.bool_), 0
    # The sums of the normal equations; those of a light are subtracted when it is left out.
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    x, y, z = 0.0, 0.0, 0.0
    for k in range(count):
        level = max(
            min(dark_level * gains[k], SHADOW_FRACTION * brightest), LEAK * second_brightest
        )
        is_dark[k] = values[k] <= level
        bright_count += used[k] & (values[k] > level)
        if used[k]:
            lx, ly, lz = float(directions[0, k]), float(directions[1, k]), float(directions[2, k])
            value = float(values[k])
            xx, xy, xz = xx + lx * lx, xy + lx * ly, xz + lx * lz
            yy, yz, zz = yy + ly * ly, yz + ly * lz, zz + lz * lz
            x, y, z = x + lx * value, y + ly * value, z + lz * value
    determinant, a00, a01, a02, a11, a12, a22 = invert(xx, xy, xz, yy, yz, zz)
    bx = np.float32(a00 * x + a01 * y + a02 * z)
    by = np.float32(a01 * x + a11 * y + a12 * z)
    bz = np.float32(a02 * x + a12 * y + a22 * z)
    errors = np.empty(count, np.float32)
    while determinant > 0.0 and remaining > 3:
        squares, any_dark = np.float32(0.0), False
        for k in range(count):
            s = directions[0, k] * bx + directions[1, k] * by + directions[2, k] * bz
            errors[k] = values[k] - s if used[k] else np.float32(0.0)
            squares += errors[k] * errors[k]
            any_dark |= used[k] & is_dark[k]
        if squares <= limits[remaining] * variance + tolerance * tolerance:
            break
        if 2 * (remaining - 1) <= bright_count:
            # No majority of the bright lights agrees: directions or levels are wrong. All lights
            # that are neither dark nor saturated are used.
            first_dropped = NO_DROPPED_LIGHT
            for k in range(count):
                used[k] = (images[k, r, c] < saturation) & (not is_dark[k])
                first_dropped = first_dropped if used[k] else min(first_dropped, k)
            _, bx, by, bz = solve_lights(images, dark, lights, gains, directions, used, r, c)
            return first_dropped, False, bx, by, bz
        eligible = used & is_dark if any_dark else used
        if remaining == 4:
            chosen = _one_of_four(
                images, dark, lights, gains, directions, used, eligible, values, errors, any_dark,
                r, c,
            )  # fmt: skip
        else:
            smallest = least_determinant(remaining - 1.0) / determinant
            inverse = (a00, 2.0 * a01, 2.0 * a02, a11, 2.0 * a12, a22)
            chosen = _least_consistent(directions, errors, eligible, inverse, smallest)
        if chosen < 0:
            break
        value = float(values[chosen])
        lx, ly, lz = directions[:, chosen].astype(np.float64)
        xx, xy, xz = xx - lx * lx, xy - lx * ly, xz - lx * lz
        yy, yz, zz = yy - ly * ly, yz - ly * lz, zz - lz * lz
        x, y, z = x - lx * value, y - ly * value, z - lz * value
        inverted = invert(xx, xy, xz, yy, yz, zz)
        if inverted[0] <= 0.0:
            break
        determinant, a00, a01, a02, a11, a12, a22 = inverted
        bx = np.float32(a00 * x + a01 * y + a02 * z)
        by = np.float32(a01 * x + a11 * y + a12 * z)
        bz = np.float32(a02 * x + a12 * y + a22 * z)
        used[chosen] = False
        remaining -= 1
        first_dropped = chosen if first_dropped == NO_DROPPED_LIGHT else first_dropped
        # A highlight is brighter than the fit, and than stray light in a shadow.
        highlight |= values[chosen] > max(values[chosen] - errors[chosen], LEAK * second_brightest)
    return first_dropped, highlight, bx, by, bz


@kernel
def _least_consistent(
    directions: Array, errors: Array, eligible: Array,
    inverse: tuple[float, float, float, float, float, float], smallest_one_minus_h: float,
) -> int:  # fmt: skip
    """The eligible light without which the residuals are smallest; -1 for none."""
    # `inverse` is the upper triangle of (L^T L)^-1 with doubled off-diagonals. A light with a 1 - h
    # of at most `smallest_one_minus_h` is kept: without it the others determine no normal.
    xx, xy, xz = np.float32(inverse[0]), np.float32(inverse[1]), np.float32(inverse[2])
    yy, yz, zz = np.float32(inverse[3]), np.float32(inverse[4]), np.float32(inverse[5])
    one, none = np.float32(1.0), np.float32(-1.0)
    smallest = np.float32(smallest_one_minus_h)
    reductions = np.empty(len(errors), np.float32)  # of the sum of squared residuals
    for k in range(len(errors)):
        x, y, z = directions[0, k], directions[1, k], directions[2, k]
        leverage = x * (xx * x + xy * y + xz * z) + y * (yy * y + yz * z) + zz * z * z
        one_minus_h = one - leverage
        reduction = errors[k] * errors[k] / one_minus_h
        reductions[k] = reduction if eligible[k] & (one_minus_h > smallest) else none
    chosen, largest = -1, none
    for k in range(len(errors)):
        if reductions[k] > largest:
            chosen, largest = k, reductions[k]
    return chosen


@kernel
def _one_of_four(
    images: Array, dark: np.float32, lights: Array, gains: Array, directions: Array,
    used: Array, eligible: Array, values: Array, errors: Array, any_dark: bool, r: int, c: int,
) -> int:  # fmt: skip
    """The light to leave out of four; -1 for none."""
    # Any three lights fit a normal exactly, so residuals cannot decide. The darkest light goes if
    # one is dark. Otherwise the darkest of those below the fit (a shadow) or the brightest of those
    # above it (a highlight) goes, whichever leaves the flatter surface.
    darkest, low, high = -1, -1, -1
    for k in range(len(values)):
        if eligible[k]:
            if darkest < 0 or values[k] < values[darkest]:
                darkest = k
            if errors[k] < 0.0 and (low < 0 or values[k] < values[low]):
                low = k
            if errors[k] > 0.0 and (high < 0 or values[k] > values[high]):
                high = k
    if any_dark:
        return darkest
    if low < 0:
        return -1
    steep = _steepness(images, dark, lights, gains, directions, used, low, r, c)
    if _steepness(images, dark, lights, gains, directions, used, high, r, c) < steep:
        return high
    return low


@kernel
def _steepness(
    images: Array, dark: np.float32, lights: Array, gains: Array, directions: Array, used: Array,
    without: int, r: int, c: int,
) -> np.float32:  # fmt: skip
    """Squared slope of the surface without one more light; infinite if not determined."""
    if without < 0:
        return np.float32(np.inf)
    used[without] = False
    solved, x, y, z = solve_lights(images, dark, lights, gains, directions, used, r, c)
    used[without] = True
    if not solved or z <= 0.0:
        return np.float32(np.inf)
    return np.float32((x * x + y * y) / (z * z))
