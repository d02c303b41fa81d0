"""Learn a `DefectModel` from good parts, each scored by a model of the other half."""

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from classify.errors import InputError
from classify.surface.estimate import FloatMap, SurfaceEstimate

from .defect_model import DefectModel
from .departures import Departures
from .evidence import Evidence
from .fields import PartFields, part_fields
from .gaussian import Gaussian, PowerSums, power_sums
from .halves import unlike_halves
from .limits import common_limit, limits_of, tile_maxima
from .observation import Observation
from .responses import RELIEF_RESPONSES
from .whitening import MIN_SIDE_PX, Spectrum, mean_spectrum
from .window_statistics import window_statistics

LEAST_PARTS = 3
MOST_PARTS = 100

Item = TypeVar("Item")


def learn_defects(
    surfaces: Iterable[SurfaceEstimate],
    orientations_deg: Sequence[float | None],
    false_alarm_rate: float = 0.01,
) -> DefectModel:
    """Learn what good parts of one texture look like.

    The parts are split into halves that differ as much as possible, and each part is scored by a
    model of the other half. The limit follows from these scores, so that a share
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
    angles = [0.0 if each is None else float(each) for each in orientations_deg]
    if not LEAST_PARTS <= len(parts) <= MOST_PARTS:
        raise InputError(f"{len(parts)} good parts; give {LEAST_PARTS} to {MOST_PARTS}")
    if len(angles) != len(parts) or not all(map(math.isfinite, angles)):
        raise InputError(
            f"{len(angles)} orientations for {len(parts)} parts; give one finite angle for each"
        )
    if len({part.shape for part in parts}) > 1:
        raise InputError("the good parts differ in the size of their frames; capture them alike")
    observed = _observed(parts, angles)
    departures: dict[int, FloatMap] = {}
    for half in unlike_halves([each.windows for each in observed]):
        others = _departures(_without(observed, half), false_alarm_rate)
        departures |= {index: others.of(parts[index], angles[index]) for index in half}
    inside = np.concatenate([each[:, parts[n].valid] for n, each in departures.items()], axis=1)
    evidence = Evidence.of(inside)
    maxima = np.array([
        tile_maxima(evidence.of_departures(departures[index]).sum(axis=0), part.valid)
        for index, part in enumerate(parts)
    ])  # fmt: skip
    limit = common_limit(maxima, false_alarm_rate)
    model = _departures(observed, false_alarm_rate)
    return DefectModel(model, evidence, limit, false_alarm_rate, maxima.max(axis=1) / limit)


def _checked(surface: SurfaceEstimate) -> SurfaceEstimate:
    rows, columns = surface.shape
    if min(rows, columns) < MIN_SIDE_PX:
        raise InputError(
            f"a part of {columns} x {rows} px; its sides must be {MIN_SIDE_PX} px or more"
        )
    return surface


@dataclass(frozen=True, eq=False)
class _Observed:
    """Observations of one part: maxima of its tiles, and sums of its statistics.

    Responses and octaves are whitened by the spectra of the other half of the parts.
    """

    spectrum: Spectrum
    maxima: npt.NDArray[np.float64]
    octaves: PowerSums
    windows: PowerSums


def _observed(parts: Sequence[PartFields], angles: Sequence[float]) -> list[_Observed]:
    spectra = [Spectrum.of(part, angle) for part, angle in zip(parts, angles, strict=True)]
    windows = [
        power_sums(window_statistics(part.moments, angle)[part.valid])
        for part, angle in zip(parts, angles, strict=True)
    ]
    observed = {}
    for half in unlike_halves(windows):
        gains = mean_spectrum(_without(spectra, half)).gains()
        for index in half:
            valid = parts[index].valid
            observation = Observation.of(parts[index], gains, angles[index])
            responses = chain(observation.relief_responses(), observation.albedo_responses())
            observed[index] = _Observed(
                spectra[index],
                np.array([tile_maxima(response, valid) for response in responses]),
                power_sums(observation.octave_statistics()[valid]),
                windows[index],
            )
    return [observed[index] for index in range(len(parts))]


def _departures(observed: Sequence[_Observed], false_alarm_rate: float) -> Departures:
    limits = limits_of(np.array([each.maxima for each in observed]), false_alarm_rate)
    relief_limits, albedo_limits = np.split(limits.astype(np.float32), [RELIEF_RESPONSES])
    return Departures(
        mean_spectrum([each.spectrum for each in observed]).gains(),
        relief_limits,
        albedo_limits,
        Gaussian.of([each.octaves for each in observed]),
        Gaussian.of([each.windows for each in observed]),
    )


def _without(items: Sequence[Item], left_out: Collection[int]) -> list[Item]:
    return [item for number, item in enumerate(items) if number not in left_out]
