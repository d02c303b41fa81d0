"""Kernels of `uncertainty`: the deviations of rows, and of completed slopes."""

import numpy as np

from classify.base.compiling import Array, kernel
from classify.shadow_rule import DARK, LEAK, NO_DROPPED_LIGHT

Rows = tuple[Array, ...]

# A residual whose square exceeds this multiple of that of the pixels around is an error of its own:
# one normal residual in 370 does.
OWN = np.float32(9.0)
# A pixel value whose square is below this multiple of its variance does not tell the factor that
# divided it.
KNOWN = np.float32(4.0)
# Exponents of the lobes of gloss: 2^3 to 2^7.
FIRST_POWER, POWERS = 3, 5
# Radius of the window in which the steps around a completed slope are averaged, and the largest.
_STEPS_PX, _FARTHEST_PX = 2, 16
# An error of two axes with the variances s and t <= s is within 1.96 (s + 0.56 t)^0.5 in 95 % of
# the cases: exact for t = 0 and t = s, where 2.448 bounds a Rayleigh variable, 0.6 % off between.
SECOND_AXIS = np.float32(0.56)
DEGREES = np.float32(180.0 / np.pi)


@kernel
def _row(columns: int) -> Array:
    """A row of zeros."""
    return np.zeros(columns, np.float32)


@kernel
def propagate_errors(
    images: Array, ambient: Array, raw: Array, gains: Array, noise: Array, directions: Array,
    pinv: Array, spare: Array, null: Array, corrections: Array, strengths: Array,
    saturation: np.float32, leaves_out: bool, plane: Array, inverse_distances: Array,
    x: Array, y: Array,
    p: Array, q: Array, albedo: Array, dropped: Array, model: Array,
    p_sd: Array, q_sd: Array, albedo_sd: Array, angle_sd: Array,
) -> None:  # fmt: skip
    """Write the deviations of some rows; the loops over a row have no branches, see `robust`."""
    lights, rows, columns = images.shape
    # The image that all lights have in common, the noise of the ambient image, has this solution.
    even = pinv @ gains
    freedom = np.float32(max(lights - 3, 1))
    has_ambient = np.float32(len(ambient) > 1)
    shiny = strengths.any()
    # Arrays of their own: for rows of one array the compiler does not vectorise the loops.
    n = columns
    normals = (_row(n), _row(n), _row(n), _row(n), _row(n), _row(n))
    sums = (_row(n), _row(n), _row(n), _row(n), _row(n), _row(n))
    tangents = (_row(n), _row(n), _row(n), _row(n), _row(n), _row(n), _row(n))
    corrected = (_row(n), _row(n), _row(n))
    power, gloss, lost = _row(n), _row(n), _row(n)
    variances = np.empty((lights, n), np.float32)
    for r in range(rows):
        dark, slopes = ambient[min(r, len(ambient) - 1)], (p[r], q[r])
        _begin(plane, x, y[r], slopes, albedo[r], normals, sums, tangents)
        for k in range(lights):
            _add_residuals(
                k, images[k, r], raw[k, r], dark, gains[k], noise, directions[k], spare[k],
                saturation, normals, variances[k], sums, lost,
            )  # fmt: skip
        _judge(
            dropped[r], dark, noise, has_ambient, gains[0], np.float32(lights), freedom, leaves_out,
            model[r], sums, lost,
        )  # fmt: skip
        for k in range(lights):
            _select(k, corrections[:, k], lost, corrected)
        for k in range(lights):
            if shiny:
                _gloss(
                    directions[k], inverse_distances[k], x, y[r], slopes, normals[0], strengths,
                    power, gloss,
                )  # fmt: skip
            _add_light(
                pinv[:, k], null[k], plane, x, y[r], slopes, normals, corrected, variances[k],
                sums[4], gloss, tangents,
            )  # fmt: skip
        _finish(
            dark, noise, has_ambient, even, slopes, normals, tangents,
            p_sd[r], q_sd[r], albedo_sd[r], angle_sd[r],
        )  # fmt: skip


@kernel
def _begin(
    plane: Array, x: Array, y: np.float32, slopes: Rows, albedo: Array, normals: Rows,
    sums: Rows, tangents: Rows,
) -> None:  # fmt: skip
    """n_z, rho n_z and b' of `near_light` of a row, and sums of 0."""
    nz, scale, bx, by, bz, across = normals
    p, q = slopes
    plane_x, plane_y, plane_z = plane
    one = np.float32(1.0)
    for c in range(len(p)):
        nz[c] = one / np.sqrt(one + p[c] * p[c] + q[c] * q[c])
        scale[c] = albedo[c] * nz[c]
        inner = -(p[c] * x[c] + q[c] * y)
        bx[c] = scale[c] * (-p[c] - inner * plane_x)
        by[c] = scale[c] * (-q[c] - inner * plane_y)
        bz[c] = scale[c] * (one - inner * plane_z)
        across[c] = one / (one - plane_x * x[c] - plane_y * y)
    for total in sums + tangents:
        total[:] = np.float32(0.0)
    sums[2][:] = np.float32(np.inf)


