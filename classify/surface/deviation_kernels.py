"""Kernels of `uncertainty`: the deviations of rows, and of repaired slopes."""

import numpy as np

from classify.base.compiling import Array, kernel, kernel_part
from classify.shadow_rule import DARK, LEAK, NO_DROPPED_LIGHT

_Numbers = tuple[np.float32, ...]
# Constants of all lights, for each those that `_add_light` unpacks. Up to eight are a tuple, whose
# loops the compiler unrolls and vectorises; more are an array.
Lights = tuple[_Numbers, ...] | Array
# Ambient value, saturation, noise a, b, black, and `_pixel`.
_Scene = tuple[np.float32, np.float32, _Numbers, _Numbers]
# Of all lights: M V M^T and M V nul; residuals; the darkest light. See `_add_light`.
_Sums = tuple[_Numbers, _Numbers, _Numbers, _Numbers]

# A residual is an error of one pixel if its square exceeds this multiple of the mean square around
# it: three standard deviations.
PIXEL_OUTLIER = np.float32(9.0)
# Least squared ratio of a value to its noise at which its flat-field factor can be computed.
MIN_SQUARED_SNR = np.float32(4.0)
# Exponents of the lobes of gloss: 2^3 to 2^7.
FIRST_POWER, POWERS = 3, 5
# Smallest and largest radius of the window in which the steps around a repaired slope are averaged.
_STEPS_PX, _FARTHEST_PX = 2, 16
# An error with variances s and t <= s along two axes is within 1.96 (s + 0.56 t)^0.5 in 95 % of the
# cases. That is exact for t = 0, and for t = s, where 2.448 is the quantile of the Rayleigh
# distribution; in between it is wrong by up to 0.6 %.
_SECOND_AXIS = np.float32(0.56)
_DEGREES = np.float32(180.0 / np.pi)


@kernel
def propagate_errors(
    images: Array, ambient: Array, raw: Array | None, lights: Lights, corrections: Array,
    unit_covariances: Array, strengths: Array | None, noise: Array, saturation: np.float32,
    leaves_out: bool, lobe_slope_factor: np.float32, plane: Array, x: Array, y: Array,
    p: Array, q: Array, albedo: Array, dropped: Array, model_error: Array,
    p_sd: Array, q_sd: Array, albedo_sd: Array, angle_sd: Array,
) -> None:  # fmt: skip
    """Write the deviations of some rows."""
    # `raw` are the pixel values before the flat field divided them, None if none did. The rows of
    # `corrections` (4, 3) are the columns of pinv / nul. `unit_covariances` (2, 6) are those of b
    # from errors of variance 1 of each image, and of the ambient image. Where a light was left out,
    # lobes are those of slopes times `lobe_slope_factor`; `strengths` is None where there is no
    # gloss. `model_error` is a variance over squared brightness.
    shear, sensor = _three(plane), _three(noise)
    covariances = _six(unit_covariances[0]), _six(unit_covariances[1])
    correction_columns = _four(corrections)
    zero, one = np.float32(0.0), np.float32(1.0)
    count = np.float32(len(lights))
    shares = (one / count, one / max(count - np.float32(3.0), one))
    constants = (count, np.float32(len(ambient) > 1), lights[0][0])
    no_sums = (
        (zero, zero, zero, zero, zero, zero), (zero, zero, zero, zero), (zero, zero, zero),
        (zero, zero, np.float32(np.inf), np.float32(NO_DROPPED_LIGHT)),
    )  # fmt: skip
    rows, columns = p.shape
    for r in range(rows):
        dark_row = ambient[min(r, len(ambient) - 1)]
        for c in range(columns):
            pixel = _pixel(p[r, c], q[r, c], albedo[r, c], x[c], y[r], shear)
            scene = (dark_row[c], saturation, sensor, pixel)
            sums, gloss = no_sums, (zero, zero, zero, zero)
            for k in range(len(lights)):
                value = None if raw is None else raw[k, r, c]
                sums = _add_light(
                    np.float32(k), images[k, r, c], value, scene, _light(lights[k]), sums
                )
            if strengths is not None:  # a loop of its own, because only short loops are unrolled
                factor = one if dropped[r, c] == NO_DROPPED_LIGHT else lobe_slope_factor
                for k in range(len(lights)):
                    gloss = _add_gloss(pixel, factor, _light(lights[k]), strengths, gloss)
            p_sd[r, c], q_sd[r, c], albedo_sd[r, c], angle_sd[r, c] = _deviations(
                scene, sums, None if strengths is None else gloss, constants, shares, leaves_out,
                covariances, correction_columns, np.float32(dropped[r, c]), model_error[r, c],
            )  # fmt: skip


