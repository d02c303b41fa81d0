"""Parameters of the joint classifier, learned from all training sets.

The four quarters of every training set of a texture show how much one surface differs from itself:
how far its spectra and statistics scatter, and which statistics scatter together. A distance of 1
is the typical distance between two quarters of a set.
``tests/evidence/joint_constants.py`` prints the errors with each tuned number halved and doubled.
"""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from classify.base.arrays import BoolArray, FloatMap, Floats, Indices
from classify.texture.heading import MOMENTS, heading_variances
from classify.texture.spectra import ANGLES
from classify.texture.statistics import QUARTERS, levels_for, statistics_length
from classify.texture.uniformity import Uniformity, uniformity_of

from . import Parameters, Shape
from .joint_bounds import BLUR_BASIS, LOCAL_DIRECTIONS, RING_DIRECTIONS, blur_basis
from .joint_features import (
    ALBEDO_GAINS,
    CHANNELS,
    CONTRAST_GAINS,
    RING_CAP,
    SERIES,
    SPECTRAL_SHARE,
    JointTraining,
    blur_curve,
    contrasts,
    quarter_distances,
    statistics_rows,
)

# The limit of a class grows with this power of its scatter: the distance between two patches does
# with power 0.7 to 1, the distance to other classes does not.
_SCATTER_POWER = 0.4
# Differences from day to day do not depend on the scatter of a class: sheets of corrugated steel,
# of scatter 0.2, are at 1.2 to 1.8 from their class with another rig and focus. See "When a
# surface is unknown" in classify/DECISIONS.md for what this gives.
_MIN_SCATTER = 0.5
# Largest `scatter_factor`: the largest of the 22 materials. Quarters of a part with a figure in one
# of them differ more than textures do (test_a_class_with_a_figure_in_a_corner...).
_MAX_FACTOR = 1.5
# Largest factor of a class with one set only: the 95th percentile and the mean of the factors of
# uniform classes. See "Uniformity" in classify/DECISIONS.md.
_MAX_FACTOR_OF_ONE_SET: Mapping[Uniformity, float] = {"varied": 1.3, "no texture": 1.0}
# Median distance of another patch to a class of scatter 1. Its logarithm has these standard
# deviations between classes of equal scatter and between patches of one class, together 0.43. On
# 22 scanned materials the median is 0.84 and the deviation 0.53; joint_constants.py prints how near
# unknown surfaces come to the limits of doubled values. A limit is the 99th percentile, 2.33
# deviations above the median.
_MEDIAN_DISTANCE = 0.82
_CLASS_SPREAD = 0.34
_PATCH_SPREAD = 0.26
_LIMIT_DEVIATIONS = 2.33
# Mean and standard deviation of the least of one, two and three normal numbers. More sets count as
# three: they seldom show as many independent patches.
_MINIMUM_OF_NORMALS = ((0.0, 1.0), (-0.564, 0.826), (-0.846, 0.748))
# Below this side the limit falls with the twelfth root of the side, by 6 % at 128 px: smaller
# frames distinguish textures less well.
_SUFFICIENT_PX = 256
# Largest number of compared sets of a class, and of references for each of them, those of lowest
# bounds. More would take minutes and change little.
_MAX_SETS = 200
_MAX_REFERENCES = 256


def scatter_factor(distances: Floats) -> float:
    """Factor of the limit of a class, from distances between the quarters of a set."""
    scatter = max(float(distances.mean()), _MIN_SCATTER)
    return float(min(scatter**_SCATTER_POWER, _MAX_FACTOR))


def limit_factors(
    labels: Sequence[str],
    sets: Sequence[int],
    factors: FloatMap,
    uniformity: Mapping[str, Uniformity],
) -> FloatMap:
    """(n,) `scatter_factor` of each reference, bounded in uneven classes with one set."""
    sets_of = Counter(label for label, _ in set(zip(labels, sets, strict=True)))
    bounds = [
        _MAX_FACTOR_OF_ONE_SET.get(uniformity.get(label, "uniform"), math.inf)
        if sets_of[label] == 1
        else math.inf
        for label in labels
    ]
    return np.minimum(factors, np.array(bounds, np.float32))


