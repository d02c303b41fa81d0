"""Least squares and PS3, with the kernels that the solvers of any number of lights share.

A kernel computes gradients, albedo and validity from raw images row by row, while the row is in the
cache. A row is solved in several short loops without branches, which the compiler vectorises.
"""

from functools import partial

import numpy as np

from classify.base.arrays import Array
from classify.base.compiling import kernel
from classify.base.errors import InputError
from classify.images import ImageStack
from classify.lights.algebra import solvable_pinv
from classify.shadow_rule import (
    MIN_NORMAL_Z,
    MIN_SCALED_Z,
    NO_DROPPED_LIGHT,
    SHADOW_FLOOR,
    SHADOW_FRACTION,
)

from .problem import Maps, Problem
from .strips import solve_strips

# Smallest eigenvalue of L^T L, the square of the smallest singular value of L, that still
# determines a normal; the same limit as in `classify.lights.algebra`.
MIN_EIGENVALUE = 1e-6
# Tilt of the light that each version of PS3 leaves out (thesis section 9.3).
_PS3_UNUSED_TILT_DEG = {"ps3a": 270.0, "ps3b": 0.0, "ps3c": 90.0, "ps3d": 180.0}


def solve_least_squares(problem: Problem) -> Maps:
    """Least squares of all lights that are not saturated; three lights or more."""
    weights = solvable_pinv(problem.lighting.directions, "least_squares")
    return _solve(problem, weights, NO_DROPPED_LIGHT)


def _solve_three_of_ring(problem: Problem, method: str) -> Maps:
    """One version of PS3: the same three lights of a ring of four at every pixel."""
    lighting = problem.lighting
    if len(lighting) != 4:
        raise InputError(
            f"method {method} chooses 3 of 4 lights, this set has {len(lighting)}; "
            "use least_squares"
        )
    unused = lighting.light_nearest_tilt(_PS3_UNUSED_TILT_DEG[method])
    used = np.arange(4) != unused
    weights = np.zeros((3, 4), np.float32)
    weights[:, used] = solvable_pinv(lighting.directions[used], method)
    return _solve(problem, weights, unused)


solve_ps3a = partial(_solve_three_of_ring, method="ps3a")
solve_ps3b = partial(_solve_three_of_ring, method="ps3b")
solve_ps3c = partial(_solve_three_of_ring, method="ps3c")
solve_ps3d = partial(_solve_three_of_ring, method="ps3d")


def _solve(problem: Problem, weights: Array, unused: int) -> Maps:
    """Solve b = weights i at every pixel, without the light `unused`."""
    floor = problem.noise_floor(weights)
    lights, gains, _ = padded = padded_lights(problem, unused)
    weights = weights[:, lights] * gains
    solve_rows = _solve_four if len(lights) == 4 else _solve_many
    maps = problem.new_maps(left_out=np.broadcast_to(np.uint8(unused), problem.shape))

    def solve(stack: ImageStack, maps: Maps, first: int, last: int) -> None:
        solve_rows(
            first, last, stack.images, stack.dark_rows, *padded, problem.saturation, floor, weights,
            problem.dark_albedo, maps.p, maps.q, maps.albedo, maps.valid, maps.dark_counts,
        )  # fmt: skip

    solve_strips(problem, maps, solve, from_all_lights=unused == NO_DROPPED_LIGHT)
    return maps


def padded_lights(problem: Problem, unused: int = NO_DROPPED_LIGHT) -> tuple[Array, Array, Array]:
    """Indices (4 n,), gains (4 n,) and directions (3, 4 n) of the lights except `unused`."""
    # The kernels take four lights per loop. The padding repeats the last light with a gain of 0.
    used = np.flatnonzero(np.arange(len(problem.lighting)) != unused)
    padding = (0, -len(used) % 4)
    lights = np.pad(used, padding, mode="edge")
    gains = np.pad(problem.gains[used], padding)
    return lights, gains, np.ascontiguousarray(problem.directions[lights].T)