@kernel_part
def _four(columns: Array) -> tuple[_Numbers, ...]:
    return _three(columns[0]), _three(columns[1]), _three(columns[2]), _three(columns[3])


@kernel_part
def _three(values: Array) -> _Numbers:
    return values[0], values[1], values[2]


@kernel_part
def _six(values: Array) -> _Numbers:
    return values[0], values[1], values[2], values[3], values[4], values[5]


@kernel_part
def _light(values: Array) -> _Numbers:
    return (
        values[0], values[1], values[2], values[3], values[4], values[5], values[6], values[7],
        values[8], values[9],
    )  # fmt: skip


@kernel_part
def _pixel(
    p: np.float32, q: np.float32, albedo: np.float32, x: np.float32, y: np.float32, shear: _Numbers
) -> _Numbers:
    """Slopes, n_z, b_z, position and b' of `near_light`, and c / (1 - c . X), of a pixel."""
    cx, cy, cz = shear
    one = np.float32(1.0)
    nz = one / np.sqrt(one + p * p + q * q)
    scale, inner = albedo * nz, -(p * x + q * y)
    across = one / (one - cx * x - cy * y)
    return (
        p, q, nz, scale, x, y,
        scale * (-p - inner * cx), scale * (-q - inner * cy), scale * (one - inner * cz),
        cx * across, cy * across, cz * across,
    )  # fmt: skip


@kernel_part
def _add_light(
    index: np.float32, image: np.float32, raw: np.float32 | None, scene: _Scene, light: _Numbers,
    sums: _Sums,
) -> _Sums:  # fmt: skip
    """Add a light with the column M of the pseudo-inverse; a saturated light is the darkest."""
    dark, saturation, (a, b, black), pixel = scene
    gain, lx, ly, lz, mx, my, mz, nul, redundancy, _ = light
    (xx, xy, xz, yy, yz, zz), (dx, dy, dz, d), residuals, darkness = sums
    energy, expected, total = residuals
    high, second, low, darkest = darkness
    v = gain * (image - dark)
    if raw is None:
        pixel_value, ratio = image, gain
    else:
        pixel_value, undivided = raw, raw - dark
        is_known = undivided * undivided > MIN_SQUARED_SNR * a
        ratio = gain * ((image - dark) / undivided if is_known else np.float32(1.0))
    variance = ratio * ratio * (a + b * max(pixel_value - black, np.float32(0.0)))
    vx, vy, vz, vn = mx * variance, my * variance, mz * variance, nul * variance
    error = v - (lx * pixel[6] + ly * pixel[7] + lz * pixel[8])
    level = v if pixel_value < saturation else -np.float32(1.0)
    return (
        (xx + vx * mx, xy + vx * my, xz + vx * mz, yy + vy * my, yz + vy * mz, zz + vz * mz),
        (dx + vn * mx, dy + vn * my, dz + vn * mz, d + vn * nul),
        (energy + error * error, expected + redundancy * variance, total + v),
        (
            max(high, v), max(second, min(high, v)),
            min(low, level), index if level < low else darkest,
        ),
    )  # fmt: skip


@kernel_part
def _add_gloss(
    pixel: _Numbers, factor: np.float32, light: _Numbers, strengths: Array, gloss: _Numbers
) -> _Numbers:
    """Add M and nul of a light times its lobes of gloss: see `uncertainty._lobes`."""
    p, q, _, _, x, y, _, _, _, _, _, _ = pixel
    _, lx, ly, lz, mx, my, mz, nul, _, inverse_distance = light
    gx, gy, gz, g = gloss
    one = np.float32(1.0)
    p, q = factor * p, factor * q
    tx, ty = lx - inverse_distance * x, ly - inverse_distance * y
    square = tx * tx + ty * ty
    tz = lz + np.sqrt(square + lz * lz)
    cosine = max(tz - tx * p - ty * q, np.float32(0.0))
    power = cosine * cosine * (one / ((one + p * p + q * q) * (square + tz * tz)))
    power *= power
    power *= power
    lobe = strengths[0] * power
    power *= power
    lobe += strengths[1] * power
    power *= power
    lobe += strengths[2] * power
    power *= power
    lobe += strengths[3] * power
    lobe += strengths[4] * power * power
    return gx + mx * lobe, gy + my * lobe, gz + mz * lobe, g + nul * lobe


