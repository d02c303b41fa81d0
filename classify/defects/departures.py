"""`Departures`: how far the cells of a part are from good parts, in seven ways."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np

from classify.base.threads import map_in_threads
from classify.surface.estimate import FloatMap

from .evidence import Evidence
from .fields import PartFields
from .filters import SIZES, filter_responses
from .good_cells import GoodCells
from .octave_statistics import octave_statistics
from .whitening import white_spectra
from .window_statistics import LOW, mean_around, smoothed, window_statistics

DEPARTURES = 7
"""Spots, fine and wide scratches of the relief; albedo; octaves, windows, missing texture."""
RELIEF, ALBEDO, TEXTURE = slice(0, 3), 3, slice(4, 7)
"""Those of each kind of defect."""


@dataclass(frozen=True, eq=False)
class Departures:
    """Spectra, scales of responses, and statistics of the good parts of one texture.

    Attributes
    ----------
    gains
        (2, n, n) float32 whitening gains of relief and albedo in the frame of the texture.
    scales
        (sum(SIZES),) float32 mean highest response in a tile of a good part, for each filter.
    octaves, windows
        Statistics of good cells.
    low
        Distributions of the log deviations of slopes and albedo, with their signs changed.
    """

    gains: FloatMap
    scales: FloatMap
    octaves: GoodCells
    windows: GoodCells
    low: Evidence

    def of(self, fields: PartFields, orientation_deg: float) -> FloatMap:
        """(DEPARTURES, h, w) float32 departures."""
        white, responses = observed(fields, self.gains, orientation_deg)
        windows = window_statistics(fields.moments, orientation_deg)
        low = np.moveaxis(-windows[..., LOW], -1, 0)
        valid = fields.valid

        def filters() -> list[FloatMap]:
            scales = np.split(self.scales, np.cumsum(SIZES)[:-1])
            return [
                np.max(each / scale[:, None, None], axis=0)
                for each, scale in zip(responses, scales, strict=True)
            ]

        kinds: list[Callable[[], list[FloatMap]]] = [
            filters,
            lambda: [np.sqrt(self.octaves.squared_distances(white()))],
            lambda: [np.sqrt(smoothed(self.windows.squared_distances(windows), valid))],
            lambda: [mean_around(self.low.of(low).sum(axis=0), valid)],
        ]
        # Most arrays are too small to be shared out among threads themselves.
        return np.array(
            list(chain.from_iterable(map_in_threads(lambda kind: kind(), kinds))), np.float32
        )


def observed(
    fields: PartFields, gains: FloatMap, orientation_deg: float
) -> tuple[Callable[[], FloatMap], Iterator[FloatMap]]:
    """A part under given gains: its octave statistics (h, w, d), and its `filter_responses`."""
    h, w = fields.valid.shape
    white, twice = white_spectra(fields, gains, orientation_deg)
    responses = filter_responses(twice, orientation_deg)
    return (
        lambda: octave_statistics(white, fields.weight)[:h, :w],
        (each[:, :h, :w] for each in responses),
    )