def unit_limit(pixels: float) -> float:
    """Limit of a class of scatter 1 with one set, for frames of that many pixels."""
    limit = _MEDIAN_DISTANCE * math.exp(
        _LIMIT_DEVIATIONS * math.hypot(_CLASS_SPREAD, _PATCH_SPREAD)
    )
    return float(limit * min(pixels / _SUFFICIENT_PX**2, 1.0) ** (1 / 24))


def limit_of_sets(limit: float, distances: Sequence[float]) -> float:
    """Limit of a class from the distance of each set to the others: a normal prior, updated.

    Distances too small for two patches are left out. The limit is at most the 99th percentile of
    the smallest of as many distances.
    """
    spread = math.hypot(_CLASS_SPREAD, _PATCH_SPREAD)
    expected = math.log(limit) - _LIMIT_DEVIATIONS * spread
    logs = [math.log(value) for value in distances if value > math.exp(expected - 2.0 * spread)]
    if not logs:
        return limit
    nearest, deviation = _MINIMUM_OF_NORMALS[min(len(logs), len(_MINIMUM_OF_NORMALS)) - 1]
    max_excess = nearest * _PATCH_SPREAD + _LIMIT_DEVIATIONS * math.hypot(
        _CLASS_SPREAD, deviation * _PATCH_SPREAD
    )
    trust = 1.0 - 1.0 / (1.0 + len(logs) * (_CLASS_SPREAD / _PATCH_SPREAD) ** 2)
    excess = trust * sum(max(value - expected, -spread) for value in logs) / len(logs)
    remaining_spread = math.hypot(_CLASS_SPREAD * math.sqrt(1.0 - trust), _PATCH_SPREAD)
    return math.exp(expected + min(excess + _LIMIT_DEVIATIONS * remaining_spread, max_excess))


def class_limits(
    labels: Sequence[str],
    sets: Sequence[int],
    single_set_limits: FloatMap,
    lower_bounds: Callable[[int, Indices], Floats],
    nearest: Callable[[int, Indices], float],
) -> dict[str, float]:
    """Limit of each class, at most the distance to the nearest other class.

    `single_set_limits` are those of the references as classes with one set.
    """
    numbers, classes = np.array(sets), np.array(labels)
    firsts = np.unique(numbers, return_index=True)[1]

    def least_distance(index: int, others: BoolArray) -> float:
        indices = np.flatnonzero(others)
        if len(indices) > _MAX_REFERENCES:
            lowest = np.argpartition(lower_bounds(index, indices), _MAX_REFERENCES)
            indices = indices[lowest[:_MAX_REFERENCES]]
        return nearest(index, indices) if len(indices) else math.inf

    limits = {}
    for label in dict.fromkeys(labels):
        same = classes == label
        of_class = firsts[same[firsts]][:_MAX_SETS]
        within = []
        if len(of_class) > 1:
            within = [least_distance(i, same & (numbers != numbers[i])) for i in of_class]
        between = min(least_distance(i, ~same) for i in of_class)
        typical = limit_of_sets(float(single_set_limits[of_class].mean()), within)
        limits[label] = min(typical, between)
    return limits


