"""Local statistics of relief and albedo, which differ where spectra are equal.

A power spectrum has no phase: pits and domes, cracks and ridges, bricks and gravel can share one.
They differ in skewness, kurtosis and the correlation of fine and coarse energy (after Portilla and
Simoncelli 2000). All are sums over pixels of isotropic responses, which rotations do not change.
"""

from dataclasses import dataclass
from functools import lru_cache, partial

import cv2
import numpy as np
import numpy.typing as npt

from classify.base.arrays import Array, Floats, Indices
from classify.base.compiling import kernel
from classify.base.threads import run_on_rows

from .fields import TextureFields
from .heading import HEADING_SUMS, TILE, add_row, heading_moments, sum_tiles

QUARTERS = 4
"""Quarters of a frame; their differences show how much one surface differs from itself."""

# Blur before the first derivative, which makes the 3 x 3 stencils isotropic (test_statistics.py).
_BLUR_PX = 0.8
# Pixels beyond the kernel would weigh less than a thousandth.
_BLUR_SIZE = (5, 5)
# The coarsest level has at least this many pixels on a side of a quarter.
_COARSEST_PX = 16
# Floor of the energies, as a share of their mean; without it logarithms of noise would dominate.
_ENERGY_FLOOR = np.float32(0.01)
# Share of the local relief energy that is added to the albedo energy: penumbra, gloss and unequal
# lights leak about as much relief into a constant albedo.
_LEAK = np.float32(0.025)
# Number of rows and columns at each edge of the frame that the repeated border changes.
_BORDER = 2
_SUMS = 12
# Number of rows that are summed in single precision; larger blocks would lose digits.
_ROWS = 64


@dataclass(frozen=True, eq=False)
class LocalStatistics:
    """Moments of relief and albedo responses on each level of a pyramid of octaves."""

    # Row 0 is the frame, 1 to 4 its quarters; relief is -(dp/dx + dq/dy), albedo minus the
    # Laplacian. The 8 moments are variances, third central moments and fourth cumulants of relief
    # and albedo, their covariance, and the variance of the curl dq/dx - dp/dy, an estimate of the
    # error of relief.

    moments: Floats  # (5, levels, 8)
    energies: Floats  # (5, 2 levels, 2 levels) covariances of log local energy
    headings: npt.NDArray[np.complex128]  # (5, levels - 1, 6), not of the finest

    @property
    def levels(self) -> int:
        return len(self.moments[0])


