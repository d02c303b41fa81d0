"""`Departures`: how far the cells of a part are from good parts, in four ways."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from classify.surface.estimate import FloatMap
from classify.threads import map_in_threads

from .fields import PartFields
from .gaussian import Gaussian
from .observation import Observation
from .window_statistics import smoothed

DEPARTURES = 4
"""Number of departures of a cell: relief, albedo, octaves and windows."""


@dataclass(frozen=True, eq=False)
class Departures:
    """Spectra, limits of responses, and statistics of the good parts of one texture.

    Attributes
    ----------
    gains
        (2, n, n) float32 whitening gains of relief and albedo in the frame of the texture.
    relief_limits, albedo_limits
        (RELIEF_RESPONSES,) and (ALBEDO_RESPONSES,) float32 limits of spots and lines.
    octaves
        Statistics of the octaves; with their anisotropies in models of version 1.
    windows
        Statistics of the windows; None in models of version 1.
    """

    gains: FloatMap
    relief_limits: FloatMap
    albedo_limits: FloatMap
    octaves: Gaussian
    windows: Gaussian | None

    def of(self, fields: PartFields, orientation_deg: float) -> FloatMap:
        """(k, h, w) float32 departures in relief, albedo, octaves and, if k = 4, windows."""
        observation = Observation.of(fields, self.gains, orientation_deg)
        kinds: list[Callable[[], FloatMap]] = [
            lambda: _highest(observation.relief_responses(), self.relief_limits),
            lambda: _highest(observation.albedo_responses(), self.albedo_limits),
            lambda: self._octaves(observation),
        ]
        windows = self.windows
        if windows is not None:
            kinds.append(lambda: _windows(observation, windows))
        # Most arrays are too small to be shared out among threads themselves.
        return np.array(map_in_threads(lambda kind: kind(), kinds), np.float32)

    def _octaves(self, observation: Observation) -> FloatMap:
        statistics = observation.octave_statistics(anisotropy=self.windows is None)
        return np.sqrt(self.octaves.squared_distances(statistics))


def _windows(observation: Observation, windows: Gaussian) -> FloatMap:
    squares = windows.squared_distances(observation.window_statistics())
    return np.sqrt(smoothed(squares, observation.fields.valid))


def _highest(responses: Iterator[FloatMap], limits: FloatMap) -> FloatMap:
    """The highest response of every cell in units of its limit."""
    highest: FloatMap = next(responses) / limits[0]
    for response, limit in zip(responses, limits[1:], strict=True):
        np.divide(response, limit, out=response)
        np.maximum(highest, response, out=highest)
    return highest