@kernel_part
def _deviations(
    scene: _Scene, sums: _Sums, gloss: _Numbers | None, constants: _Numbers, shares: _Numbers,
    leaves_out: bool, covariances: tuple[_Numbers, ...], correction_columns: tuple[_Numbers, ...],
    dropped: np.float32, model_error: np.float32,
) -> _Numbers:  # fmt: skip
    """Deviations of p, q, albedo and the normal."""
    dark, _, (a, b, black), pixel = scene
    p, q, nz, scale, x, y, _, _, _, cx, cy, cz = pixel
    (xx, xy, xz, yy, yz, zz), (dx, dy, dz, d), residuals, darkness = sums
    energy, expected, total = residuals
    high, second, low, darkest = darkness
    count, has_ambient, gain = constants
    zero, half, one, none = (
        np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(NO_DROPPED_LIGHT),
    )  # fmt: skip
    # The light that is not used, and the variance of the model error.
    dark_variance = a + b * max(dark - black, zero)
    noise = DARK * gain * np.sqrt((has_ambient + one) * dark_variance)
    is_dark = low <= max(min(noise, half * high), LEAK * second)
    is_shadowed = (dropped == none) & is_dark & (leaves_out | (count == np.float32(4.0)))
    unused = darkest if is_shadowed else dropped
    per_light, per_degree = shares
    mean = total * per_light
    model, pixel_error = model_error * mean * mean, energy * per_degree
    usual = model + expected * per_degree
    is_pixel_error = (unused == none) & (pixel_error > PIXEL_OUTLIER * usual)
    model += pixel_error if is_pixel_error else zero
    # Covariance of b. Without light k the solution is M - L+[:, k] nul^T / nul_k; if k is in shadow
    # and used, its error is r / nul_k.
    tx, ty, tz = _column(unused, correction_columns)
    left_out = np.float32(leaves_out)
    d = half * (left_out * (d + model) + (one - left_out) * energy)
    ex, ey, ez = d * tx - left_out * dx, d * ty - left_out * dy, d * tz - left_out * dz
    from_image, from_ambient = covariances
    dark_variance *= has_ambient
    xx += from_image[0] * model + from_ambient[0] * dark_variance + (ex * tx + ex * tx)
    xy += from_image[1] * model + from_ambient[1] * dark_variance + (ex * ty + ey * tx)
    xz += from_image[2] * model + from_ambient[2] * dark_variance + (ex * tz + ez * tx)
    yy += from_image[3] * model + from_ambient[3] * dark_variance + (ey * ty + ey * ty)
    yz += from_image[4] * model + from_ambient[4] * dark_variance + (ey * tz + ez * ty)
    zz += from_image[5] * model + from_ambient[5] * dark_variance + (ez * tz + ez * tz)
    # Derivatives of -b_z p, -b_z q and |b| / n_z by b'. Their z components are p, q and 1.
    of_p, of_q, of_n = cx + p * cz, cy + q * cz, cz - cx * p - cy * q
    px, py, qx, qy = one + of_p * x, of_p * y, of_q * x, one + of_q * y
    nx, ny = of_n * x - p, of_n * y - q
    wx, wy, wz = xx * px + xy * py + xz * p, xy * px + yy * py + yz * p, xz * px + yz * py + zz * p
    ux, uy, uz = xx * qx + xy * qy + xz * q, xy * qx + yy * qy + yz * q, xz * qx + yz * qy + zz * q
    vp, vq = max(px * wx + py * wy + p * wz, zero), max(qx * ux + qy * uy + q * uz, zero)
    vpq = qx * wx + qy * wy + q * wz
    vr = nx * (nx * xx + (xz + xz)) + ny * (ny * yy + (yz + yz)) + zz + (nx + nx) * ny * xy
    # The angle between normals is (e dp^2 - 2 f dp dq + g dq^2)^0.5 / w^2.
    e, f, h = one + q * q, p * q, one + p * p
    trace = half * (e * vp + h * vq) - f * vpq
    determinant = (vp * vq - vpq * vpq) * (e + p * p)
    spread = np.sqrt(max(trace * trace - determinant, zero))
    angle = np.sqrt(max(trace + spread + _SECOND_AXIS * (trace - spread), zero))
    sp, sq, sr = np.sqrt(vp), np.sqrt(vq), np.sqrt(max(vr, zero))
    if gloss is not None:
        gx, gy, gz, g = gloss
        g *= left_out
        gx, gy, gz = gx - g * tx, gy - g * ty, gz - g * tz
        gp, gq = px * gx + py * gy + p * gz, qx * gx + qy * gy + q * gz
        bias = e * gp * gp - (f + f) * gp * gq + h * gq * gq
        angle = _with_bias(np.sqrt(max(bias, zero)), angle)
        sp, sq = _with_bias(gp, sp), _with_bias(gq, sq)
        sr = _with_bias(nx * gx + ny * gy + gz, sr)
    inverse = one / scale
    return sp * inverse, sq * inverse, sr * nz, _DEGREES * angle * inverse * nz * nz


