"""Limits from few good parts: the tail of the maxima of tiles, extrapolated."""

import numpy as np
import numpy.typing as npt

from classify.surface.estimate import FloatMap

from .defect_map import CELL_PX

# Cells on a side of a tile: maxima of tiles are hardly correlated, those of cells are.
_TILE = 64 // CELL_PX
# Share of the tile maxima, or at least this many, to which the tail is fitted.
_TAIL_SHARE, _LEAST_TAIL = 0.2, 10
# Bounds of the tail's shape: never shorter than exponential, and of finite variance.
_LONGEST_TAIL = 0.4

Maxima = npt.NDArray[np.float64]


def tile_maxima(response: FloatMap, valid: npt.NDArray[np.bool_]) -> Maxima:
    """Largest valid response of every tile, -inf where no cell of a tile is valid."""
    rows, columns = valid.shape
    whole = np.full((-(-rows // _TILE) * _TILE, -(-columns // _TILE) * _TILE), -np.inf)
    whole[:rows, :columns] = np.where(valid, response[:rows, :columns], -np.inf)
    tiles = whole.reshape(whole.shape[0] // _TILE, _TILE, -1, _TILE)
    return np.asarray(tiles.max(axis=(1, 3)).ravel())


def limit_of(maxima: Maxima, tiles_per_part: float, false_alarm_rate: float) -> float:
    """Value that a share `false_alarm_rate` of good parts exceeds anywhere.

    A generalised Pareto distribution, fitted by probability-weighted moments (Hosking and Wallis
    1987) to the highest tile maxima of all parts, is extrapolated to the tiles of one part.
    """
    ordered = np.sort(maxima[np.isfinite(maxima)])
    tail = min(max(int(_TAIL_SHARE * ordered.size), _LEAST_TAIL), ordered.size - 1)
    start = ordered[-tail - 1]
    excess = ordered[-tail:] - start
    first = excess.mean()
    # Mean of the excess weighted by its probability of being exceeded.
    second = np.mean(excess * (1.0 - (np.arange(tail) + 0.65) / tail))
    denominator = first - 2.0 * second
    shape = 2.0 - first / denominator if denominator > 0.0 else _LONGEST_TAIL
    shape = float(np.clip(shape, 0.0, _LONGEST_TAIL))
    scale = first * (1.0 - shape)
    per_tile = -np.expm1(np.log1p(-false_alarm_rate) / tiles_per_part)
    ratio = max(tail / ordered.size / per_tile, 1.0)
    reach = np.log(ratio) if shape < 1e-6 else np.expm1(shape * np.log(ratio)) / shape
    return float(start + scale * reach)
