"""`Gaussian`: the distribution of the statistics of cells, and distances from it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from classify.surface.estimate import FloatMap

# Share of the variance of each statistic that is added to it, so that directions in which a few
# parts agree by chance do not decide.
_RIDGE = 0.01
# A statistic that does not vary, as of an albedo without noise, must not decide.
_LEAST_VARIANCE = 1e-6

PowerSums = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Gaussian:
    """Mean (d,) and whitening matrix (d, d) of statistics, float32.

    The Mahalanobis distance of statistics s is the length of (s - mean) @ whitening.
    """

    mean: FloatMap
    whitening: FloatMap

    @classmethod
    def of(cls, sums: Sequence[PowerSums]) -> Self:
        """The distribution of several parts, from their `power_sums`."""
        moments = np.sum(sums, axis=0)
        moments = moments / moments[0, 0]
        mean = moments[0, 1:]
        covariance = moments[1:, 1:] - np.outer(mean, mean)
        covariance += _RIDGE * np.diag(np.diag(covariance)) + _LEAST_VARIANCE * np.eye(len(mean))
        values, vectors = np.linalg.eigh(covariance)
        return cls(mean.astype(np.float32), (vectors / np.sqrt(values)).astype(np.float32))

    def squared_distances(self, statistics: FloatMap) -> FloatMap:
        """(h, w) squared distances of (h, w, d) statistics."""
        offset = (statistics - self.mean) @ self.whitening
        return np.asarray(np.einsum("hwd,hwd->hw", offset, offset), np.float32)


def power_sums(samples: FloatMap) -> PowerSums:
    """(d + 1, d + 1) sums of the products of (1, sample), of (n, d) samples."""
    extended = np.pad(samples.astype(np.float64), ((0, 0), (1, 0)), constant_values=1.0)
    return extended.T @ extended
