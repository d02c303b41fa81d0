"""Features of a part in cells and windows: moments, energies and directions of its octaves."""

from functools import partial

import cv2
import numpy as np

from classify.base.compiling import Array, kernel
from classify.base.errors import InputError
from classify.base.threads import run_on_rows
from classify.surface.estimate import FloatMap, SurfaceEstimate
from classify.texture.fields import texture_fields

CELL_PX = 8
"""Pixels on a side of a cell."""
OCTAVES = 4
"""Octaves below the finest one; of the finest, only the energies are measured."""
PRODUCTS = 8
"""Products of the fields in an octave."""
MOMENTS = 2 + PRODUCTS * OCTAVES + 3
"""Columns of `band_moments`."""
_MIN_SIDE_PX = 128

# Box at half resolution that smooths the log albedo before its means in cells, so that the level of
# a joint does not depend on how the cells divide it: without it 4 of 20 good tiles had a spot
# beyond its limit, with it none. Wider boxes, or boxes on p and q, found no more defects on the
# even materials of `python -m tests.evidence.wrong_passes`.
_ALBEDO_BOX = (5, 5)
_TINY = np.float32(1e-12)
_MIN_ALBEDO = np.float32(1e-2)


def band_moments(surface: SurfaceEstimate) -> FloatMap:
    """(h, w, MOMENTS) float32 means over cells of products of the fields."""
    # Columns: the energies of slopes and of log albedo a in the finest octave. For each octave,
    # with g = p + i q: |g|^2, real and imaginary parts of g^2 and of g^4 / |g|^2, a^2, p a and q a.
    # Last, the means of p, q and the smoothed a. A pixel of the coarsest octave covers 2 x 2
    # cells, so the number of cells is even; rows and columns beyond it are left out.
    if min(surface.shape) < _MIN_SIDE_PX:
        raise InputError(
            f"a part of {surface.shape[1]} x {surface.shape[0]} px; its sides must be "
            f"{_MIN_SIDE_PX} px or more"
        )
    fields = texture_fields(surface)
    h, w = (2 * (side // (2 * CELL_PX)) for side in surface.shape)
    moments = np.empty((h, w, MOMENTS), np.float32)
    planes = np.empty((3, h * CELL_PX // 2, w * CELL_PX // 2), np.float32)
    run_on_rows(
        partial(_halve, fields.p, fields.q, fields.albedo, planes, moments), (h, 2 * planes[0].size)
    )
    np.log(np.maximum(planes[2], _MIN_ALBEDO, out=planes[2]), out=planes[2])
    levels: list[Array] = list(planes)
    for octave in range(OCTAVES):
        coarser = [cv2.pyrDown(plane) for plane in levels]
        size = levels[0].shape[::-1]
        smooth = [cv2.pyrUp(plane, dstsize=size) for plane in coarser]
        cells = moments[..., 2 + PRODUCTS * octave :][..., :PRODUCTS]
        rows = min(h, len(levels[0]))
        products = np.empty((rows, w * rows // h, PRODUCTS), np.float32)
        run_on_rows(partial(_sum_products, *levels, *smooth, products), (rows, levels[0].size))
        cells[...] = products if rows == h else products.repeat(2, axis=0).repeat(2, axis=1)
        levels = coarser
    for index, plane in enumerate([*planes[:2], cv2.blur(planes[2], _ALBEDO_BOX)]):
        moments[..., index - 3] = cv2.resize(plane, (w, h), interpolation=cv2.INTER_AREA)
    return moments


@kernel
def _halve(
    p: Array, q: Array, albedo: Array, planes: Array, moments: Array, first: int, stop: int
) -> None:
    """Write means of 2 x 2 pixels to `planes`, and energies of the residual to `moments`."""
    cell = CELL_PX // 2
    columns = planes.shape[2]
    quarter, zero = np.float32(0.25), np.float32(0.0)
    share = np.float32(1.0) / np.float32(4 * cell * cell)
    residual = np.empty((2, columns), np.float32)
    for row in range(first, stop):
        residual[:] = zero
        for r in range(row * cell, (row + 1) * cell):
            for c in range(columns):
                y, x = 2 * r, 2 * c
                p0, p1, p2, p3 = p[y, x], p[y, x + 1], p[y + 1, x], p[y + 1, x + 1]
                q0, q1, q2, q3 = q[y, x], q[y, x + 1], q[y + 1, x], q[y + 1, x + 1]
                a0, a1 = albedo[y, x], albedo[y, x + 1]
                a2, a3 = albedo[y + 1, x], albedo[y + 1, x + 1]
                pm, qm = quarter * (p0 + p1 + p2 + p3), quarter * (q0 + q1 + q2 + q3)
                am = quarter * (a0 + a1 + a2 + a3)
                planes[0, r, c], planes[1, r, c], planes[2, r, c] = pm, qm, am
                p0, p1, p2, p3 = p0 - pm, p1 - pm, p2 - pm, p3 - pm
                q0, q1, q2, q3 = q0 - qm, q1 - qm, q2 - qm, q3 - qm
                a0, a1, a2, a3 = a0 - am, a1 - am, a2 - am, a3 - am
                residual[0, c] += p0 * p0 + p1 * p1 + p2 * p2 + p3 * p3
                residual[0, c] += q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3
                level = max(am, _MIN_ALBEDO)
                residual[1, c] += (a0 * a0 + a1 * a1 + a2 * a2 + a3 * a3) / (level * level)
        for column in range(moments.shape[1]):
            for index in range(2):
                total = zero
                for c in range(column * cell, (column + 1) * cell):
                    total += residual[index, c]
                moments[row, column, index] = share * total


@kernel
def _sum_products(
    p: Array, q: Array, a: Array, smooth_p: Array, smooth_q: Array, smooth_a: Array,
    moments: Array, first: int, stop: int,
) -> None:  # fmt: skip
    """Write the products of one octave for rows of cells."""
    # An octave is the difference of two levels of the Laplacian pyramid (Burt and Adelson 1983).
    columns = p.shape[1]
    cell = columns // moments.shape[1]
    zero, two = np.float32(0.0), np.float32(2.0)
    share = np.float32(1.0) / np.float32(cell * cell)
    sums = np.empty((PRODUCTS, columns), np.float32)
    for row in range(first, stop):
        sums[:] = zero
        for r in range(row * cell, (row + 1) * cell):
            for c in range(columns):
                x, y = p[r, c] - smooth_p[r, c], q[r, c] - smooth_q[r, c]
                level = a[r, c] - smooth_a[r, c]
                energy = x * x + y * y
                real, imaginary = x * x - y * y, two * x * y  # of (x + i y)^2
                inverse = np.float32(1.0) / max(energy, _TINY)
                sums[0, c] += energy
                sums[1, c] += real
                sums[2, c] += imaginary
                sums[3, c] += (real * real - imaginary * imaginary) * inverse
                sums[4, c] += two * real * imaginary * inverse
                sums[5, c] += level * level
                sums[6, c] += level * x
                sums[7, c] += level * y
        for column in range(moments.shape[1]):
            for index in range(PRODUCTS):
                total = zero
                for c in range(column * cell, (column + 1) * cell):
                    total += sums[index, c]
                moments[row, column, index] = share * total


FEATURES = 2 + 6 * OCTAVES + 2
"""Number of features of a window, see `window_features`."""
DIRECTIONS = tuple(2 + 6 * octave + k for octave in range(OCTAVES) for k in (1, 2, 3, 4))
"""The features that depend on the orientation of the texture."""

# Columns of energies of slopes, and of log albedo, in the moments.
_SLOPES = (0, *(2 + PRODUCTS * octave for octave in range(OCTAVES)))
_ALBEDOS = (1, *(7 + PRODUCTS * octave for octave in range(OCTAVES)))
# Floor of the energies, as a share of their mean in good parts, so that the log energy of a window
# without texture does not depend on its noise.
_FLOOR_SHARE = 0.005
_MIN_ENERGY = 1e-6


def energy_columns() -> list[int]:
    """Columns of the moments with energies: of slopes in each octave, then of log albedo."""
    return [*_SLOPES, *_ALBEDOS]


def energy_floors(mean_moments: FloatMap) -> FloatMap:
    """(MOMENTS,) floors that are added to energies, from the mean moments of good parts."""
    floors = np.zeros(MOMENTS, np.float32)
    energies = energy_columns()
    floors[energies] = _FLOOR_SHARE * mean_moments[energies] + _MIN_ENERGY
    return floors


def coarser(moments: FloatMap) -> FloatMap:
    """Means over 2 x 2 cells."""
    means: Array = cv2.blur(moments, (2, 2), anchor=(0, 0))
    return np.ascontiguousarray(means[::2, ::2], np.float32)


def window_moments(moments: FloatMap, cells: int) -> FloatMap:
    """(h, w, MOMENTS) means over windows of `cells` x `cells`, which overlap by half.

    Cells at the right and lower border that fill no window are left out.
    """
    means = cv2.blur(moments, (cells, cells), anchor=(0, 0), borderType=cv2.BORDER_REPLICATE)
    rows, columns = (side - cells + 1 for side in moments.shape[:2])
    step = max(cells // 2, 1)
    return np.ascontiguousarray(means[:rows:step, :columns:step])


def window_features(moments: FloatMap, floors: FloatMap, orientation_deg: float) -> FloatMap:
    """(n, FEATURES) float32 features of windows, in the frame of the texture.

    They are the log rms of slopes and of log albedo, the second and fourth harmonics of the slopes
    by octave, and the mean log albedo and slope.
    """
    flat = np.moveaxis(moments.reshape(-1, MOMENTS) + floors, -1, 0)
    half = np.float32(0.5)
    features = [half * np.log(np.maximum(flat[k], _MIN_ENERGY)) for k in (0, 1)]
    rotations = [np.exp(-1j * n * np.radians(orientation_deg)).astype(np.complex64) for n in (2, 4)]
    for octave in range(OCTAVES):
        energy, *parts, albedo, _, _ = flat[2 + PRODUCTS * octave :][:PRODUCTS]
        features.append(half * np.log(energy))
        for rotation, (cosine, sine) in zip(rotations, (parts[:2], parts[2:]), strict=True):
            features += [
                (rotation.real * cosine - rotation.imag * sine) / energy,
                (rotation.real * sine + rotation.imag * cosine) / energy,
            ]
        features.append(half * np.log(albedo))
    p, q, level = flat[-3:]
    features += [level, np.hypot(p, q)]
    return np.stack(features, axis=-1)
