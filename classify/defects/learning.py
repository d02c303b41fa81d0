"""Learn a `DefectModel` from good parts; limits follow from scores by the other half of parts."""

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
import numpy.typing as npt
from scipy.special import ndtri

from classify.base.arrays import Floats
from classify.base.errors import InputError
from classify.surface.estimate import FloatMap, SurfaceEstimate

from .defect_map import CELL_PX
from .defect_model import CHANNEL_SHARES, DefectModel, channels_of
from .departures import (
    DEVIATION_STATISTICS,
    STATISTICS,
    DepartureModel,
    EvidenceModel,
    GoodCells,
    moment_sums,
    statistics_and_responses,
    unlike_halves,
    window_statistics,
)
from .fields import PartFields, gaussian_mean, part_fields
from .filters import SIZES
from .whitening import MIN_SIDE_PX, Spectrum, mean_spectrum

# Cells on a side of a tile. Scores of neighbouring cells are correlated, maxima of tiles hardly.
_TILE = 64 // CELL_PX
# Share of the tile maxima to which the tail is fitted, and least number of them.
_TAIL_SHARE, _MIN_TAIL = 0.2, 10
# The fit of a tail needs a tile maximum at which the tail begins, and one in the tail.
_MIN_TILES = 2
# Largest shape of the Pareto tail; evidence has an exponential tail (shape 0) unless parts differ.
_MAX_TAIL = 0.2
# Least limit of an evidence: a departure that is constant on all good parts has none.
_MIN_LIMIT = 1e-3

# Quantile of the normal distribution at 95 %. With a bound of one standard error, 5 of 96 good
# parts had an alarm in `tests/evidence/test_defects.py`, at a false alarm rate of 1 %.
_CONFIDENCE_BOUND = 1.645
# Prior of the standard deviation of the parts' log maxima, and the number of parts that it counts
# as. It was 0.2 to 0.3 on most textures of `python -m tests.evidence.defects`.
_PRIOR_SPREAD, _PRIOR_FREEDOM = 0.25, 4


