"""`Departures`: how far the cells of a part are from good parts, in seven ways."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from classify.base.compiling import Array, kernel
from classify.base.threads import map_in_threads
from classify.surface.estimate import FloatMap

from .cell_statistics import (
    LOW,
    OCTAVE_STATISTICS,
    WINDOW_STATISTICS,
    mean_around,
    octave_statistics,
    smoothed,
    window_statistics,
)
from .fields import PartFields
from .filters import ALBEDO, FILTERS, SIZES, Response, filter_responses
from .good_cells import GoodCells
from .whitening import white_spectra

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


STATISTICS = {
    "octaves": slice(0, OCTAVE_STATISTICS),
    "windows": slice(OCTAVE_STATISTICS, OCTAVE_STATISTICS + WINDOW_STATISTICS),
}
"""Columns of the statistics for each distance from the nearest good cell."""
LOW_STATISTICS = [OCTAVE_STATISTICS + index for index in LOW]
DEPARTURES = ALBEDO + 1 + len(STATISTICS) + 1
"""Spots, fine and wide scratches of the relief; albedo; the distances, and missing texture."""
RELIEF, TEXTURE = slice(0, ALBEDO), slice(ALBEDO + 1, DEPARTURES)
"""The departures of relief and of texture."""


@dataclass(frozen=True, eq=False)
class Departures:
    """Spectra, scales of responses, and statistics of the good parts of one texture."""

    gains: FloatMap  # (2, n, n), whitening relief and albedo in the frame of the texture
    scales: FloatMap  # (sum(SIZES),), mean highest responses in a tile of a good part
    cells: tuple[GoodCells, ...]  # for each of STATISTICS
    low: Evidence  # of the log deviations of slopes and albedo, with their signs changed

    def of(self, fields: PartFields, orientation_deg: float) -> FloatMap:
        """(DEPARTURES, h, w) float32 departures."""
        statistics, responses = observed(fields, self.gains, orientation_deg)
        departures = np.zeros((DEPARTURES, *fields.valid.shape), np.float32)

        def filters() -> FloatMap:
            weights = np.split(1.0 / self.scales, np.cumsum(SIZES)[:-1])
            for matched_filter, response, weight in zip(FILTERS, responses, weights, strict=True):
                out = departures[matched_filter.departure]
                np.maximum(out, response(weight)[: out.shape[0], : out.shape[1]], out=out)
            return departures

        # Most arrays are too small to be shared out among threads themselves.
        values, _ = map_in_threads(lambda work: work(), [statistics, filters])

        def distances(number: int) -> None:
            columns = list(STATISTICS.values())[number]
            squares = self.cells[number].squared_distances(values[..., columns])
            if number:  # octaves are means over several cells already
                squares = smoothed(squares, fields.valid)
            np.sqrt(squares, out=departures[ALBEDO + 1 + number])

        map_in_threads(distances, range(len(STATISTICS)))
        low = self.low.of(-np.moveaxis(values[..., LOW_STATISTICS], -1, 0))
        departures[-1] = mean_around(low.sum(axis=0), fields.valid)
        return departures


def observed(
    fields: PartFields, gains: FloatMap, orientation_deg: float
) -> tuple[Callable[[], FloatMap], Iterator[Response]]:
    """A part under given gains: statistics of its cells (h, w, d), and its `filter_responses`."""
    h, w = fields.valid.shape
    white, twice = white_spectra(fields, gains, orientation_deg)

    def statistics() -> FloatMap:
        octaves = octave_statistics(white, fields.weight)[:h, :w]
        windows = window_statistics(fields.moments, orientation_deg)
        return np.concatenate([octaves, windows], axis=-1)

    return statistics, filter_responses(twice, orientation_deg)