@kernel_part
def _column(index: np.float32, columns: tuple[_Numbers, ...]) -> _Numbers:
    """One of four columns, or 0."""
    zero, one, two, three = np.float32(0.0), np.float32(1.0), np.float32(2.0), np.float32(3.0)
    (x0, y0, z0), (x1, y1, z1), (x2, y2, z2), (x3, y3, z3) = columns
    x, y, z = (x0, y0, z0) if index == zero else (zero, zero, zero)
    x, y, z = (x1, y1, z1) if index == one else (x, y, z)
    x, y, z = (x2, y2, z2) if index == two else (x, y, z)
    return (x3, y3, z3) if index == three else (x, y, z)


@kernel_part
def _with_bias(bias: np.float32, deviation: np.float32) -> np.float32:
    """Half the width of the interval with 95 % of normal errors with a bias, divided by 1.96."""
    # 1.645 is the one-sided quantile, for a large bias; without bias the width is 1.96 deviations.
    # In between it is up to 3 % too large.
    rest = np.float32(0.315) * deviation
    width = np.float32(1.645) * deviation + np.sqrt(bias * bias + rest * rest)
    return np.float32(width * np.float32(1.0 / 1.96))


@kernel
def write_repaired(
    pixels: Array, p: Array, q: Array, albedo: Array, solved: Array,
    p_sd: Array, q_sd: Array, albedo_sd: Array, angle_sd: Array,
) -> None:  # fmt: skip
    """Write the deviations of repaired pixels.

    The variance is the mean squared step of slopes nearby times one more than the distance to a
    solved pixel; it is 1 without a solved pixel within `_FARTHEST_PX`.
    """
    rows, columns = p.shape
    for pixel in pixels:
        y, x = divmod(pixel, columns)
        total, count, distance = np.float32(0.0), 0, 0
        for radius in range(_STEPS_PX, _FARTHEST_PX + 1):
            top, bottom = max(y - radius, 0), min(y + radius, rows - 1)
            left, right = max(x - radius, 0), min(x + radius, columns - 1)
            distance = _FARTHEST_PX
            for r in range(top, bottom + 1):
                for c in range(left, right + 1):
                    if not solved[r, c]:
                        continue
                    distance = min(distance, max(abs(r - y), abs(c - x)))
                    if r < bottom and solved[r + 1, c]:
                        total += (p[r + 1, c] - p[r, c]) ** 2 + (q[r + 1, c] - q[r, c]) ** 2
                        count += 1
                    if c < right and solved[r, c + 1]:
                        total += (p[r, c + 1] - p[r, c]) ** 2 + (q[r, c + 1] - q[r, c]) ** 2
                        count += 1
            if count:
                break
        # A squared step is the sum of those of p and q.
        variance = total * np.float32(1 + distance) / np.float32(2 * count) if count else 1.0
        deviation = np.sqrt(np.float32(variance))
        square = np.float32(1.0) + p[y, x] * p[y, x] + q[y, x] * q[y, x]
        p_sd[y, x] = q_sd[y, x] = deviation
        albedo_sd[y, x] = albedo[y, x] * deviation / np.sqrt(square)
        # The eigenvalues of the variance of the normal are those along and across the slope.
        angle_sd[y, x] = _DEGREES * deviation / square * np.sqrt(square + _SECOND_AXIS)
