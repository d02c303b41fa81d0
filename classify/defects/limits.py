"""Limits from few good parts: the tail of the maxima of tiles, extrapolated."""

import math

import numpy as np
import numpy.typing as npt

from classify.base.arrays import Floats
from classify.base.errors import InputError
from classify.surface.estimate import FloatMap

from .defect_map import CELL_PX

# Cells on a side of a tile. Maxima of tiles are hardly correlated, scores of cells are.
_TILE = 64 // CELL_PX
# Share of the tile maxima, or at least this many, to which the tail is fitted.
_TAIL_SHARE, _LEAST_TAIL = 0.2, 10
# Two tile maxima: one at which the tail begins, and one in the tail.
_LEAST_TILES = 2
# Longest tail: evidence has an exponential one (shape 0) unless parts differ.
_LONGEST_TAIL = 0.2
# Responses are of order 1; that to an albedo which is exactly constant on all good parts is 0.
_LEAST_LIMIT = 1e-3

# Quantile of the normal distribution at 95 %. With one standard error 5 of 96 good parts had an
# alarm in `tests/evidence/test_defects.py`, where 1 % is asked.
_CONFIDENCE_BOUND = 1.645
# Prior of the standard deviation of the parts' log maxima, and the number of parts that it counts
# as. The deviation was 0.2 to 0.3 on most textures of `python -m tests.evidence.defects`.
_PRIOR_SPREAD, _PRIOR_FREEDOM = 0.25, 4


def tile_maxima(response: FloatMap, valid: npt.NDArray[np.bool_]) -> Floats:
    """Largest valid response of every tile, -inf where no cell of a tile is valid."""
    rows, columns = valid.shape
    whole = np.full((-(-rows // _TILE) * _TILE, -(-columns // _TILE) * _TILE), -np.inf)
    whole[:rows, :columns] = np.where(valid, response[:rows, :columns], -np.inf)
    tiles = whole.reshape(whole.shape[0] // _TILE, _TILE, -1, _TILE)
    return np.asarray(tiles.max(axis=(1, 3)).ravel())


def limits_of(maxima: Floats, false_alarm_rate: float) -> Floats:
    """(m,) values that a share of good parts exceeds anywhere, from (parts, m, tiles) maxima.

    A generalised Pareto distribution, fitted by probability-weighted moments (Hosking and Wallis
    1987) to the highest tile maxima of all parts, is extrapolated to the tiles of one part.
    """
    parts, count, _ = maxima.shape
    ordered = np.sort(np.moveaxis(maxima, 1, 0).reshape(count, -1))
    ordered = ordered[:, np.isfinite(ordered).all(axis=0)]
    tiles = ordered.shape[1]
    if tiles < _LEAST_TILES:
        raise InputError(
            f"{tiles} areas of {_TILE * CELL_PX} x {_TILE * CELL_PX} px of all good parts have "
            "valid pixels; give good parts that are lit evenly and not saturated"
        )
    tail = min(max(int(_TAIL_SHARE * tiles), _LEAST_TAIL), tiles - 1)
    start = ordered[:, -tail - 1]
    excess = ordered[:, -tail:] - start[:, None]
    mean = excess.mean(axis=1)
    # Mean of the excess weighted by its probability of being exceeded.
    weighted = np.mean(excess * (1.0 - (np.arange(tail) + 0.65) / tail), axis=1)
    shapes = 2.0 - mean / np.maximum(mean - 2.0 * weighted, 1e-9 * mean + 1e-300)
    # A scale estimated from k exponential values makes the next one Pareto, of shape 1 / k. Half of
    # it, as the same step is taken again for the common limit.
    shapes = np.clip(shapes, 0.0, _LONGEST_TAIL) + 0.5 / tail
    per_tile = -np.expm1(np.log1p(-false_alarm_rate) * parts / tiles)
    ratio = max(tail / tiles / per_tile, 1.0)
    reach = np.expm1(shapes * np.log(ratio)) / shapes
    return np.asarray(np.maximum(start + mean * (1.0 - shapes) * reach, _LEAST_LIMIT))


def common_limit(maxima: Floats, false_alarm_rate: float) -> float:
    """The limit of one score, from the (parts, tiles) maxima of left-out good parts.

    Tiles of one part are alike: N parts tell the level of the limit no better than to a standard
    error of s / sqrt(N), where s is the standard deviation of the logarithms of the parts' highest
    scores. The limit is the upper 95 % confidence bound of the extrapolated one. No limit of fewer
    parts than 1 / rate is below the highest score of a good part.
    """
    limit = float(limits_of(maxima[:, None], false_alarm_rate)[0])
    highest = maxima.max(axis=1)
    if len(maxima) * false_alarm_rate < 1.0:
        limit = max(limit, float(highest.max()))
    freedom = len(maxima) - 1
    measured = float(np.log(np.maximum(highest, _LEAST_LIMIT)).var(ddof=1))
    variance = (_PRIOR_FREEDOM * _PRIOR_SPREAD**2 + freedom * measured) / (_PRIOR_FREEDOM + freedom)
    return limit * math.exp(_CONFIDENCE_BOUND * math.sqrt(variance / len(maxima)))