@kernel
def _add_residuals(
    k: int, image: Array, raw: Array, dark: Array, gain: np.float32, noise: Array,
    direction: Array, spare: np.float32, saturation: np.float32, normals: Rows,
    variances: Array, sums: Rows, lost: Array,
) -> None:  # fmt: skip
    """Noise of a light, its residual, and the darkest light: one that is saturated is darker."""
    _, _, bx, by, bz, _ = normals
    high, second, low, energy, total, expected = sums
    a, b, black = noise
    lx, ly, lz = direction
    zero, one, index = np.float32(0.0), np.float32(1.0), np.float32(k)
    least = KNOWN * a
    for c in range(len(image)):
        value, whole = image[c] - dark[c], raw[c] - dark[c]
        ratio = gain * (value / whole if whole * whole > least else one)
        v = gain * value
        variance = ratio * ratio * (a + b * max(raw[c] - black, zero))
        variances[c] = variance
        expected[c] += spare * variance
        error = v - (lx * bx[c] + ly * by[c] + lz * bz[c])
        energy[c] += error * error
        total[c] += v
        second[c] = max(second[c], min(high[c], v))
        high[c] = max(high[c], v)
        value = v if raw[c] < saturation else -one
        lost[c] = index if value < low[c] else lost[c]
        low[c] = min(low[c], value)


@kernel
def _judge(
    dropped: Array, dark: Array, noise: Array, has_ambient: np.float32, gain: np.float32,
    lights: np.float32, freedom: np.float32, leaves_out: bool, model: Array,
    sums: Rows, lost: Array,
) -> None:  # fmt: skip
    """The light that is not used, and the variance of the model error, in place of the sum."""
    high, second, low, energy, total, expected = sums
    a, b, black = noise
    zero, half, none = np.float32(0.0), np.float32(0.5), np.float32(NO_DROPPED_LIGHT)
    frames = has_ambient + np.float32(1.0)
    for c in range(len(dropped)):
        deviation = np.sqrt(frames * (a + b * max(dark[c] - black, zero)))
        level = max(min(DARK * gain * deviation, half * high[c]), LEAK * second[c])
        chosen = np.float32(dropped[c])
        chosen = lost[c] if leaves_out & (chosen == none) & (low[c] <= level) else chosen
        lost[c] = chosen
        mean = total[c] / lights
        variance = model[c] * mean * mean
        own = energy[c] / freedom
        is_own = (chosen == none) & (own > OWN * (variance + expected[c] / freedom))
        total[c] = variance + (own if is_own else zero)


@kernel
def _select(k: int, correction: Array, lost: Array, corrected: Rows) -> None:
    """Write the correction where light k is not used, and 0 elsewhere for the first light."""
    x, y, z = correction
    corrected_x, corrected_y, corrected_z = corrected
    index, kept = np.float32(k), np.float32(k > 0)
    for c in range(len(lost)):
        is_lost = lost[c] == index
        corrected_x[c] = x if is_lost else kept * corrected_x[c]
        corrected_y[c] = y if is_lost else kept * corrected_y[c]
        corrected_z[c] = z if is_lost else kept * corrected_z[c]


@kernel
def _add_light(
    weights: Array, nul: np.float32, plane: Array, x: Array, y: np.float32, slopes: Rows,
    normals: Rows, corrected: Rows, variances: Array, model: Array, gloss: Array, tangents: Rows,
) -> None:  # fmt: skip
    """Add the share of a light in the errors of the slopes times b_z, and of the albedo."""
    wx, wy, wz = weights
    nz, across = normals[0], normals[5]
    p, q = slopes
    plane_x, plane_y, plane_z = plane
    corrected_x, corrected_y, corrected_z = corrected
    v_p, v_q, v_rho, v_pq, g_p, g_q, g_rho = tangents
    for c in range(len(p)):
        mx, my = wx - nul * corrected_x[c], wy - nul * corrected_y[c]
        mz = wz - nul * corrected_z[c]
        inner = (mx * x[c] + my * y) * across[c]
        mx, my, mz = mx + plane_x * inner, my + plane_y * inner, mz + plane_z * inner
        to_p, to_q = mx + p[c] * mz, my + q[c] * mz
        to_rho = (mz - p[c] * mx - q[c] * my) * nz[c]
        variance = variances[c] + model[c]
        v_p[c] += to_p * to_p * variance
        v_q[c] += to_q * to_q * variance
        v_rho[c] += to_rho * to_rho * variance
        v_pq[c] += to_p * to_q * variance
        g_p[c] += to_p * gloss[c]
        g_q[c] += to_q * gloss[c]
        g_rho[c] += to_rho * gloss[c]


