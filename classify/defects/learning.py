"""Learn a `DefectModel` from good parts, each scored by a model of the others."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from classify.errors import InputError
from classify.surface.estimate import SurfaceEstimate

from .defect_model import DefectModel
from .fields import part_fields
from .limits import limit_of, tile_maxima
from .observation import Observation
from .whitening import SEGMENT, Spectrum, mean_spectrum

LEAST_PARTS = 3
MOST_PARTS = 1000
MIN_SIDE_PX = 2 * SEGMENT
"""Shortest side of a part: one segment of the spectra at half resolution."""

# Share of the variance of each statistic that is added to it: keeps directions in which few parts
# happen to agree from deciding.
_RIDGE = 0.01


def learn_defects(
    surfaces: Iterable[SurfaceEstimate],
    orientations_deg: Sequence[float | None],
    false_alarm_rate: float = 0.01,
) -> DefectModel:
    """Learn what good parts of one texture look like.

    Each part is scored by a model of all others. The limits follow from these scores, so that a
    share `false_alarm_rate` of good parts exceeds 1.0 anywhere. Fewer parts than 1 / rate cannot
    show that: the tail of their scores is extrapolated, no limit is below the highest score of a
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
    angles = [0.0 if each is None else float(each) for each in orientations_deg]
    if not LEAST_PARTS <= len(parts) <= MOST_PARTS:
        raise InputError(f"{len(parts)} good parts; give {LEAST_PARTS} to {MOST_PARTS}")
    if len(angles) != len(parts) or not all(map(math.isfinite, angles)):
        raise InputError(f"{len(angles)} orientations of {len(parts)} parts; give a number of each")
    if len({part.shape for part in parts}) > 1:
        raise InputError("the good parts differ in the size of their frames; capture them alike")
    spectra = [Spectrum.of(part, angle) for part, angle in zip(parts, angles, strict=True)]
    maxima, statistics = [], []
    for index, (part, angle) in enumerate(zip(parts, angles, strict=True)):
        others = mean_spectrum([each for n, each in enumerate(spectra) if n != index and each])
        observation = Observation.of(part, others.gains(), angle)
        maxima.append(
            [
                [tile_maxima(response, part.valid) for response in observation.responses(field)]
                for field in range(2)
            ]
        )
        statistics.append(observation.statistics())
    samples = [
        each[part.valid].astype(np.float64) for each, part in zip(statistics, parts, strict=True)
    ]
    distances = []
    for index, (part, each) in enumerate(zip(parts, statistics, strict=True)):
        mean, whitening = _distribution([s for n, s in enumerate(samples) if n != index])
        length = np.linalg.norm((each - mean) @ whitening, axis=-1)
        distances.append(tile_maxima(length.astype(np.float32), part.valid))
    values = np.array(maxima)  # parts, fields, responses, tiles
    lengths = np.array(distances)
    tiles = float(np.isfinite(lengths).sum(axis=1).mean())

    def limit(of: npt.NDArray[np.float64]) -> float:
        return limit_of(of.ravel(), tiles, false_alarm_rate)

    # parts, responses, tiles: the length of the statistics is one of the responses
    joined = np.concatenate([values.reshape(len(parts), -1, lengths.shape[1]), lengths[:, None]], 1)
    scores = []
    for index in range(len(parts)):
        others = np.delete(joined, index, axis=0)
        scores.append((joined[index] / _limits(others, limit)[:, None]).max(axis=0))
    scores = np.array(scores)
    all_limits = _limits(joined, limit)
    limits, length_limit = all_limits[:-1].reshape(values.shape[1:3]), all_limits[-1]
    factor = limit(scores)
    good_scores = scores.max(axis=1)
    if len(parts) * false_alarm_rate < 1.0:
        factor = max(factor, float(good_scores.max()))
    mean, whitening = _distribution(samples)
    return DefectModel(
        gains=mean_spectrum([each for each in spectra if each]).gains(),
        limits=np.asarray(limits * factor, np.float32),
        statistics_mean=np.asarray(mean, np.float32),
        statistics_whitening=np.asarray(whitening / (length_limit * factor), np.float32),
        false_alarm_rate=false_alarm_rate,
        good_scores=good_scores / factor,
    )


def _checked(surface: SurfaceEstimate) -> SurfaceEstimate:
    rows, columns = surface.shape
    if min(rows, columns) < MIN_SIDE_PX:
        raise InputError(
            f"a part of {columns} x {rows} px; its sides must be {MIN_SIDE_PX} px or more"
        )
    return surface


def _distribution(
    samples: Sequence[npt.NDArray[np.float64]],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Mean and whitening matrix of the statistics of all cells."""
    joined = np.concatenate(samples)
    mean = joined.mean(axis=0)
    covariance = np.cov(joined.T)
    covariance += _RIDGE * np.diag(np.diag(covariance)) + 1e-9 * np.eye(len(mean))
    values, vectors = np.linalg.eigh(covariance)
    return mean, vectors / np.sqrt(values)


def _limits(maxima, limit):
    return np.array([limit(maxima[:, index]) for index in range(maxima.shape[1])])
