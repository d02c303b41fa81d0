"""`DepartureModel`: how far a cell is from good parts, by seven measures, the departures.

They are four responses of matched filters, two distances of local statistics of slopes and log
albedo (by octaves, and by windows around the cell), and missing texture.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Self

import cv2
import numpy as np
import numpy.typing as npt
import scipy.fft

from classify.base.compiling import Array, kernel
from classify.base.threads import map_in_threads, run_on_rows
from classify.surface.estimate import FloatMap

from .fields import COARSEST, HALF_CELL, PartFields, gaussian_mean, resized
from .filters import ALBEDO, FILTERS, SIZES, Response, filter_responses
from .whitening import HalfSpectrum, white_spectra

_OCTAVES = 4
"""Octaves of the local statistics."""
_OCTAVE_STATISTICS = 2 * _OCTAVES
"""Number of octave statistics of a cell: for relief, then for albedo."""
assert 2**_OCTAVES == COARSEST

# Cells over which local statistics are averaged: standard deviation of the Gaussian.
_STATISTICS_CELLS = 1.5
# Energies of a white field of variance 1 are of order 1; this floor keeps logarithms finite.
_ENERGY_FLOOR = np.float32(1e-3)


def _octave_statistics(white: tuple[HalfSpectrum, HalfSpectrum], weight: FloatMap) -> FloatMap:
    """(h, w, _OCTAVE_STATISTICS) log energies of the gradient of white fields in each octave."""
    rows, columns = (side // HALF_CELL for side in weight.shape)
    weights = gaussian_mean(resized(weight * weight, rows, columns), _STATISTICS_CELLS)
    weights += np.float32(1e-3)

    def statistics(spectrum: HalfSpectrum) -> list[FloatMap]:
        level = np.asarray(scipy.fft.irfft2(spectrum, s=weight.shape), np.float32)
        values = []
        for number in range(_OCTAVES):
            energy = resized(_gradient_energies(level, HALF_CELL >> number or 1), rows, columns)
            energy = gaussian_mean(energy, _STATISTICS_CELLS) / weights
            values.append(np.log(energy + 2 * _ENERGY_FLOOR))
            # Not pyrDown, whose pixels lie half a fine pixel from the middle of the cell.
            blurred = np.asarray(cv2.GaussianBlur(level, (3, 3), 0), np.float32)
            level = resized(blurred, level.shape[0] // 2, level.shape[1] // 2)
        return values

    relief, albedo = map_in_threads(statistics, white)
    return np.stack(relief + albedo, axis=-1)


def _gradient_energies(level: FloatMap, pixels: int) -> FloatMap:
    """(h, w) means of the squared gradient in blocks of `pixels` x `pixels`."""
    rows, columns = (side // pixels for side in level.shape)
    energies = np.empty((rows, columns), np.float32)
    run_on_rows(partial(_sum_energies, level, pixels, energies), (rows, level[:pixels].size))
    return energies


@kernel
def _sum_energies(level: Array, pixels: int, energies: Array, first: int, stop: int) -> None:
    """Write the means of rows of blocks, from Sobel gradients, which are 0 at the border."""
    rows, columns = level.shape
    sums = np.empty(columns, np.float32)
    quarter, two = np.float32(0.25), np.float32(2.0)
    share = np.float32(1.0) / np.float32(pixels * pixels)
    for row in range(first, stop):
        sums[:] = np.float32(0.0)
        for r in range(max(row * pixels, 1), min((row + 1) * pixels, rows - 1)):
            above, here, below = level[r - 1], level[r], level[r + 1]
            for c in range(1, columns - 1):
                falling = above[c + 1] - below[c - 1]
                rising = above[c - 1] - below[c + 1]
                x = quarter * (falling - rising + two * (here[c + 1] - here[c - 1]))
                y = quarter * (falling + rising + two * (above[c] - below[c]))
                sums[c] += x * x + y * y
        for column in range(energies.shape[1]):
            total = np.float32(0.0)
            for c in range(column * pixels, (column + 1) * pixels):
                total += sums[c]
            energies[row, column] = share * total


# Sides of the windows in cells.
_WINDOWS = (1, 3)
_WINDOW_STATISTICS = 5 * len(_WINDOWS)
"""Number of window statistics of a cell."""
DEVIATIONS = [0, 3]
"""Statistics that are low where texture is missing: log standard deviations, smallest window."""

# Cells over which squared distances are averaged: standard deviation of the Gaussian.
_SMOOTHING_CELLS = 1.0
# Least variance of slopes and of log albedo; rounding to 8 bit has a variance of 1e-6.
_ROUNDING_VARIANCE = np.float32(1e-6)
_MIN_SHARE = np.float32(1e-3)


def window_statistics(moments: FloatMap, orientation_deg: float) -> FloatMap:
    """(h, w, _WINDOW_STATISTICS) statistics of the windows around every cell.

    Five for each window: the log standard deviation of slopes, their anisotropy (cosine and sine of
    twice the direction), the log standard deviation and the mean of the log albedo.
    """
    angle = np.radians(2.0 * orientation_deg)
    c, s = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    half = np.float32(0.5)
    values: list[Array] = []
    for side in _WINDOWS:
        sums: Array = cv2.blur(moments, (side, side), borderType=cv2.BORDER_CONSTANT)
        means: Array = np.moveaxis(sums / np.maximum(sums[..., :1], _MIN_SHARE), -1, 0)
        _, p, q, a, pp, qq, pq, aa = means
        xx, yy, xy = pp - p * p, qq - q * q, pq - p * q
        total = np.maximum(xx + yy, _ROUNDING_VARIANCE)
        cosine, sine = (xx - yy) / total, (xy + xy) / total
        values += [
            half * np.log(total), c * cosine + s * sine, c * sine - s * cosine,
            half * np.log(np.maximum(aa - a * a, _ROUNDING_VARIANCE)), a,
        ]  # fmt: skip
    return np.stack(values, axis=-1)


def smoothed(squares: FloatMap, valid: npt.NDArray[np.bool_]) -> FloatMap:
    """Gaussian mean of the squared distances of the valid cells around every cell."""
    share = valid.astype(np.float32)
    around = np.maximum(gaussian_mean(share, _SMOOTHING_CELLS), _MIN_SHARE)
    mean: Array = gaussian_mean(squares * share, _SMOOTHING_CELLS) / around
    return mean


def _mean_around(values: FloatMap, valid: npt.NDArray[np.bool_]) -> FloatMap:
    """Mean over 3 x 3 cells, of the valid ones."""
    share = valid.astype(np.float32)
    sums: Array = cv2.blur(values * share, (3, 3), borderType=cv2.BORDER_CONSTANT)
    around: Array = cv2.blur(share, (3, 3), borderType=cv2.BORDER_CONSTANT)
    return np.asarray(sums / np.maximum(around, _MIN_SHARE), np.float32)


CENTRES = 200
"""Number of good cells in a model."""
# Cells from which the centres are chosen, evenly from all parts.
_MAX_CELLS = 20_000
# Ridge on the variances, so that directions in which a few parts agree by chance do not dominate
# the distances.
_RIDGE = 0.01
# Added to every variance, so that a statistic that is constant on all good parts does not dominate
# the distances.
_MIN_VARIANCE = 1e-6
# Cells per block of a matrix product; the distances of a block from all centres fit in the cache.
_BLOCK = 512

MomentSums = npt.NDArray[np.float64]
"""(d + 1, d + 1) sums of the products of (1, sample), of d statistics."""


@dataclass(frozen=True, eq=False)
class GoodCells:
    """Good cells in whitened statistics; centres stand for kinds of cells, such as joints."""

    mean: FloatMap  # (d,)
    whitening: FloatMap  # (d, d) matrix
    centres: FloatMap  # (CENTRES, d) whitened statistics

    @classmethod
    def of(cls, parts: Sequence[FloatMap]) -> Self:
        """Choose the centres by farthest-first traversal (Gonzalez 1985).

        The statistics are (n, d) values of the cells of every part.
        """
        moments = np.sum([moment_sums(part) for part in parts], axis=0)
        moments = moments / moments[0, 0]
        mean = moments[0, 1:]
        covariance = moments[1:, 1:] - np.outer(mean, mean)
        covariance += _RIDGE * np.diag(np.diag(covariance)) + _MIN_VARIANCE * np.eye(len(mean))
        values, vectors = np.linalg.eigh(covariance)
        whitening = (vectors / np.sqrt(values)).astype(np.float32)
        cells = np.concatenate(parts)
        cells = cells[np.linspace(0, len(cells) - 1, min(len(cells), _MAX_CELLS)).astype(int)]
        cells = (cells - mean.astype(np.float32)) @ whitening
        centres = np.empty((CENTRES, len(mean)), np.float32)
        nearest = np.full(len(cells), np.inf, np.float32)
        chosen = np.argmin(np.sum(cells**2, axis=1))
        for index in range(CENTRES):
            centres[index] = cells[chosen]
            np.minimum(nearest, np.sum((cells - centres[index]) ** 2, axis=1), out=nearest)
            chosen = np.argmax(nearest)
        return cls(mean.astype(np.float32), whitening, centres)

    def squared_distances(self, statistics: FloatMap) -> FloatMap:
        """(h, w) squared distances of (h, w, d) statistics from the nearest centre."""
        cells = (statistics.reshape(-1, statistics.shape[-1]) - self.mean) @ self.whitening
        # |c - x|^2 = (|c|^2, -2 c) (1, x) + |x|^2, whose last term is the same for all centres.
        squares = np.sum(self.centres**2, axis=1, keepdims=True)
        centres = np.concatenate([squares, -2.0 * self.centres], axis=1)
        extended = np.pad(cells, ((0, 0), (1, 0)), constant_values=1.0)
        blocks = np.split(extended, range(_BLOCK, len(cells), _BLOCK))
        nearest = np.concatenate([np.min(centres @ block.T, axis=0) for block in blocks])
        nearest += np.einsum("nd,nd->n", cells, cells)
        distances: FloatMap = np.maximum(nearest, 0.0).reshape(statistics.shape[:2])
        return distances


def moment_sums(samples: FloatMap) -> MomentSums:
    """Count, sums and sums of products of (n, d) samples, in one matrix."""
    extended = np.pad(samples.astype(np.float64), ((0, 0), (1, 0)), constant_values=1.0)
    return extended.T @ extended


def unlike_halves(sums: Sequence[MomentSums]) -> tuple[list[int], list[int]]:
    """Split two or more parts at the median of the first principal component of their means."""
    # Leave-one-out would be too optimistic: parts of one batch are similar.
    total = np.sum(sums, axis=0)
    total = total / total[0, 0]
    standard_deviations = np.sqrt(np.maximum(np.diag(total)[1:] - total[0, 1:] ** 2, 1e-12))
    means = np.array([part[0, 1:] / part[0, 0] for part in sums]) / standard_deviations
    _, _, components = np.linalg.svd(means - means.mean(axis=0), full_matrices=False)
    lower, upper = np.array_split(np.argsort(means @ components[0], kind="stable"), 2)
    return lower.tolist(), upper.tolist()


# Negative logarithms of the probabilities that a good cell exceeds the quantiles. 1.8 % of the
# cells exceed the last quantile: at least 56 cells, with three parts of 256 px.
_STEP = 0.5
_LEVELS = np.arange(0.0, 4.5, _STEP)
QUANTILES = len(_LEVELS)
"""Number of quantiles of each departure."""
# Least mean excess of the tail; departures are of order 1.
_MIN_EXCESS = 0.01


@dataclass(frozen=True, eq=False)
class EvidenceModel:
    """Distributions of several departures in the cells of good parts, with exponential tails."""

    quantiles: FloatMap  # (k, QUANTILES), exceeded with the probabilities exp(-_LEVELS)
    excess: FloatMap  # (k,), mean excess over the last quantile: the scale of the tail

    @classmethod
    def learn(cls, samples: FloatMap) -> Self:
        """Estimate the distributions of k departures from their values (k, n) in good cells."""
        all_quantiles, excess = [], []
        for values in samples:
            quantiles = np.quantile(values, -np.expm1(-_LEVELS))
            beyond = values[values > quantiles[-1]] - quantiles[-1]
            excess.append(max(float(beyond.mean()) if len(beyond) else 0.0, _MIN_EXCESS))
            # Quantiles must differ to be interpolated, also those of a constant departure.
            all_quantiles.append(quantiles + 1e-6 * np.arange(QUANTILES))
        return cls(np.array(all_quantiles, np.float32), np.array(excess, np.float32))

    def of(self, departures: FloatMap) -> FloatMap:
        """Negative logarithms of the probabilities of larger departures than (k, h, w) values."""
        logs = np.empty(departures.shape, np.float32)
        for values, quantiles, excess, out in zip(
            departures, self.quantiles, self.excess, logs, strict=True
        ):
            _interpolate(np.ascontiguousarray(values).ravel(), quantiles, excess, out.ravel())
        return logs


@kernel
def _interpolate(values: Array, quantiles: Array, excess: np.float32, logs: Array) -> None:
    """Interpolate linearly between the quantiles; beyond the last the slope is 1 / excess."""
    logs[:] = np.float32(0.0)
    zero, one = np.float32(0.0), np.float32(1.0)
    for index in range(len(quantiles) - 1):
        start, width = quantiles[index], quantiles[index + 1] - quantiles[index]
        for c in range(len(values)):
            share = (values[c] - start) / width
            logs[c] += np.float32(_STEP) * np.minimum(np.maximum(share, zero), one)
    last = quantiles[len(quantiles) - 1]
    for c in range(len(values)):
        logs[c] += np.maximum(values[c] - last, zero) / excess


STATISTICS = {
    "octaves": slice(0, _OCTAVE_STATISTICS),
    "windows": slice(_OCTAVE_STATISTICS, _OCTAVE_STATISTICS + _WINDOW_STATISTICS),
}
"""Columns of the statistics for each distance from the nearest good cell."""
DEVIATION_STATISTICS = [_OCTAVE_STATISTICS + index for index in DEVIATIONS]
"""Columns of `DEVIATIONS` in the statistics."""
DEPARTURES = ALBEDO + 1 + len(STATISTICS) + 1
"""Number of departures: spots, fine and wide scratches; albedo; distances; missing texture."""
RELIEF, TEXTURE = slice(0, ALBEDO), slice(ALBEDO + 1, DEPARTURES)
"""The departures of relief and of texture."""


@dataclass(frozen=True, eq=False)
class DepartureModel:
    """Spectra, scales of responses, and statistics of the good parts of one texture."""

    gains: FloatMap  # (3, n // 2 + 1, n + 1), as of `Spectrum.gains`, in the frame of the texture
    scales: FloatMap  # (sum(SIZES),), root mean squares of the tile maxima of good parts
    cells: tuple[GoodCells, ...]  # for each of STATISTICS
    missing_texture: EvidenceModel  # of the negated log standard deviations of slopes and albedo

    def of(self, fields: PartFields, orientation_deg: float) -> FloatMap:
        """(DEPARTURES, h, w) float32 departures."""
        statistics, responses = statistics_and_responses(fields, self.gains, orientation_deg)
        departures = np.zeros((DEPARTURES, *fields.valid.shape), np.float32)

        def add_responses() -> FloatMap:
            weights = np.split(1.0 / self.scales, np.cumsum(SIZES)[:-1])
            for matched_filter, response, weight in zip(FILTERS, responses, weights, strict=True):
                out = departures[matched_filter.departure]
                np.maximum(out, response(weight)[: out.shape[0], : out.shape[1]], out=out)
            return departures

        # Most arrays are too small to be split among threads, so whole tasks run in parallel.
        values, _ = map_in_threads(lambda task: task(), [statistics, add_responses])

        def add_distances(number: int) -> None:
            name, columns = list(STATISTICS.items())[number]
            squares = self.cells[number].squared_distances(values[..., columns])
            if name == "windows":  # octaves are means over several cells already
                squares = smoothed(squares, fields.valid)
            np.sqrt(squares, out=departures[ALBEDO + 1 + number])

        map_in_threads(add_distances, range(len(STATISTICS)))
        evidence = self.missing_texture.of(-np.moveaxis(values[..., DEVIATION_STATISTICS], -1, 0))
        departures[-1] = _mean_around(evidence.sum(axis=0), fields.valid)
        return departures


def statistics_and_responses(
    fields: PartFields, gains: FloatMap, orientation_deg: float
) -> tuple[Callable[[], FloatMap], Iterator[Response]]:
    """Whiten a part; return a function for the (h, w, d) statistics, and `filter_responses`."""
    h, w = fields.valid.shape
    white, twice_whitened = white_spectra(fields, gains, orientation_deg)

    def statistics() -> FloatMap:
        octaves = _octave_statistics(white, fields.weight)[:h, :w]
        windows = window_statistics(fields.moments, orientation_deg)
        return np.concatenate([octaves, windows], axis=-1)

    return statistics, filter_responses(twice_whitened, orientation_deg)
