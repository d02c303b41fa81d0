"""Departure of spots from a prediction by their surroundings.

A spot is a cell with its neighbours. A linear regression predicts its energies, level and slopes
from rings around it, and a second one predicts the size of the error, because beside a joint a spot
is hard to predict. Both are learned from good parts.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Self

import cv2
import numpy as np

from classify.base.arrays import Floats
from classify.base.compiling import Array, kernel
from classify.base.threads import run_on_rows
from classify.surface.estimate import FloatMap

from .features import OCTAVES, PRODUCTS, energy_columns

DEPARTURES = ("missing", "polished", "washed", "stain", "dent")
"""No texture, no fine relief, no fine albedo; another log albedo; slopes of a dent or a bump."""
_MARGIN = 3
"""Width of the border of a part without spots, in cells."""

_FINE_OCTAVES = OCTAVES - 1  # pixels of the coarsest octave are larger than a cell
# Columns of the energies of slopes, then of log albedo; without the coarsest octave.
_ENERGY_COLUMNS = [c for n, c in enumerate(energy_columns()) if n % (OCTAVES + 1) < OCTAVES]
# Measured rings as (radius in cells, template): levels of log albedo in a stain of 60 px, and
# outward slopes in a dent of 40 px.
_LEVELS, _SLOPES = ((0.0, 1.0), (1.0, 0.92), (2.0, 0.63)), ((1.0, 1.0), (2.0, 0.6))
# Radii in cells of the rings of the surroundings, number of points on a ring, and level of a stain
# of 60 px on the first ring, as a share of that in its middle. A hole of 40 px does not reach the
# ring. On the even materials of `python -m tests.evidence.wrong_passes`, three rings found no more
# defects.
_RINGS, _POINTS, _STAIN_ON_RING = (3.5, 5.5), 8, 0.16
# Decreases of the log energies of slopes, then of log albedo, from the finest octave on. Those of
# polished relief and of albedo that is washed out were chosen on patches of 40 and 60 px in
# Bark014, Fabric018 and Rock053.
_DECREASES = np.array([
    [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
    [0.5, 1.0, 1.0, 0.6, 0.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.6, 0.1],
])  # fmt: skip
_MEASURED_COUNT = len(_ENERGY_COLUMNS) + len(_LEVELS) + len(_SLOPES)
_PLANE_COUNT = len(_ENERGY_COLUMNS) + 3
_AROUND_COUNT = len(_RINGS) * _POINTS * _PLANE_COUNT + _POINTS // 2 * _FINE_OCTAVES
SPOT_VALUES = _MEASURED_COUNT + _AROUND_COUNT
"""Number of values of a spot: those measured in it, then those of its surroundings."""

# Columns of the energies of slopes, and of their second harmonics, even and odd.
_DIRECTED_COLUMNS = [2 + PRODUCTS * octave + n for n in range(3) for octave in range(_FINE_OCTAVES)]
_DISC = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.float32) / np.float32(5)
_BOX = np.full((3, 3), 1 / 9, np.float32)
_GAUSSIAN = np.outer(*[np.asarray(cv2.getGaussianKernel(5, 0.6), np.float32)] * 2)
_PADDING = 4  # cells; more than the largest radius beyond the margin
_MIN_ENERGY = np.float32(1e-6)
_RIDGE = 0.01  # ridge on covariances, as a share of the variances; larger for few spots
# Floor of the squared errors before logarithms, as a share of their mean; largest log size of an
# error.
_FLOOR_SHARE, _MAX_LOG_SIZE = 0.05, 1.5


def spot_values(moments: FloatMap, floors: FloatMap, orientation_deg: float) -> FloatMap:
    """(SPOT_VALUES, h, w) float32 of the cells within the margin, in the frame of the texture."""
    rows, columns = moments.shape[:2]
    values = np.empty((SPOT_VALUES, rows - 2 * _MARGIN, columns - 2 * _MARGIN), np.float32)
    # A match knows the orientation modulo 180 degrees.
    orientation = np.radians(orientation_deg % 180.0)
    energies = _planes(moments, _ENERGY_COLUMNS) + floors[_ENERGY_COLUMNS, None, None]
    means = _planes(moments, [-3, -2, -1])
    values[: len(_ENERGY_COLUMNS)] = _logs(_inside(_filtered(energies, _DISC)))
    row = len(_ENERGY_COLUMNS)
    for radius, _ in _LEVELS:
        values[row] = _inside(_filtered(means[2:], _ring(radius)[0]))[0]
        row += 1
    for radius, _ in _SLOPES:
        _, x, y = _ring(radius)
        values[row] = _inside(cv2.filter2D(means[0], -1, x) + cv2.filter2D(means[1], -1, y))
        row += 1
    directions = orientation + 2.0 * np.pi / _POINTS * np.arange(_POINTS)
    p, q, level = _filtered(means, _GAUSSIAN)
    c, s = np.float32(np.cos(orientation)), np.float32(np.sin(orientation))
    surroundings = [level, c * p + s * q, c * q - s * p, *_logs(_filtered(energies, _BOX))]
    padded = _padded(surroundings)
    for radius in _RINGS:
        for angle in directions:
            _shift(padded, radius, angle, values[row : row + len(padded)])
            row += len(padded)
    directed = _filtered(_planes(moments, _DIRECTED_COLUMNS), _DISC)
    values[row:] = _joint_energies(directed, floors, directions)
    return values


def _joint_energies(planes: FloatMap, floors: FloatMap, directions: Floats) -> FloatMap:
    """Log energies of slopes across a line through the spot, for each direction of the line.

    The lesser energy of two opposite points on the first ring: a joint through the spot has both.
    """
    energies, even, odd = np.split(planes, 3)
    shape = [side - 2 * _MARGIN for side in planes.shape[1:]]
    energies_at = np.empty((_POINTS, _FINE_OCTAVES, *shape), np.float32)
    for angle, shifted in zip(directions, energies_at, strict=True):
        c, s = np.float32(np.cos(2.0 * angle)), np.float32(np.sin(2.0 * angle))
        across = np.float32(0.5) * (energies - c * even - s * odd)
        across = np.maximum(across, 0.0) + floors[_DIRECTED_COLUMNS[:_FINE_OCTAVES], None, None]
        _shift(_padded(across), _RINGS[0], angle, shifted)
    lesser = np.minimum(*np.split(energies_at, 2))
    return _logs(lesser.reshape(-1, *shape))


def _planes(moments: FloatMap, columns: list[int]) -> FloatMap:
    return np.ascontiguousarray(np.moveaxis(moments[..., columns], -1, 0))


def _filtered(planes: FloatMap, kernel_: FloatMap) -> FloatMap:
    return np.stack([cv2.filter2D(plane, -1, kernel_) for plane in planes])


def _logs(energies: FloatMap) -> FloatMap:
    return np.asarray(np.float32(0.5) * np.log(np.maximum(energies, _MIN_ENERGY)), np.float32)


def _inside(cells: FloatMap) -> FloatMap:
    return cells[..., _MARGIN:-_MARGIN, _MARGIN:-_MARGIN]


def _padded(planes: Sequence[FloatMap] | FloatMap) -> FloatMap:
    sides = (_PADDING,) * 4
    return np.stack([cv2.copyMakeBorder(plane, *sides, cv2.BORDER_REFLECT_101) for plane in planes])


def _shift(padded: FloatMap, radius: float, angle: float, shifted: FloatMap) -> None:
    """Set `shifted` to the planes shifted by a vector in polar coordinates, without the margin."""
    row = _MARGIN + _PADDING - radius * np.sin(angle)
    column = _MARGIN + _PADDING + radius * np.cos(angle)
    top, left = int(row), int(column)
    y, x = row - top, column - left
    shares = np.array([(1 - y) * (1 - x), (1 - y) * x, y * (1 - x), y * x], np.float32)
    run_on_rows(
        partial(_interpolate, padded, shares, top, left, shifted),
        (shifted.shape[1], shifted[:, 0].size),
    )


@kernel
def _interpolate(
    planes: Array, shares: Array, top: int, left: int, shifted: Array, first: int, stop: int
) -> None:
    """Bilinear interpolation of shifted planes; rows of the result."""
    s0, s1, s2, s3 = shares
    width = shifted.shape[2]
    for n in range(shifted.shape[0]):
        for r in range(first, stop):
            # Slices from 0, because an index that may be negative prevents vectorisation.
            upper = planes[n, top + r, left : left + width + 1]
            lower = planes[n, top + r + 1, left : left + width + 1]
            out = shifted[n, r]
            for c in range(width):
                out[c] = s0 * upper[c] + s1 * upper[c + 1] + s2 * lower[c] + s3 * lower[c + 1]


@lru_cache(maxsize=8)
def _ring(radius: float) -> tuple[FloatMap, FloatMap, FloatMap]:
    """Kernels of a ring: the mean, and those of x and y for the mean outward component."""
    # Its profile is a Gaussian with a standard deviation of 0.45 cells.
    y, x = np.mgrid[4:-5:-1, -4:5].astype(np.float32)
    distance = np.hypot(x, y)
    weight = np.exp(-0.5 * ((distance - radius) / 0.45) ** 2)
    weight /= weight.sum()
    share = weight / np.maximum(distance, 1e-3)
    return weight, share * x, share * y


@dataclass(frozen=True, eq=False)
class SpotModel:
    """Linear map from the values of a spot to its k departures from the prediction.

    The departures are in units of their limits; k further results are the predicted log sizes of
    the errors.
    """

    weights: FloatMap  # (SPOT_VALUES, 2 k)
    offsets: FloatMap  # (2 k,)

    @classmethod
    def of(cls, values: FloatMap) -> Self:
        """Learn from (SPOT_VALUES, n) values of good spots."""
        measured, around = np.split(values.T.astype(np.float64), [_MEASURED_COUNT], axis=1)
        measured_mean, around_mean = measured.mean(axis=0), around.mean(axis=0)
        unit = around.std(axis=0) + 1e-4
        around, measured = (around - around_mean) / unit, measured - measured_mean
        covariance = around.T @ around / len(around)
        covariance += max(_RIDGE, len(covariance) / len(around)) * np.eye(len(covariance))
        expected = np.linalg.solve(covariance, around.T @ measured / len(around))
        # A stain also changes the levels on the first ring, so a part of it is predicted.
        first_ring = (expected / unit[:, None])[: _POINTS * _PLANE_COUNT : _PLANE_COUNT]
        errors = measured - around @ expected
        to_departures = _to_departures(errors, _STAIN_ON_RING * first_ring.sum(axis=0))
        departures = errors @ to_departures
        squares = departures**2
        logs = 0.5 * np.log(squares + _FLOOR_SHARE * squares.mean(axis=0) + 1e-12)
        logs -= logs.mean(axis=0)
        sizes = np.linalg.solve(covariance, around.T @ logs / len(around))
        to_departures /= np.sqrt((squares * np.exp(-2.0 * _bounded(around @ sizes))).mean(axis=0))
        weights = np.block([
            [to_departures, np.zeros_like(to_departures)],
            [-(expected @ to_departures) / unit[:, None], sizes / unit[:, None]],
        ])  # fmt: skip
        offsets = -np.concatenate([measured_mean, around_mean]) @ weights
        return cls(weights.astype(np.float32), offsets.astype(np.float32))

    def scores(self, values: FloatMap) -> FloatMap:
        """(k, ...) scores of (SPOT_VALUES, ...) values."""
        linear = self.weights.T @ values.reshape(SPOT_VALUES, -1) + self.offsets[:, None]
        departures, sizes = np.split(linear, 2)
        missing = departures[: len(_DECREASES)]
        np.maximum(missing, 0.0, out=missing)  # stronger texture is no departure
        scores = np.abs(departures) * np.exp(-_bounded(sizes))
        return np.asarray(scores.reshape(-1, *values.shape[1:]), np.float32)

    def with_limits(self, limits: Floats) -> "SpotModel":
        """The model whose scores are in units of these limits."""
        units = np.concatenate([1.0 / limits, np.ones(len(limits))]).astype(np.float32)
        return SpotModel(self.weights * units, self.offsets * units)

    def cell_scores(self, values: FloatMap) -> FloatMap:
        """(rows, columns) largest score of the spots at and beside each cell of a part."""
        highest = np.pad(self.scores(values).max(axis=0), _MARGIN)
        return np.asarray(cv2.dilate(highest, np.ones((3, 3), np.uint8)), np.float32)


def _bounded(logs: Array) -> Array:
    return np.clip(logs, -_MAX_LOG_SIZE, _MAX_LOG_SIZE)


def _to_departures(errors: Floats, expected_level: Floats) -> Floats:
    """(values, departures) matched filters (North 1943) of the errors of good spots."""
    covariance = errors.T @ errors / len(errors)
    covariance += np.diag(_RIDGE * np.diag(covariance) + 1e-9)
    count, last = len(_ENERGY_COLUMNS), _MEASURED_COUNT - len(_SLOPES)
    stain, dent = -expected_level, np.zeros(_MEASURED_COUNT)
    stain[count:last] += [value for _, value in _LEVELS]
    dent[last:] = [value for _, value in _SLOPES]
    # The filters of missing texture use energies alone: how it changes the level or the slopes is
    # unknown.
    energies = np.zeros((_MEASURED_COUNT, len(_DECREASES)))
    energies[:count] = np.linalg.solve(covariance[:count, :count], -_DECREASES.T)
    return np.column_stack([energies, np.linalg.solve(covariance, np.column_stack([stain, dent]))])


def subsampled(values: FloatMap, count: int) -> FloatMap:
    """Values (SPOT_VALUES, n) on a grid of about `count` spots of (SPOT_VALUES, h, w)."""
    step = max(2, round(np.sqrt(values[0].size / count)))
    return values[:, ::step, ::step].reshape(SPOT_VALUES, -1)


def left_out_models(values: Sequence[FloatMap], folds: int) -> list[SpotModel]:
    """For each fold the model of the other folds; part n is in fold n % folds."""
    return [
        SpotModel.of(np.hstack([part for n, part in enumerate(values) if n % folds != fold]))
        for fold in range(folds)
    ]