# See "Features of textures" in classify/DECISIONS.md.
_SPECTRAL_SHARE = 0.5
# The weight of a ring is its radius in bins, in proportion to its DFT cells, up to this cap.
# Without a cap the highest frequencies, which hold most of the noise, would outweigh all others. In
# frames below `_SUFFICIENT_PX` squared the cap grows with the missing area: see "Small frames" in
# classify/DECISIONS.md.
_CAP_BINS = 8.0
# A floor is this many times the power of the curl. A relief has no curl, so that it measures the
# error. Without floors logarithms fail at slant 70, where errors from shadow fill the weak bins.
# The upper quartile of the sets counts: a part in little shadow has more in other orientations.
_FLOOR_ERRORS = 3.0
_FLOOR_QUANTILE = 0.75
_MIN_FLOOR = 1e-6
# Four quarters give a variance to a factor of two. It is averaged with the typical variance of all
# statistics, which counts as this many degrees of freedom, so that one class gives much the same
# metric as 22.
_TYPICAL_FREEDOM = 48.0
_MIN_VARIANCE = 1e-4  # of a statistic without noise; those of textures are 0.0006 or more
# Slopes of one surface differ by this factor from day to day: a slant of 42 instead of 45 degrees
# makes them 10 % smaller, 5 % of ambient light left in another 5 %. Quarters of a frame do not show
# it, so it is added to their covariance.
_LOG_SLOPE_SCATTER = 0.15
# Mean squared difference of spectra between quarters of typical surfaces. It counts as
# `_TYPICAL_SETS` sets in the unit of distances: one set with a figure in a corner would double it.
_TYPICAL_SPECTRAL = 0.045 * ANGLES
_TYPICAL_SETS = 10
# Patches of a texture differ in contrast, which changes all rings of a channel alike and should
# count once, not once per ring. Contrast counts by half where its variance between quarters is
# `_CONTRAST_VARIANCE`. Typical variances of relief, albedo and coherence are those of 22 scanned
# materials (0.18 to 0.38, 0.33 to 0.38, 0.06 to 0.15 at 256 and 128 px); see "Contrast" in
# classify/DECISIONS.md.
_CONTRAST_VARIANCE = 0.3
_TYPICAL_CONTRASTS = (0.3, 0.3, 0.1)
# Quarters of any surface with noise differ by 1 or more; smooth plates without noise differ by the
# rounding of single precision, which must not become the unit (test_a_smooth_plate_is_a_class...).
_MIN_DISTANCE = 0.1


def learn(trainings: Sequence[JointTraining], _labels: Sequence[str]) -> Parameters:
    """Floors, whitening, units and the limit of a class of scatter 1."""
    frames = [training.frame for training in trainings]
    pixels = float(np.median([float(frame.pixels) for frame in frames]))
    densities = [frame.curl_density for frame in frames]
    curls = [frame.statistics.moments[0, :, 7] for frame in frames]  # variances of the curl
    density_floor = np.array(
        max(_FLOOR_ERRORS * float(np.quantile(densities, _FLOOR_QUANTILE)), _MIN_FLOOR)
    )
    relief_floors = np.maximum(
        _FLOOR_ERRORS * np.quantile(curls, _FLOOR_QUANTILE, axis=0), _MIN_FLOOR
    )
    floors = {
        "density_floor": density_floor,
        RING_CAP: np.array(_CAP_BINS * max(_SUFFICIENT_PX**2 / pixels, 1.0)),
        "relief_floors": relief_floors,
        "albedo_floors": relief_floors * np.array(ALBEDO_GAINS[: len(relief_floors)]),
    }
    textures = _textures(trainings)
    statistics = np.stack(
        [statistics_rows(training.frame.statistics, floors) for training in textures]
    )
    whitening = _whitening(statistics[:, 1:], len(relief_floors))
    metric = {
        **floors,
        CONTRAST_GAINS: _contrast_gains(textures, floors),
        "whitening": whitening,
    }
    spectral, local = quarter_distances(textures, statistics, metric)
    variances = [heading_variances(frame.statistics.headings) for frame in frames]
    learned = {
        **metric,
        SPECTRAL_SHARE: np.array(_SPECTRAL_SHARE),
        "heading_variances": np.mean(variances, axis=0),
        "pixels": np.array(pixels),
        "spectral_scatter": np.array(_spectral_scatter(spectral.mean(axis=1))),
        "local_scatter": np.array(max(float(local.mean()), _MIN_DISTANCE)),
    }
    curves = np.stack(
        [blur_curve(training.frame, training.blurred, learned) for training in trainings]
    )
    learned[BLUR_BASIS] = blur_basis(curves)
    return {**learned, "limit": np.array(unit_limit(pixels))}


