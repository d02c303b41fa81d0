"""Local statistics of relief and albedo, which differ where spectra are equal.

A power spectrum has no phase: pits and domes, cracks and ridges, bricks and gravel can share one.
They differ in skewness, kurtosis and the correlation of fine and coarse energy (after Portilla and
Simoncelli 2000). All are sums over pixels of isotropic responses, which rotations do not change.
"""

from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
import numpy.typing as npt

from classify.base.arrays import Array, Floats
from classify.base.compiling import kernel
from classify.base.threads import run_on_rows

from .fields import TextureFields
from .heading import HEADING_SUMS, add_row, heading_moments

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
# Rows and columns at the edge of the frame that the repeated border changes.
_BORDER = 2
_SUMS = 12


@dataclass(frozen=True, eq=False)
class LocalStatistics:
    """Moments of relief and albedo responses on each level of a pyramid of octaves.

    Row 0 is the frame, 1 to 4 its quarters; relief is -(dp/dx + dq/dy), albedo minus the Laplacian.
    The 8 moments are variances, third central moments and fourth cumulants of relief and albedo,
    their covariance, and the variance of the curl dq/dx - dp/dy, an estimate of the error of
    relief.
    """

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
    sums, odd_sums = [], []
    energies: list[Array] = []
    p_mean, q_mean = (np.float32(cv2.mean(plane)[0]) for plane in planes[:2])
    for level in range(levels):
        if level:
            planes = [cv2.pyrDown(plane) for plane in planes]
        rows, columns = planes[0].shape
        energy = np.empty((rows, columns, 2), np.float32)
        row_sums = np.zeros((rows, 2, _SUMS), np.float64)
        # The finest level would take most of the time, and its third moments are mostly noise.
        odd = np.zeros((rows if level else 0, 2, HEADING_SUMS), np.float64)
        respond = partial(_respond, *planes, p_mean, q_mean, energy, row_sums, odd)
        run_on_rows(respond, (rows, columns))
        sums.append(_of_quarters(row_sums))
        if level:
            odd_sums.append(_of_quarters(odd))
        energies = [cv2.pyrDown(energies_before) for energies_before in energies] if level else []
        energies.append(energy)
    powers = np.stack(sums, axis=1)
    moments = _central(powers)
    return LocalStatistics(
        moments=moments,
        energies=_energy_covariances(np.concatenate(energies, axis=2)),
        headings=heading_moments(
            np.array(odd_sums).reshape(-1, 1 + QUARTERS, HEADING_SUMS).swapaxes(0, 1),
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
    """(5, d) float64 statistics of order one, so that differences can be compared.

    The (levels,) floors are variances that are added to the measured ones; `albedo_leaks` is the
    share of the variance of relief that counts as variance of albedo.
    """
    relief, albedo, relief_3, albedo_3, relief_4, albedo_4, both, _ = np.moveaxis(
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
        np.arctanh(np.clip(both / np.sqrt(relief * albedo), -0.99, 0.99)),
    ]
    spread = np.sqrt(np.diagonal(measured.energies, axis1=1, axis2=2))
    upper = np.triu_indices(spread.shape[1], 1)
    scale = spread[:, upper[0]] * spread[:, upper[1]]
    together = measured.energies[:, upper[0], upper[1]] / np.maximum(scale, 1e-6)
    parts += [np.log(spread + 0.05), np.arctanh(np.clip(together, -0.95, 0.95))]
    return np.concatenate(parts, axis=1)


def statistics_length(levels: int) -> int:
    """Length d of a `statistics_vector` of `levels` octaves."""
    return 9 * levels + levels * (2 * levels - 1)


@kernel
def _respond(
    p: Array, q: Array, albedo: Array, p_mean: np.float32, q_mean: np.float32,
    energy: Array, sums: Array, odd: Array, first: int, stop: int,
) -> None:  # fmt: skip
    """Responses of rows of one level: squares, and sums of powers per row and half."""
    rows, columns = p.shape
    middle = columns // 2
    zero = np.float32(0.0)
    window = np.empty((3, 3, columns + 2), np.float32)
    responses = np.empty((3, columns), np.float32)
    z, a, e = responses[0], responses[1], responses[2]
    for r in range(first, stop):
        _copy_rows(p, r, window[0])
        _copy_rows(q, r, window[1])
        _copy_rows(albedo, r, window[2])
        _respond_row(window[0], window[1], window[2], responses)
        for c in range(columns):
            energy[r, c, 0] = z[c] * z[c]
            energy[r, c, 1] = a[c] * a[c]
        if not _BORDER <= r < rows - _BORDER:
            continue
        for side in range(2):
            begin, end = (middle, columns - _BORDER) if side else (_BORDER, middle)
            z1, z2, z3, z4 = zero, zero, zero, zero
            a1, a2, a3, a4 = zero, zero, zero, zero
            both, e1, e2 = zero, zero, zero
            for c in range(begin, end):
                z_square, a_square = z[c] * z[c], a[c] * a[c]
                z1 += z[c]
                z2 += z_square
                z3 += z_square * z[c]
                z4 += z_square * z_square
                a1 += a[c]
                a2 += a_square
                a3 += a_square * a[c]
                a4 += a_square * a_square
                both += z[c] * a[c]
                e1 += e[c]
                e2 += e[c] * e[c]
            powers = (np.float32(end - begin), z1, z2, z3, z4, a1, a2, a3, a4, both, e1, e2)
            for index in range(_SUMS):
                sums[r, side, index] = powers[index]
            if len(odd):
                add_row(p[r], q[r], z, a, p_mean, q_mean, begin, end, odd[r, side])


@kernel
def _copy_rows(plane: Array, r: int, target: Array) -> None:
    """Rows r - 1, r and r + 1 of a plane, with its edge pixels repeated."""
    rows, columns = plane.shape
    for n in range(3):
        row = min(max(r + n - 1, 0), rows - 1)
        for c in range(columns):
            target[n, c + 1] = plane[row, c]
        target[n, 0], target[n, columns + 1] = plane[row, 0], plane[row, columns - 1]


@kernel
def _respond_row(p: Array, q: Array, albedo: Array, responses: Array) -> None:
    """Relief, albedo and curl responses, by Scharr derivatives (2000) and a 9-point Laplacian."""
    near, far = np.float32(10.0 / 32.0), np.float32(3.0 / 32.0)
    for left in range(p.shape[1] - 2):
        c, right = left + 1, left + 2
        dp_dx = near * (p[1, right] - p[1, left]) + far * (
            p[0, right] - p[0, left] + p[2, right] - p[2, left]
        )
        dq_dx = near * (q[1, right] - q[1, left]) + far * (
            q[0, right] - q[0, left] + q[2, right] - q[2, left]
        )
        dp_dy = near * (p[0, c] - p[2, c]) + far * (
            p[0, left] - p[2, left] + p[0, right] - p[2, right]
        )
        dq_dy = near * (q[0, c] - q[2, c]) + far * (
            q[0, left] - q[2, left] + q[0, right] - q[2, right]
        )
        corners = albedo[0, left] + albedo[0, right] + albedo[2, left] + albedo[2, right]
        sides = albedo[0, c] + albedo[2, c] + albedo[1, left] + albedo[1, right]
        centre = np.float32(20.0) * albedo[1, c]
        laplacian = np.float32(1.0 / 6.0) * (corners + np.float32(4.0) * sides - centre)
        responses[0, left] = -(dp_dx + dq_dy)
        responses[1, left] = -laplacian
        responses[2, left] = dq_dx - dp_dy


def _of_quarters(row_sums: Array) -> Floats:
    """(5, d) sums of the frame and of its quarters, from sums per row and side."""
    half = len(row_sums) // 2
    quarters = np.concatenate([row_sums[:half].sum(axis=0), row_sums[half:].sum(axis=0)])
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