def tile_maxima(response: FloatMap, valid: npt.NDArray[np.bool_]) -> Floats:
    """Largest valid response of every tile, -inf where no cell of a tile is valid."""
    rows, columns = valid.shape
    padded = np.full((-(-rows // _TILE) * _TILE, -(-columns // _TILE) * _TILE), -np.inf)
    padded[:rows, :columns] = np.where(valid, response[:rows, :columns], -np.inf)
    tiles = padded.reshape(padded.shape[0] // _TILE, _TILE, -1, _TILE)
    return np.asarray(tiles.max(axis=(1, 3)).ravel())


def limits_of(maxima: Floats, false_alarm_rate: float) -> Floats:
    """Limits (m,) that a share `false_alarm_rate` of good parts exceeds.

    They are from the (parts, m, tiles) maxima, by a generalised Pareto tail that is fitted with
    probability-weighted moments (Hosking and Wallis 1987).
    """
    parts, count, _ = maxima.shape
    ordered = np.sort(np.moveaxis(maxima, 1, 0).reshape(count, -1))
    ordered = ordered[:, np.isfinite(ordered).all(axis=0)]
    tiles = ordered.shape[1]
    if tiles < _MIN_TILES:
        raise InputError(
            f"{tiles} areas of {_TILE * CELL_PX} x {_TILE * CELL_PX} px of all good parts have "
            "valid pixels; give good parts that are lit evenly and not saturated"
        )
    tail = min(max(int(_TAIL_SHARE * tiles), _MIN_TAIL), tiles - 1)
    start = ordered[:, -tail - 1]
    excess = ordered[:, -tail:] - start[:, None]
    mean = excess.mean(axis=1)
    # Mean of the excess weighted by its probability of being exceeded, with plotting positions
    # (i - 0.35) / k.
    weighted = np.mean(excess * (1.0 - (np.arange(tail) + 0.65) / tail), axis=1)
    shapes = 2.0 - mean / np.maximum(mean - 2.0 * weighted, 1e-9 * mean + 1e-300)
    # The predictive distribution, given a scale estimated from k exponential values, is Pareto with
    # a shape of 1 / k. Half of that is added, as `common_limit` adds a margin for the same error.
    shapes = np.clip(shapes, 0.0, _MAX_TAIL) + 0.5 / tail
    per_tile = -np.expm1(np.log1p(-false_alarm_rate) * parts / tiles)
    ratio = max(tail / tiles / per_tile, 1.0)
    reach = np.expm1(shapes * np.log(ratio)) / shapes
    return np.asarray(np.maximum(start + mean * (1.0 - shapes) * reach, _MIN_LIMIT))


def common_limit(maxima: Floats, false_alarm_rate: float) -> float:
    """The limit of one channel, from the (parts, tiles) maxima of left-out good parts."""
    # Tiles of one part are correlated, so that the logarithm of a limit of N parts has a standard
    # error of s / sqrt(N), where s is the standard deviation of the logarithms of the parts'
    # highest scores. The limit is the upper 95 % confidence bound of the extrapolated one. With
    # fewer parts than 1 / rate, it is not below the highest score of a good part.
    limit = float(limits_of(maxima[:, None], false_alarm_rate)[0])
    highest = maxima.max(axis=1)
    if len(maxima) * false_alarm_rate < 1.0:
        limit = max(limit, float(highest.max()))
    degrees_of_freedom = len(maxima) - 1
    measured = float(np.log(np.maximum(highest, _MIN_LIMIT)).var(ddof=1))
    variance = (_PRIOR_FREEDOM * _PRIOR_SPREAD**2 + degrees_of_freedom * measured) / (
        _PRIOR_FREEDOM + degrees_of_freedom
    )
    return limit * math.exp(_CONFIDENCE_BOUND * math.sqrt(variance / len(maxima)))


MIN_PARTS = 3
MAX_PARTS = 100
# Responses are divided by their scales, which are 0 for an albedo that is exactly constant on all
# good parts.
_MIN_SCALE = 1e-6

_Item = TypeVar("_Item")


def learn_defects(
    surfaces: Iterable[SurfaceEstimate],
    orientations_deg: Sequence[float | None],
    false_alarm_rate: float = 0.01,
) -> DefectModel:
    """Learn what good parts of one texture look like.

    The parts are split into two unlike halves (`unlike_halves`), and each part is scored by a model
    of the other half. The limits follow from these scores, so that a share
    `false_alarm_rate` of good parts exceeds 1.0 anywhere. Fewer parts than 1 / rate cannot show
    that: the tail of their scores is extrapolated, the limit is not below the highest score of a
    good part, and `DefectModel.false_alarm_bound` states what the parts show.

    Parameters
    ----------
    surfaces
        N >= 3 good parts of one frame size, of at least 256 px.
    orientations_deg
        N orientations of the texture, as of `Match.orientation_deg`; None counts as 0.
    false_alarm_rate
        Share of good parts, above 0 and below 0.5.

    Raises
    ------
    InputError
        For too few parts, small or differing frames, or a rate out of range.
    """
    if not 0.0 < false_alarm_rate < 0.5:
        raise InputError(
            f"a false alarm rate of {false_alarm_rate}; give a share above 0 and below 0.5"
        )
    parts = [part_fields(_checked(surface)) for surface in surfaces]
    angles = [0.0 if angle is None else float(angle) for angle in orientations_deg]
    _require_alike(parts, angles)
    observations = _observations(parts, angles)
    departures: dict[int, FloatMap] = {}
    windows = STATISTICS["windows"]
    for half in unlike_halves([moment_sums(part.statistics[:, windows]) for part in observations]):
        model_of_others = _departure_model(_without(observations, half))
        departures |= {index: model_of_others.of(parts[index], angles[index]) for index in half}
    inside = np.concatenate([part[:, parts[n].valid] for n, part in departures.items()], axis=1)
    evidence = EvidenceModel.learn(inside)
    maxima = np.array([
        [
            tile_maxima(channel, part.valid)
            for channel in channels_of(evidence.of(departures[index]))
        ]
        for index, part in enumerate(parts)
    ])  # fmt: skip
    limits = np.array([
        common_limit(maxima[:, channel], false_alarm_rate * share)
        for channel, share in enumerate(CHANNEL_SHARES)
    ], np.float32)  # fmt: skip
    scores = np.max(maxima.max(axis=2) / limits, axis=1)
    return DefectModel(_departure_model(observations), evidence, limits, false_alarm_rate, scores)


def _require_alike(parts: Sequence[PartFields], angles: Sequence[float]) -> None:
    if not MIN_PARTS <= len(parts) <= MAX_PARTS:
        raise InputError(f"{len(parts)} good parts; give {MIN_PARTS} to {MAX_PARTS}")
    if len(angles) != len(parts) or not all(map(math.isfinite, angles)):
        raise InputError(
            f"{len(angles)} orientations for {len(parts)} parts; give one finite angle for each"
        )
    if len({part.shape for part in parts}) > 1:
        raise InputError("the good parts differ in the size of their frames; capture them alike")


def _checked(surface: SurfaceEstimate) -> SurfaceEstimate:
    rows, columns = surface.shape
    if min(rows, columns) < MIN_SIDE_PX:
        raise InputError(
            f"a part of {columns} x {rows} px; its sides must be {MIN_SIDE_PX} px or more"
        )
    return surface


@dataclass(frozen=True, eq=False)
class _Observation:
    """Measurements on one good part."""

    spectrum: Spectrum
    # Both are of the part whitened by the spectrum of the other half of the parts.
    mean_squares: Floats  # (sum(SIZES),) of the tile maxima of the responses
    statistics: FloatMap  # (n, d) of the valid cells


def _observations(parts: Sequence[PartFields], angles: Sequence[float]) -> list[_Observation]:
    spectra = [Spectrum.of(part, angle) for part, angle in zip(parts, angles, strict=True)]
    windows = [
        window_statistics(part.moments, angle)[part.valid]
        for part, angle in zip(parts, angles, strict=True)
    ]
    observations = {}
    for half in unlike_halves([moment_sums(part) for part in windows]):
        gains = mean_spectrum(_without(spectra, half)).gains()
        for index in half:
            valid = parts[index].valid
            statistics, responses = statistics_and_responses(parts[index], gains, angles[index])
            maxima = np.array([
                tile_maxima(response(weights), valid)
                for response, size in zip(responses, SIZES, strict=True)
                for weights in np.eye(size, dtype=np.float32)
            ])  # fmt: skip
            squares = np.square(maxima[:, np.isfinite(maxima[0])])
            observations[index] = _Observation(
                spectra[index], squares.mean(axis=1), statistics()[valid]
            )
    return [observations[index] for index in range(len(parts))]


def _departure_model(observations: Sequence[_Observation]) -> DepartureModel:
    statistics = [part.statistics for part in observations]
    # Root mean squares of tile maxima weight the responses of one departure against each other.
    # Scaled by means, the responses with heavy tails would hide the others; the highest maxima of
    # few parts depend on chance.
    scales = np.sqrt(np.mean([part.mean_squares for part in observations], axis=0))
    negated_deviations = np.concatenate([-part[:, DEVIATION_STATISTICS] for part in statistics])
    return DepartureModel(
        mean_spectrum([part.spectrum for part in observations]).gains(),
        np.maximum(scales, _MIN_SCALE).astype(np.float32),
        tuple(
            GoodCells.of([part[:, columns] for part in statistics])
            for columns in STATISTICS.values()
        ),
        EvidenceModel.learn(negated_deviations.T),
    )


def _without(items: Sequence[_Item], left_out: Collection[int]) -> list[_Item]:
    return [item for number, item in enumerate(items) if number not in left_out]


# Standard deviation of the Gaussian of the high-pass, in cells. Slower changes come from the lights
# or the form of the part, not from a mark.
_SLOW_CELLS = 6.0
# Probability that a mark is reported anywhere on parts without one.
_CHANCE = 1e-3
# Ratio of the standard deviation of a normal distribution to its median absolute deviation (MAD).
_SD_PER_MAD = 1.0 / float(ndtri(0.75))

Box = tuple[int, int, int, int]
"""X, y, width and height in px."""


class FixedMarks:
    """Test for a mark that all good parts have at one place.

    It uses sums of normal scores (van der Waerden 1952) of the window statistics over the parts.
    """

    def __init__(self) -> None:
        self._parts = 0
        self._sums: FloatMap | None = None
        self._valid: npt.NDArray[np.bool_] | None = None

    def add(self, surface: SurfaceEstimate) -> None:
        """Add a good part; all have one frame size."""
        fields = part_fields(surface)
        valid, share = fields.valid, fields.valid.astype(np.float32)
        around = np.maximum(gaussian_mean(share, _SLOW_CELLS), np.float32(1e-3))
        scores = []
        for values in np.moveaxis(window_statistics(fields.moments, 0.0), -1, 0):
            fast = values - gaussian_mean(values * share, _SLOW_CELLS) / around
            scores.append(_normal_scores(fast, valid))
        if self._sums is None or self._valid is None:
            self._sums, self._valid = np.zeros_like(scores), valid
        self._sums += scores
        self._valid = self._valid & valid
        self._parts += 1

    def strongest(self) -> Box | None:
        """Bounding box of the strongest mark in px; None without one."""
        if self._sums is None or self._valid is None:
            return None
        # Windows at the borders of the frame and of the masks are incomplete.
        inside = cv2.erode(
            self._valid.astype(np.uint8), np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT,
            borderValue=0,
        ).astype(np.bool_)  # fmt: skip
        if not inside.any():
            return None
        sums: FloatMap = np.abs(self._sums) / np.sqrt(np.float32(self._parts))
        spread = np.maximum(_SD_PER_MAD * np.median(sums[:, inside], axis=1), np.float32(1.0))
        highest = np.where(inside, np.max(sums / spread[:, None, None], axis=0), 0.0)
        limit = -ndtri(0.5 * _CHANCE / (len(sums) * np.count_nonzero(inside)))
        if highest.max() <= limit:
            return None
        _, labels, boxes, _ = cv2.connectedComponentsWithStats(
            (highest > limit).astype(np.uint8), connectivity=8
        )
        label = labels.flat[int(np.argmax(highest))]
        left, top, width, height = (CELL_PX * int(side) for side in boxes[label][:4])
        return left, top, width, height


def _normal_scores(values: FloatMap, valid: npt.NDArray[np.bool_]) -> FloatMap:
    """Quantiles of the normal distribution at the ranks of the valid values; 0 for the others."""
    scores = np.zeros(values.shape, np.float32)
    count = np.count_nonzero(valid)
    ranks = np.empty(count)
    ranks[np.argsort(values[valid], kind="stable")] = (np.arange(count) + 0.5) / count
    scores[valid] = ndtri(ranks)
    return scores