def _textures(trainings: Sequence[JointTraining]) -> Sequence[JointTraining]:
    """Sets whose quarters give the unit of distance: textures, or all sets if none is one."""
    # Quarters of pictures differ more, so that other pictures would come within the limits: see
    # "Uniformity" in classify/DECISIONS.md.
    textures = [
        training for training in trainings if uniformity_of([training.unevenness]) != "no texture"
    ]
    return textures or trainings


def parameter_shapes(segment_px: int) -> Mapping[str, Shape]:
    """Shape of each parameter of a library with segments of that side."""
    levels = levels_for(segment_px)
    length = statistics_length(levels)
    scalars = ("density_floor", "pixels", "spectral_scatter", "local_scatter", "limit")
    return {
        **dict.fromkeys((*scalars, SPECTRAL_SHARE, RING_CAP), ()),
        **dict.fromkeys(("relief_floors", "albedo_floors"), (levels,)),
        "heading_variances": (levels - 1, MOMENTS),
        "whitening": (length, length),
        CONTRAST_GAINS: (CHANNELS,),
        BLUR_BASIS: (RING_DIRECTIONS + LOCAL_DIRECTIONS, SERIES + length),
    }


def _contrast_gains(trainings: Sequence[JointTraining], parameters: Parameters) -> Floats:
    """(3,) gains of the contrast of each channel, from its variance between quarters."""
    of_quarters = np.stack([contrasts(training.quarters, parameters) for training in trainings])
    measured = of_quarters.var(axis=1, ddof=1, dtype=np.float64).sum(axis=0)
    typical = _TYPICAL_SETS * np.array(_TYPICAL_CONTRASTS)
    variances = (measured + typical) / (len(trainings) + _TYPICAL_SETS)
    gains: Floats = 1.0 / np.sqrt(1.0 + variances / _CONTRAST_VARIANCE)
    return gains


def _spectral_scatter(distances: Floats) -> float:
    """Geometric mean of spectral distances between quarters, over sets and a prior."""
    logs = np.log(np.maximum(distances, _MIN_DISTANCE))
    total = float(logs.sum()) + _TYPICAL_SETS * math.log(_TYPICAL_SPECTRAL)
    return math.exp(total / (len(logs) + _TYPICAL_SETS))


def _whitening(quarters: Floats, levels: int) -> Floats:
    """(d, d) W of (sets, 4, d) quarters: |W (x - y)|^2 is a squared Mahalanobis distance."""
    deviations = (quarters - quarters.mean(axis=1, keepdims=True)).reshape(-1, quarters.shape[-1])
    freedom = len(quarters) * (QUARTERS - 1)
    covariance = deviations.T @ deviations / freedom
    np.fill_diagonal(covariance, np.diag(covariance) + _MIN_VARIANCE)
    variances = np.diag(covariance)
    typical = np.exp(np.log(variances).mean())
    scatter = np.sqrt(
        (freedom * variances + _TYPICAL_FREEDOM * typical) / (freedom + _TYPICAL_FREEDOM)
    )
    correlation = covariance / np.sqrt(np.outer(variances, variances))
    correlation *= freedom / (freedom + len(variances))
    np.fill_diagonal(correlation, 1.0)
    # The first statistics are the logarithms of the rms of relief, level by level.
    slopes = np.where(np.arange(len(scatter)) < levels, _LOG_SLOPE_SCATTER / scatter, 0.0)
    correlation += np.outer(slopes, slopes)
    whitening: Floats = np.linalg.inv(np.linalg.cholesky(correlation)) / scatter
    return whitening