@kernel
def _solve_four(
    first: int, last: int, images: Array, ambient: Array,
    lights: Array, gains: Array, directions: Array,
    saturation: np.float32, noise_floor: np.float32, weights: Array, dark_albedo: np.float32,
    p: Array, q: Array, albedo: Array, valid: Array, dark_counts: Array,
) -> None:  # fmt: skip
    """As `_solve_many`, for four images, in one loop that stores no sums."""
    columns = p.shape[1]
    i0, i1, i2, i3 = lights[0], lights[1], lights[2], lights[3]
    x0, x1, x2, x3 = weights[0, 0], weights[0, 1], weights[0, 2], weights[0, 3]
    y0, y1, y2, y3 = weights[1, 0], weights[1, 1], weights[1, 2], weights[1, 3]
    z0, z1, z2, z3 = weights[2, 0], weights[2, 1], weights[2, 2], weights[2, 3]
    light0, light1 = _light(directions, gains, 0), _light(directions, gains, 1)
    light2, light3 = _light(directions, gains, 2), _light(directions, gains, 3)
    saturated = np.empty(columns, np.bool_)
    for r in range(first, last):
        dark = ambient[min(r, len(ambient) - 1)]
        for c in range(columns):
            v0, v1 = np.float32(images[i0, r, c]), np.float32(images[i1, r, c])
            v2, v3 = np.float32(images[i2, r, c]), np.float32(images[i3, r, c])
            saturated[c] = max(max(v0, v1), max(v2, v3)) >= saturation
            d = np.float32(dark[c])
            v0, v1, v2, v3 = v0 - d, v1 - d, v2 - d, v3 - d
            x = (x0 * v0 + x1 * v1) + (x2 * v2 + x3 * v3)
            y = (y0 * v0 + y1 * v1) + (y2 * v2 + y3 * v3)
            z = (z0 * v0 + z1 * v1) + (z2 * v2 + z3 * v3)
            b = (x, y, z)
            lit0, lit1 = _lit(v0, b, light0), _lit(v1, b, light1)
            lit2, lit3 = _lit(v2, b, light2), _lit(v3, b, light3)
            pixel = _map_values(b, (lit0 + lit1) + (lit2 + lit3), noise_floor)
            p[r, c], q[r, c], albedo[r, c], valid[r, c] = pixel
        # These sums have a loop of their own: in the loop above they would add a sixth to its time.
        count, dark_count = 0, 0
        for c in range(columns):
            count += saturated[c]
            dark_count += albedo[r, c] < dark_albedo
        if count:
            dark_count += _solve_saturated(
                images, dark, lights, gains, directions, r, saturated, saturation, noise_floor,
                dark_albedo, p, q, albedo, valid,
            )  # fmt: skip
        dark_counts[r] = dark_count


@kernel
def _solve_saturated(
    images: Array, dark: Array, lights: Array, gains: Array, directions: Array, r: int,
    saturated: Array, saturation: np.float32, noise_floor: np.float32, dark_albedo: np.float32,
    p: Array, q: Array, albedo: Array, valid: Array,
) -> int:  # fmt: skip
    """Solve `saturated` pixels without their saturated lights.

    Returns the change of the number of pixels below `dark_albedo`.
    """
    zero, dark_count_change = np.float32(0.0), 0
    used = np.empty(len(lights), np.bool_)
    for c in np.flatnonzero(saturated):
        for k in range(len(lights)):
            used[k] = gains[k] != zero and images[lights[k], r, c] < saturation
        d = np.float32(dark[c])
        solved, x, y, z = solve_lights(images, d, lights, gains, directions, used, r, c)
        if not solved:
            p[r, c], q[r, c], valid[r, c] = zero, zero, False
            continue
        lit_count = zero
        for k in range(len(lights)):
            value = np.float32(images[lights[k], r, c]) - d
            lit_count += _lit(value, (x, y, z), _light(directions, gains, k))
        pixel = _map_values((x, y, z), lit_count, noise_floor)
        dark_count_change += int(pixel[2] < dark_albedo) - int(albedo[r, c] < dark_albedo)
        p[r, c], q[r, c], albedo[r, c], valid[r, c] = pixel
    return dark_count_change


