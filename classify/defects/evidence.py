"""`Evidence`: how improbable the departures of a cell are on good parts."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from classify.base.compiling import Array, kernel
from classify.surface.estimate import FloatMap

# Negative logarithms of the probabilities of the quantiles. 1.8 % of the cells are beyond the last:
# 56 cells of three parts of 256 px.
_STEP = 0.5
_LEVELS = np.arange(0.0, 4.5, _STEP)
QUANTILES = len(_LEVELS)
"""Number of quantiles of each departure."""
# Least mean excess of the tail; departures are of order 1.
_LEAST_EXCESS = 0.01


@dataclass(frozen=True, eq=False)
class Evidence:
    """Distributions of several departures in the cells of good parts."""

    quantiles: FloatMap  # (k, QUANTILES), exceeded with falling probabilities
    excess: FloatMap  # (k,), mean above the last one: beyond it the tail is exponential

    @classmethod
    def learn(cls, samples: FloatMap) -> Self:
        """The distributions of k departures, from their values (k, n) in good cells."""
        quantiles, excess = [], []
        for values in samples:
            steps = np.quantile(values, -np.expm1(-_LEVELS))
            beyond = values[values > steps[-1]] - steps[-1]
            excess.append(max(float(beyond.mean()) if len(beyond) else 0.0, _LEAST_EXCESS))
            # A departure that does not vary has no evidence at its value.
            quantiles.append(steps + 1e-6 * np.arange(QUANTILES))
        return cls(np.array(quantiles, np.float32), np.array(excess, np.float32))

    def of(self, departures: FloatMap) -> FloatMap:
        """Negative logarithms of the probabilities of (k, h, w) departures in a good cell."""
        logs = np.empty(departures.shape, np.float32)
        for values, steps, excess, out in zip(
            departures, self.quantiles, self.excess, logs, strict=True
        ):
            _interpolate(np.ascontiguousarray(values).ravel(), steps, excess, out.ravel())
        return logs


@kernel
def _interpolate(values: Array, steps: Array, excess: np.float32, logs: Array) -> None:
    """Piecewise linear between the quantiles, and beyond the last."""
    logs[:] = np.float32(0.0)
    zero, one = np.float32(0.0), np.float32(1.0)
    for index in range(len(steps) - 1):
        start, width = steps[index], steps[index + 1] - steps[index]
        for c in range(len(values)):
            share = (values[c] - start) / width
            logs[c] += np.float32(_STEP) * np.minimum(np.maximum(share, zero), one)
    last = steps[len(steps) - 1]
    for c in range(len(values)):
        logs[c] += np.maximum(values[c] - last, zero) / excess
