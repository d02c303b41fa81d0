"""`GoodCells`: statistics of good cells, the distance from the nearest, and halves of parts."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from classify.surface.estimate import FloatMap

CENTRES = 200
"""Number of good cells in a model."""
# Cells from which the centres are chosen, evenly from all parts.
_MOST_CELLS = 20_000
# Ridge on the variances, so that directions in which a few parts agree by chance do not decide.
_RIDGE = 0.01
# A statistic that does not vary, as of an albedo without noise, must not decide.
_LEAST_VARIANCE = 1e-6
# Cells whose distances from all centres stay in the cache.
_BLOCK = 512

PowerSums = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GoodCells:
    """Mean (d,), whitening matrix (d, d), and whitened statistics of chosen cells (CENTRES, d).

    A part need not be alike everywhere: a joint and a brick have cells of their own.
    """

    mean: FloatMap
    whitening: FloatMap
    centres: FloatMap

    @classmethod
    def of(cls, parts: Sequence[FloatMap]) -> Self:
        """Choose from the statistics (n, d) of the cells of several parts.

        Each centre is the cell that is farthest from those chosen before it (Gonzalez 1985).
        """
        moments = np.sum([power_sums(part) for part in parts], axis=0)
        moments = moments / moments[0, 0]
        mean = moments[0, 1:]
        covariance = moments[1:, 1:] - np.outer(mean, mean)
        covariance += _RIDGE * np.diag(np.diag(covariance)) + _LEAST_VARIANCE * np.eye(len(mean))
        values, vectors = np.linalg.eigh(covariance)
        whitening = (vectors / np.sqrt(values)).astype(np.float32)
        cells = np.concatenate(parts)
        cells = cells[np.linspace(0, len(cells) - 1, min(len(cells), _MOST_CELLS)).astype(int)]
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
        # |c - x|^2 = (|c|^2, -2 c) (1, x) + |x|^2, whose last term is alike for all centres.
        squares = np.sum(self.centres**2, axis=1, keepdims=True)
        centres = np.concatenate([squares, -2.0 * self.centres], axis=1)
        extended = np.pad(cells, ((0, 0), (1, 0)), constant_values=1.0)
        blocks = np.split(extended, range(_BLOCK, len(cells), _BLOCK))
        nearest = np.concatenate([np.min(centres @ block.T, axis=0) for block in blocks])
        nearest += np.einsum("nd,nd->n", cells, cells)
        distances: FloatMap = np.maximum(nearest, 0.0).reshape(statistics.shape[:2])
        return distances


def power_sums(samples: FloatMap) -> PowerSums:
    """(d + 1, d + 1) sums of the products of (1, sample), of (n, d) samples."""
    extended = np.pad(samples.astype(np.float64), ((0, 0), (1, 0)), constant_values=1.0)
    return extended.T @ extended


def unlike_halves(sums: Sequence[PowerSums]) -> tuple[list[int], list[int]]:
    """Split two or more parts into halves that differ as much as possible, by their `power_sums`.

    Parts of one place or batch are alike. If each part were left out alone, the others of its place
    would stay, and it would depart less than a part of another place. The parts are therefore split
    along the first principal component of the means of their statistics.
    """
    total = np.sum(sums, axis=0)
    total = total / total[0, 0]
    deviations = np.sqrt(np.maximum(np.diag(total)[1:] - total[0, 1:] ** 2, 1e-12))
    means = np.array([part[0, 1:] / part[0, 0] for part in sums]) / deviations
    _, _, components = np.linalg.svd(means - means.mean(axis=0), full_matrices=False)
    lower, upper = np.array_split(np.argsort(means @ components[0], kind="stable"), 2)
    return lower.tolist(), upper.tolist()