@kernel
def _solve_many(
    first: int, last: int, images: Array, ambient: Array,
    lights: Array, gains: Array, directions: Array,
    saturation: np.float32, noise_floor: np.float32, weights: Array, dark_albedo: np.float32,
    p: Array, q: Array, albedo: Array, valid: Array, dark_counts: Array,
) -> None:  # fmt: skip
    """Solve by b = weights i; `weights` (3, 4 n) contain the gains."""
    columns = p.shape[1]
    zero = np.float32(0.0)
    bx = np.empty(columns, np.float32)
    by = np.empty(columns, np.float32)
    bz = np.empty(columns, np.float32)
    brightest = np.empty(columns, np.float32)
    floors = np.full(columns, noise_floor)
    for r in range(first, last):
        dark = ambient[min(r, len(ambient) - 1)]
        for k in range(0, len(lights), 4):
            i0, i1, i2, i3 = lights[k], lights[k + 1], lights[k + 2], lights[k + 3]
            x0, x1, x2, x3 = weights[0, k], weights[0, k + 1], weights[0, k + 2], weights[0, k + 3]
            y0, y1, y2, y3 = weights[1, k], weights[1, k + 1], weights[1, k + 2], weights[1, k + 3]
            z0, z1, z2, z3 = weights[2, k], weights[2, k + 1], weights[2, k + 2], weights[2, k + 3]
            for c in range(columns):
                v0, v1 = np.float32(images[i0, r, c]), np.float32(images[i1, r, c])
                v2, v3 = np.float32(images[i2, r, c]), np.float32(images[i3, r, c])
                brighter = brightest[c] if k else zero
                brightest[c] = max(brighter, max(max(v0, v1), max(v2, v3)))
                d = np.float32(dark[c])
                v0, v1, v2, v3 = v0 - d, v1 - d, v2 - d, v3 - d
                x = bx[c] if k else zero
                y = by[c] if k else zero
                z = bz[c] if k else zero
                bx[c] = x + ((x0 * v0 + x1 * v1) + (x2 * v2 + x3 * v3))
                by[c] = y + ((y0 * v0 + y1 * v1) + (y2 * v2 + y3 * v3))
                bz[c] = z + ((z0 * v0 + z1 * v1) + (z2 * v2 + z3 * v3))
        # The compiler vectorises this sum, but not the search by `flatnonzero`.
        saturated = 0
        for c in range(columns):
            saturated += brightest[c] >= saturation
        if saturated:
            for column in np.flatnonzero(brightest >= saturation):
                used = gains != zero
                for k in range(len(lights)):
                    used[k] &= images[lights[k], r, column] < saturation
                d = np.float32(dark[column])
                solved, x, y, z = solve_lights(
                    images, d, lights, gains, directions, used, r, column
                )
                if solved:
                    bx[column], by[column], bz[column] = x, y, z
                else:
                    floors[column] = np.inf
        judge_row(
            images, dark, lights, gains, directions, r, bx, by, bz, floors, dark_albedo,
            p, q, albedo, valid, dark_counts,
        )  # fmt: skip
        if saturated:
            floors[:] = noise_floor


@kernel
def solve_lights(
    images: Array, dark: np.float32, lights: Array, gains: Array, directions: Array,
    used: Array, r: int, c: int,
) -> tuple[bool, np.float32, np.float32, np.float32]:  # fmt: skip
    """Scaled normal of one pixel by the lights `used`; False and zeros if not determined."""
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    x, y, z = 0.0, 0.0, 0.0
    for k in range(len(used)):
        if used[k]:
            value = float((np.float32(images[lights[k], r, c]) - dark) * gains[k])
            lx, ly, lz = float(directions[0, k]), float(directions[1, k]), float(directions[2, k])
            xx += lx * lx
            xy += lx * ly
            xz += lx * lz
            yy += ly * ly
            yz += ly * lz
            zz += lz * lz
            x += lx * value
            y += ly * value
            z += lz * value
    determinant, a00, a01, a02, a11, a12, a22 = invert(xx, xy, xz, yy, yz, zz)
    return (
        determinant > 0.0,
        np.float32(a00 * x + a01 * y + a02 * z),
        np.float32(a01 * x + a11 * y + a12 * z),
        np.float32(a02 * x + a12 * y + a22 * z),
    )


@kernel
def invert(
    xx: float, xy: float, xz: float, yy: float, yz: float, zz: float
) -> tuple[float, float, float, float, float, float, float]:
    """Determinant and inverse of symmetric L^T L; all 0 if it determines no normal."""
    a00, a01, a02 = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    a11, a12, a22 = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    determinant = xx * a00 + xy * a01 + xz * a02
    if not determinant > least_determinant(xx + yy + zz):
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    f = 1.0 / determinant
    return determinant, f * a00, f * a01, f * a02, f * a11, f * a12, f * a22