def levels_for(segment_px: int) -> int:
    """Octaves for segments of this side, in frames of at least twice that side."""
    return (segment_px // _COARSEST_PX).bit_length()


def local_statistics(fields: TextureFields, levels: int) -> LocalStatistics:
    """Measure a frame of at least `16 * 2**levels` px, and its quarters, level by level."""
    planes = [
        cv2.GaussianBlur(plane, _BLUR_SIZE, _BLUR_PX, borderType=cv2.BORDER_REFLECT_101)
        for plane in (fields.p, fields.q, fields.albedo)
    ]
    sums, heading_sums = [], []
    energies: list[Array] = []
    p_mean, q_mean = (np.float32(cv2.mean(plane)[0]) for plane in planes[:2])
    for level in range(levels):
        if level:
            planes = [cv2.pyrDown(plane) for plane in planes]
        rows, columns = planes[0].shape
        energy = np.empty((rows, columns, 2), np.float32)
        edges = _block_edges(rows)
        blocks = len(edges) - 1
        block_sums = np.empty((blocks, 2, _SUMS), np.float64)
        # The finest level would take most of the time, and its third moments are mostly noise.
        heading_blocks = np.empty((blocks if level else 0, 2, HEADING_SUMS), np.float64)
        respond = partial(
            _respond, *planes, p_mean, q_mean, edges, energy, block_sums, heading_blocks
        )
        run_on_rows(respond, (blocks, _ROWS * columns))
        sums.append(_frame_and_quarter_sums(block_sums))
        if level:
            heading_sums.append(_frame_and_quarter_sums(heading_blocks))
        energies = [cv2.pyrDown(energies_before) for energies_before in energies] if level else []
        energies.append(energy)
    powers = np.stack(sums, axis=1)
    moments = _central(powers)
    return LocalStatistics(
        moments=moments,
        energies=_energy_covariances(np.concatenate(energies, axis=2)),
        headings=heading_moments(
            np.array(heading_sums).reshape(-1, 1 + QUARTERS, HEADING_SUMS).swapaxes(0, 1),
            powers[:, 1:, 0],
            moments[:, 1:, :2],
        ),
    )


def statistics_vector(
    measured: LocalStatistics,
    relief_floors: Floats,
    albedo_floors: Floats,
    albedo_leaks: Floats | float = 0.0,
) -> Floats:
    """(5, d) float64 statistics of order one.

    Variances are increased by (levels,) floors, and that of albedo by `albedo_leaks` times that of
    relief.
    """
    relief, albedo, relief_3, albedo_3, relief_4, albedo_4, covariance, _ = np.moveaxis(
        measured.moments, 2, 0
    )
    albedo = albedo + albedo_floors + albedo_leaks * relief
    relief = relief + relief_floors
    parts = [
        0.5 * np.log(relief),
        0.5 * np.log(albedo),
        np.tanh(0.5 * relief_3 / relief**1.5),
        np.tanh(0.5 * albedo_3 / albedo**1.5),
        np.log(np.maximum(4.0 + relief_4 / relief**2, 1.0)),
        np.log(np.maximum(4.0 + albedo_4 / albedo**2, 1.0)),
        np.arctanh(np.clip(covariance / np.sqrt(relief * albedo), -0.99, 0.99)),
    ]
    spread = np.sqrt(np.diagonal(measured.energies, axis1=1, axis2=2))
    upper = np.triu_indices(spread.shape[1], 1)
    scale = spread[:, upper[0]] * spread[:, upper[1]]
    correlations = measured.energies[:, upper[0], upper[1]] / np.maximum(scale, 1e-6)
    # Finite also for a spread of 0 and a correlation of 1.
    parts += [np.log(spread + 0.05), np.arctanh(np.clip(correlations, -0.95, 0.95))]
    return np.concatenate(parts, axis=1)


def statistics_length(levels: int) -> int:
    """Length d of a `statistics_vector` of `levels` octaves."""
    return 9 * levels + levels * (2 * levels - 1)


@kernel
def _respond(
    p: Array, q: Array, albedo: Array, p_mean: np.float32, q_mean: np.float32, edges: Array,
    energy: Array, sums: Array, heading_blocks: Array, first: int, stop: int,
) -> None:  # fmt: skip
    """Write squared responses of one level, and sums of powers per block of rows and half."""
    rows, columns = p.shape
    middle = columns // 2
    # Row n of a plane is in row n % 3.
    windows = np.empty((3, 3, columns + 2), np.float32)
    # Relief, albedo and curl; slopes less their mean.
    responses = np.zeros((5, -(-columns // TILE) * TILE), np.float32)
    z, a, e, x, y = responses[0], responses[1], responses[2], responses[3], responses[4]
    for block in range(first, stop):
        column_sums = np.zeros(responses.shape[1] * _SUMS, np.float32)
        heading_column_sums = np.zeros(responses.shape[1] * HEADING_SUMS, np.float32)
        for r in range(edges[block] - 1, edges[block + 1] + 1):
            row = min(max(r, 0), rows - 1)
            _copy_row(p, row, windows[0, r % 3])
            _copy_row(q, row, windows[1, r % 3])
            _copy_row(albedo, row, windows[2, r % 3])
            here = r - 1
            if here < edges[block]:
                continue
            _respond_row(windows[0], windows[1], windows[2], here % 3, responses)
            squares = energy[here].reshape(-1)
            for c in range(columns):
                squares[2 * c], squares[2 * c + 1] = z[c] * z[c], a[c] * a[c]
            if not _BORDER <= here < rows - _BORDER:
                continue
            _add_powers(z, a, e, column_sums)
            if len(heading_blocks):
                for c in range(columns):
                    responses[3, c] = p[here, c] - p_mean
                    responses[4, c] = q[here, c] - q_mean
                add_row(x, y, z, a, heading_column_sums)
        for side in range(2):
            begin, end = (middle, columns - _BORDER) if side else (_BORDER, middle)
            sum_tiles(column_sums, begin, end, sums[block, side])
            if len(heading_blocks):
                sum_tiles(heading_column_sums, begin, end, heading_blocks[block, side])


@kernel
def _add_powers(z_row: Array, a_row: Array, e_row: Array, sums: Array) -> None:
    """Add 1 and the powers of the responses of a row to the sums of its columns, as `add_row`."""
    for tile in range(len(z_row) // TILE):
        offset = tile * _SUMS * TILE
        for c in range(TILE):
            z, a, e = z_row[tile * TILE + c], a_row[tile * TILE + c], e_row[tile * TILE + c]
            z_square, a_square = z * z, a * a
            sums[offset + c] += np.float32(1.0)
            sums[offset + TILE + c] += z
            sums[offset + 2 * TILE + c] += z_square
            sums[offset + 3 * TILE + c] += z_square * z
            sums[offset + 4 * TILE + c] += z_square * z_square
            sums[offset + 5 * TILE + c] += a
            sums[offset + 6 * TILE + c] += a_square
            sums[offset + 7 * TILE + c] += a_square * a
            sums[offset + 8 * TILE + c] += a_square * a_square
            sums[offset + 9 * TILE + c] += z * a
            sums[offset + 10 * TILE + c] += e
            sums[offset + 11 * TILE + c] += e * e


@kernel
def _copy_row(plane: Array, r: int, target: Array) -> None:
    """Row r of a plane, with its edge pixels repeated."""
    columns = plane.shape[1]
    for c in range(columns):
        target[c + 1] = plane[r, c]
    target[0], target[columns + 1] = plane[r, 0], plane[r, columns - 1]


@kernel
def _respond_row(p: Array, q: Array, albedo: Array, here: int, responses: Array) -> None:
    """Relief, albedo and curl responses, by Scharr derivatives (2000) and a 9-point Laplacian."""
    near, far = np.float32(10.0 / 32.0), np.float32(3.0 / 32.0)
    above, below = (here + 2) % 3, (here + 1) % 3
    for left in range(p.shape[1] - 2):
        c, right = left + 1, left + 2
        dp_dx = near * (p[here, right] - p[here, left]) + far * (
            p[above, right] - p[above, left] + p[below, right] - p[below, left]
        )
        dq_dx = near * (q[here, right] - q[here, left]) + far * (
            q[above, right] - q[above, left] + q[below, right] - q[below, left]
        )
        dp_dy = near * (p[above, c] - p[below, c]) + far * (
            p[above, left] - p[below, left] + p[above, right] - p[below, right]
        )
        dq_dy = near * (q[above, c] - q[below, c]) + far * (
            q[above, left] - q[below, left] + q[above, right] - q[below, right]
        )
        # Differences from the centre, which rounding changes less than sums.
        centre = albedo[here, c]
        corners = (albedo[above, left] - centre) + (albedo[above, right] - centre)
        corners += (albedo[below, left] - centre) + (albedo[below, right] - centre)
        sides = (albedo[above, c] - centre) + (albedo[below, c] - centre)
        sides += (albedo[here, left] - centre) + (albedo[here, right] - centre)
        laplacian = np.float32(1.0 / 6.0) * (corners + np.float32(4.0) * sides)
        responses[0, left] = -(dp_dx + dq_dy)
        responses[1, left] = -laplacian
        responses[2, left] = dq_dx - dp_dy


@lru_cache(maxsize=32)
def _block_edges(rows: int) -> Indices:
    """First rows of blocks, as many in the upper half as in the lower one, and the last edge."""
    half, blocks = rows // 2, max(1, rows // (2 * _ROWS))
    shares = np.arange(blocks + 1) / blocks
    upper, lower = half * shares[:-1], half + (rows - half) * shares
    return np.concatenate([upper, lower]).astype(np.intp)


def _frame_and_quarter_sums(block_sums: Array) -> Floats:
    """(5, d) sums of the frame and of its quarters, from sums per block and side."""
    sums = block_sums.shape[-1]
    quarters = block_sums.reshape(2, -1, 2, sums).sum(axis=1).reshape(-1, sums)
    return np.concatenate([quarters.sum(axis=0, keepdims=True), quarters])


def _central(sums: Floats) -> Floats:
    """(..., 8) moments about the mean from (..., 12) sums of powers."""
    means = np.moveaxis(sums[..., 1:] / sums[..., :1], -1, 0)
    z1, z2, z3, z4, a1, a2, a3, a4, za, e1, e2 = means
    z_variance, a_variance = z2 - z1**2, a2 - a1**2
    z_third = z3 - 3 * z1 * z2 + 2 * z1**3
    a_third = a3 - 3 * a1 * a2 + 2 * a1**3
    z_fourth = z4 - 4 * z1 * z3 + 6 * z1**2 * z2 - 3 * z1**4 - 3 * z_variance**2
    a_fourth = a4 - 4 * a1 * a3 + 6 * a1**2 * a2 - 3 * a1**4 - 3 * a_variance**2
    columns = [
        z_variance, a_variance, z_third, a_third, z_fourth, a_fourth, za - z1 * a1, e2 - e1**2,
    ]  # fmt: skip
    return np.stack(columns, axis=-1)


def _energy_covariances(energies: Array) -> Floats:
    """(5, m, m) covariances of log energy over an (h, w, m) grid and its quarters."""
    energies[..., 1::2] += _LEAK * energies[..., 0::2]
    floor = _ENERGY_FLOOR * energies.mean(axis=(0, 1)) + np.float32(1e-12)
    logs = np.log(energies + floor)[_BORDER:-_BORDER, _BORDER:-_BORDER]
    rows, columns, _ = logs.shape
    halves = (slice(None, rows // 2), slice(rows // 2, None))
    sides = (slice(None, columns // 2), slice(columns // 2, None))
    parts = [logs, *(logs[half, side] for half in halves for side in sides)]
    samples = [part.reshape(-1, logs.shape[2]) for part in parts]
    centred = [sample - sample.mean(axis=0) for sample in samples]
    return np.stack([(sample.T @ sample).astype(np.float64) / len(sample) for sample in centred])
