"""What the joint classifier learns: floors, whitening, units and limits.

The four quarters of every training set show how much one surface differs from itself: how far its
spectra and statistics scatter, and which statistics scatter together. A distance of 1 is the mean
distance between two quarters of a set.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from classify.texture.heading import MOMENTS, heading_variances
from classify.texture.statistics import PARTS, levels_for, statistics_length

from .classifier import Parameters, Shape
from .joint_bounds import BLUR_BASIS, LOCAL_DIRECTIONS, RING_DIRECTIONS, blur_basis
from .joint_features import (
    ALBEDO_GAINS,
    SERIES,
    Distances,
    JointTraining,
    blur_curve,
    combined,
    quarter_distances,
    statistics_rows,
)

# A floor is this many times the error, the power of the curl, which a relief does not have.
# Without floors logarithms fail at slant 70, where errors from shadow fill the weak bins. The
# upper quartile of the sets counts: a part in little shadow has more in other orientations.
_FLOOR_ERRORS = 3.0
_FLOOR_QUANTILE = 0.75
_LEAST_FLOOR = 1e-6
# Correlations between statistics come from few quarters: half of each is used (shrinkage).
_SHRINKAGE = 0.5
_LEAST_SCATTER = 0.01
# Quarters of any surface with noise differ by 1 or more; smooth plates without noise differ by the
# rounding of single precision, which must not become the unit (test_a_smooth_plate_is_a_class...).
_LEAST_DISTANCE = 0.1
# The limit of a class grows with this power of its scatter: the scatter of four quarters is known
# to a factor of two only.
_SCATTER_POWER = 0.5
# A limit is this quantile of the distances between quarters, in units of their class's scatter,
# times a margin. The quantile of few distances is uncertain: `_TYPICAL_LIMIT` counts as
# `_TYPICAL_PAIRS` distances, for libraries of few sets.
_LIMIT_QUANTILE = 0.99
LIMIT_MARGIN = 1.25
_TYPICAL_LIMIT = 2.4
_TYPICAL_PAIRS = 60
# Quarters of training sets below this side underestimate how far two patches of a coarse texture
# differ. The limit grows with the fourth root of the missing factor in the side, which at 128 px
# refuses fewer known surfaces and accepts half of the unknown scanned materials.
_SUFFICIENT_PX = 256


def learn(trainings: Sequence[JointTraining], _labels: Sequence[str]) -> Parameters:
    """Floors, whitening, units and the limit of a class of scatter 1."""
    frames = [training.frame for training in trainings]
    densities = [frame.curl_density for frame in frames]
    curls = [frame.statistics.moments[0, :, 7] for frame in frames]
    density_floor = np.array(
        max(_FLOOR_ERRORS * float(np.quantile(densities, _FLOOR_QUANTILE)), _LEAST_FLOOR)
    )
    relief_floors = np.maximum(
        _FLOOR_ERRORS * np.quantile(curls, _FLOOR_QUANTILE, axis=0), _LEAST_FLOOR
    )
    floors = {
        "density_floor": density_floor,
        "relief_floors": relief_floors,
        "albedo_floors": relief_floors * np.array(ALBEDO_GAINS[: len(relief_floors)]),
    }
    statistics = np.stack([statistics_rows(frame.statistics, floors) for frame in frames])
    whitening = _whitening(statistics[:, 1:])
    spectral, local = quarter_distances(trainings, statistics, density_floor, whitening)
    variances = [heading_variances(frame.statistics.headings) for frame in frames]
    learned = {
        **floors,
        "heading_variances": np.mean(variances, axis=0),
        "whitening": whitening,
        "pixels": np.array(np.median([float(frame.pixels) for frame in frames])),
        "spectral_scatter": np.array(max(float(spectral.mean()), _LEAST_DISTANCE)),
        "local_scatter": np.array(max(float(local.mean()), _LEAST_DISTANCE)),
    }
    curves = np.stack([blur_curve(each.frame, each.blurred, learned) for each in trainings])
    learned[BLUR_BASIS] = blur_basis(curves, SERIES)
    distances = combined(spectral, local, learned)
    return {**learned, "limit": np.array(_unit_limit(distances, float(learned["pixels"])))}


def parameter_shapes(segment_px: int) -> Mapping[str, Shape]:
    """Shape of each parameter of a library with segments of that side."""
    levels = levels_for(segment_px)
    length = statistics_length(levels)
    numbers = ("density_floor", "pixels", "spectral_scatter", "local_scatter", "limit")
    return {
        **dict.fromkeys(numbers, ()),
        **dict.fromkeys(("relief_floors", "albedo_floors"), (levels,)),
        "heading_variances": (levels - 1, MOMENTS),
        "whitening": (length, length),
        BLUR_BASIS: (RING_DIRECTIONS + LOCAL_DIRECTIONS, SERIES + length),
    }


def scatter_factor(distances: Distances) -> float:
    """Factor of the limit of a class, from distances between the quarters of one of its sets."""
    scatter = max(float(distances.mean()), _LEAST_SCATTER)
    return float(scatter**_SCATTER_POWER)


def _whitening(quarters: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """(d, d) W such that |W (x - y)|^2 is the squared Mahalanobis distance within a set.

    `quarters` is (sets, 4, d).
    """
    deviations = (quarters - quarters.mean(axis=1, keepdims=True)).reshape(-1, quarters.shape[-1])
    covariance = deviations.T @ deviations / (len(quarters) * (PARTS - 1))
    scatter = np.sqrt(np.diag(covariance)) + _LEAST_SCATTER
    correlation = (1.0 - _SHRINKAGE) * covariance / np.outer(scatter, scatter)
    np.fill_diagonal(correlation, 1.0)
    whitening: npt.NDArray[np.float64] = np.linalg.inv(np.linalg.cholesky(correlation)) / scatter
    return whitening


def _unit_limit(distances: Distances, pixels: float) -> float:
    """Limit of a class of scatter 1, from (sets, 6) distances between quarters."""
    scatter = np.maximum(distances.mean(axis=1, keepdims=True), _LEAST_SCATTER)
    relative = distances / scatter**_SCATTER_POWER
    quantile = float(np.quantile(relative, _LIMIT_QUANTILE))
    trust = relative.size / (relative.size + _TYPICAL_PAIRS)
    limit = LIMIT_MARGIN * (trust * quantile + (1.0 - trust) * _TYPICAL_LIMIT)
    return float(limit * max(_SUFFICIENT_PX**2 / pixels, 1.0) ** 0.125)