@kernel
def least_determinant(trace: float) -> float:
    """Least determinant of L^T L that determines a normal; its trace is the number of lights."""
    # The product of the two larger eigenvalues is at most a quarter of the squared trace.
    return 0.25 * MIN_EIGENVALUE * trace * trace


@kernel
def judge_row(
    images: Array, dark: Array, lights: Array, gains: Array, directions: Array, r: int,
    bx: Array, by: Array, bz: Array, floors: Array, dark_albedo: np.float32,
    p: Array, q: Array, albedo: Array, valid: Array, dark_counts: Array,
) -> None:  # fmt: skip
    """Write the maps of row r."""
    # Slopes are valid where bz^2 >= `floors` rho and at least three lights are out of shadow.
    columns = p.shape[1]
    zero = np.float32(0.0)
    lit_counts = np.empty(columns, np.float32)
    last, dark_count = len(lights) - 4, 0
    for k in range(0, len(lights), 4):
        i0, i1, i2, i3 = lights[k], lights[k + 1], lights[k + 2], lights[k + 3]
        light0, light1 = _light(directions, gains, k), _light(directions, gains, k + 1)
        light2, light3 = _light(directions, gains, k + 2), _light(directions, gains, k + 3)
        if k < last:
            for c in range(columns):
                d, b = np.float32(dark[c]), (bx[c], by[c], bz[c])
                v0, v1 = np.float32(images[i0, r, c]) - d, np.float32(images[i1, r, c]) - d
                v2, v3 = np.float32(images[i2, r, c]) - d, np.float32(images[i3, r, c]) - d
                lit0, lit1 = _lit(v0, b, light0), _lit(v1, b, light1)
                lit2, lit3 = _lit(v2, b, light2), _lit(v3, b, light3)
                lit_counts[c] = (lit_counts[c] if k else zero) + ((lit0 + lit1) + (lit2 + lit3))
        else:
            # The last four lights: counting and writing in one loop takes a fifth less time.
            for c in range(columns):
                d, b = np.float32(dark[c]), (bx[c], by[c], bz[c])
                v0, v1 = np.float32(images[i0, r, c]) - d, np.float32(images[i1, r, c]) - d
                v2, v3 = np.float32(images[i2, r, c]) - d, np.float32(images[i3, r, c]) - d
                lit0, lit1 = _lit(v0, b, light0), _lit(v1, b, light1)
                lit2, lit3 = _lit(v2, b, light2), _lit(v3, b, light3)
                lit_count = (lit_counts[c] if k else zero) + ((lit0 + lit1) + (lit2 + lit3))
                pixel = _map_values(b, lit_count, floors[c])
                p[r, c], q[r, c], albedo[r, c], valid[r, c] = pixel
                dark_count += pixel[2] < dark_albedo
    dark_counts[r] = dark_count


@kernel
def _light(
    directions: Array, gains: Array, k: int
) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Direction of light k, and its gain divided by `SHADOW_FRACTION`."""
    return directions[0, k], directions[1, k], directions[2, k], gains[k] / SHADOW_FRACTION


@kernel
def _map_values(
    b: tuple[np.float32, np.float32, np.float32], lit_count: np.float32, floor: np.float32
) -> tuple[np.float32, np.float32, np.float32, bool]:
    """p, q, albedo and validity of a scaled normal b with `lit_count` lights out of shadow."""
    x, y, z = b
    rho = np.sqrt(x * x + y * y + z * z)
    visible = (z > max(MIN_NORMAL_Z * rho, MIN_SCALED_Z)) & (z * z >= floor * rho)
    inverse = np.float32(-1.0) / z if visible else np.float32(0.0)
    # Three lights or more; the count is a float.
    return x * inverse, y * inverse, rho, visible & (lit_count > np.float32(2.5))


@kernel
def _lit(
    value: np.float32, b: tuple[np.float32, np.float32, np.float32],
    light: tuple[np.float32, np.float32, np.float32, np.float32],
) -> np.float32:  # fmt: skip
    """1 if `value` is above `SHADOW_FRACTION` of the prediction by b for this light, else 0."""
    x, y, z = b
    towards_x, towards_y, towards_z, gain = light
    prediction = towards_x * x + towards_y * y + towards_z * z
    limit = max(prediction, SHADOW_FLOOR * np.sqrt(x * x + y * y + z * z))
    return np.float32(1.0) if value * gain > limit else np.float32(0.0)
