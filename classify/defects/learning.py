"""Learn a `DefectModel` from good parts, each scored by a model of the others."""

import math
from collections.abc import Iterable, Sequence
from itertools import chain
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from classify.errors import InputError
from classify.surface.estimate import FloatMap, SurfaceEstimate

from .defect_model import DefectModel
from .fields import part_fields
from .limits import common_limit, limits_of, tile_maxima
from .observation import Observation
from .responses import ALBEDO_RESPONSES, RELIEF_RESPONSES
from .whitening import MIN_SIDE_PX, Spectrum, mean_spectrum

LEAST_PARTS = 3
MOST_PARTS = 100

# Share of the variance of each statistic that is added to it: keeps directions in which few parts
# happen to agree from deciding.
_RIDGE = 0.01
# A statistic that does not vary, as of an albedo without noise, must not decide.
_LEAST_VARIANCE = 1e-6

Item = TypeVar("Item")


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
        others = mean_spectrum(_without(spectra, index))
        observation = Observation.of(part, others.gains(), angle)
        responses = chain(observation.relief_responses(), observation.albedo_responses())
        maxima.append([tile_maxima(response, part.valid) for response in responses])
        statistics.append(observation.statistics())
    sums = [_power_sums(each[part.valid]) for each, part in zip(statistics, parts, strict=True)]
    for index, (part, each) in enumerate(zip(parts, statistics, strict=True)):
        mean, whitening = _whitening(_without(sums, index))
        length = np.linalg.norm((each - mean) @ whitening, axis=-1)
        maxima[index].append(tile_maxima(length, part.valid))
    scores = []
    for index, response_maxima in enumerate(maxima):
        limits = limits_of(np.array(_without(maxima, index)), false_alarm_rate)
        scores.append((np.array(response_maxima) / limits[:, None]).max(axis=0))
    factor = common_limit(np.array(scores), false_alarm_rate)
    final = np.asarray(limits_of(np.array(maxima), false_alarm_rate) * factor, np.float32)
    relief_limits, albedo_limits, length_limit = np.split(
        final, [RELIEF_RESPONSES, RELIEF_RESPONSES + ALBEDO_RESPONSES]
    )
    mean, whitening = _whitening(sums)
    return DefectModel(
        gains=mean_spectrum(spectra).gains(),
        relief_limits=relief_limits,
        albedo_limits=albedo_limits,
        statistics_mean=np.asarray(mean, np.float32),
        statistics_whitening=np.asarray(whitening / length_limit, np.float32),
        false_alarm_rate=false_alarm_rate,
        good_scores=np.max(scores, axis=1) / factor,
    )


def _checked(surface: SurfaceEstimate) -> SurfaceEstimate:
    rows, columns = surface.shape
    if min(rows, columns) < MIN_SIDE_PX:
        raise InputError(
            f"a part of {columns} x {rows} px; its sides must be {MIN_SIDE_PX} px or more"
        )
    return surface


def _without(items: Sequence[Item], index: int) -> list[Item]:
    return [item for number, item in enumerate(items) if number != index]


def _power_sums(samples: FloatMap) -> npt.NDArray[np.float64]:
    """(d + 1, d + 1) sums of the products of (1, sample), of (n, d) samples."""
    extended = np.pad(samples.astype(np.float64), ((0, 0), (1, 0)), constant_values=1.0)
    return extended.T @ extended


def _whitening(
    sums: Sequence[npt.NDArray[np.float64]],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Mean and whitening matrix of statistics, from the power sums of several parts."""
    moments = np.sum(sums, axis=0)
    moments = moments / moments[0, 0]
    mean = moments[0, 1:]
    covariance = moments[1:, 1:] - np.outer(mean, mean)
    covariance += _RIDGE * np.diag(np.diag(covariance)) + _LEAST_VARIANCE * np.eye(len(mean))
    values, vectors = np.linalg.eigh(covariance)
    return mean, vectors / np.sqrt(values)