@kernel
def _finish(
    dark: Array, noise: Array, has_ambient: np.float32, even: Array, slopes: Rows,
    normals: Rows, tangents: Rows, p_sd: Array, q_sd: Array, albedo_sd: Array, angle_sd: Array,
) -> None:  # fmt: skip
    """Deviations of a row from the sums of all lights and the noise of the ambient image."""
    nz, scale = normals[0], normals[1]
    p, q = slopes
    v_p, v_q, v_rho, v_pq, g_p, g_q, g_rho = tangents
    a, b, black = noise
    even_x, even_y, even_z = even
    zero, half, one = np.float32(0.0), np.float32(0.5), np.float32(1.0)
    for c in range(len(p)):
        variance = has_ambient * (a + b * max(dark[c] - black, zero))
        to_p, to_q = even_x + p[c] * even_z, even_y + q[c] * even_z
        to_rho = (even_z - p[c] * even_x - q[c] * even_y) * nz[c]
        vp, vq = v_p[c] + to_p * to_p * variance, v_q[c] + to_q * to_q * variance
        vr, vpq = v_rho[c] + to_rho * to_rho * variance, v_pq[c] + to_p * to_q * variance
        inverse = one / scale[c]
        p_sd[c] = _with_bias(g_p[c], np.sqrt(vp)) * inverse
        q_sd[c] = _with_bias(g_q[c], np.sqrt(vq)) * inverse
        albedo_sd[c] = _with_bias(g_rho[c], np.sqrt(vr))
        # The angle between normals is (e dp^2 - 2 f dp dq + g dq^2)^0.5 / w^2.
        e, f, g = one + q[c] * q[c], p[c] * q[c], one + p[c] * p[c]
        trace = e * vp - (f + f) * vpq + g * vq
        bias = e * g_p[c] * g_p[c] - (f + f) * g_p[c] * g_q[c] + g * g_q[c] * g_q[c]
        determinant = (vp * vq - vpq * vpq) / (nz[c] * nz[c])
        spread = np.sqrt(max(half * half * trace * trace - determinant, zero))
        square = half * trace + spread + SECOND_AXIS * (half * trace - spread)
        angle = _with_bias(np.sqrt(max(bias, zero)), np.sqrt(max(square, zero)))
        angle_sd[c] = DEGREES * angle * inverse * nz[c] * nz[c]


@kernel
def _gloss(
    direction: Array, inverse_distance: np.float32, x: Array, y: np.float32, slopes: Rows,
    nz: Array, strengths: Array, power: Array, gloss: Array,
) -> None:  # fmt: skip
    """Light of the lobes in a row: see `uncertainty._lobes`."""
    zero = np.float32(0.0)
    lx, ly, lz = direction
    p, q = slopes
    ty = ly - inverse_distance * y
    for c in range(len(gloss)):
        tx = lx - inverse_distance * x[c]
        length = np.sqrt(tx * tx + ty * ty + lz * lz)
        tz = lz + length
        cosine = (tz - tx * p[c] - ty * q[c]) * nz[c] / np.sqrt(tx * tx + ty * ty + tz * tz)
        power[c] = max(cosine, zero)
        gloss[c] = zero
    for index in range(FIRST_POWER + POWERS):
        strength = strengths[max(index - FIRST_POWER, 0)] if index >= FIRST_POWER else zero
        for c in range(len(gloss)):
            gloss[c] += strength * power[c]
            power[c] *= power[c]


@kernel
def _with_bias(bias: np.float32, deviation: np.float32) -> np.float32:
    """Half width over 1.96 of the interval that holds 95 % of normal errors with a bias."""
    rest = np.float32(0.315) * deviation
    width = np.float32(1.645) * deviation + np.sqrt(bias * bias + rest * rest)
    return np.float32(width * np.float32(1.0 / 1.96))


@kernel
def walk_variances(pixels: Array, p: Array, q: Array, solved: Array, variances: Array) -> None:
    """Mean squared step around each pixel, times one more than the distance to a solved one.

    NaN where none is within `_FARTHEST_PX`.
    """
    rows, columns = p.shape
    for n in range(len(pixels)):
        y, x = divmod(pixels[n], columns)
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
        # Half of it is the variance of p, half that of q.
        variances[n] = total * (1 + distance) / (2 * count) if count else np.nan
