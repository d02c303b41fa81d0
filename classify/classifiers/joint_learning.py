"""Parameters of the joint classifier, learned from all training sets.

The four quarters of every training set show how much one surface differs from itself: how far its
spectra and statistics scatter, and which statistics scatter together. A distance of 1 is the
typical distance between two quarters of a set.
``tests/evidence/joint_constants.py`` prints what each tuned number gives halved
and doubled.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from classify.base.arrays import Floats
from classify.texture.heading import MOMENTS, heading_variances
from classify.texture.spectra import ANGLES
from classify.texture.statistics import QUARTERS, levels_for, statistics_length

from .classifier import Parameters, Shape
from .joint_bounds import BLUR_BASIS, LOCAL_DIRECTIONS, RING_DIRECTIONS, blur_basis
from .joint_features import (
    ALBEDO_GAINS,
    CHANNELS,
    CONTRAST_GAINS,
    SERIES,
    SPECTRAL_SHARE,
    JointTraining,
    blur_curve,
    contrasts,
    quarter_distances,
    statistics_rows,
)
from .joint_limits import unit_limit

# Weight of the distance of spectra; 1 minus it is the weight of the statistics.
# classify/DECISIONS.md compares others.
_SPECTRAL_SHARE = 0.5
# A floor is this many times the error, the power of the curl, which a relief does not have.
# Without floors logarithms fail at slant 70, where errors from shadow fill the weak bins. The
# upper quartile of the sets counts: a part in little shadow has more in other orientations.
_FLOOR_ERRORS = 3.0
_FLOOR_QUANTILE = 0.75
_LEAST_FLOOR = 1e-6
# Four quarters give a variance to a factor of two. It is averaged with the typical variance of all
# statistics, which counts as this many degrees of freedom, so that one class gives much the same
# metric as 22.
_TYPICAL_DEGREES = 48.0
_LEAST_VARIANCE = 1e-4  # of a statistic without noise; those of textures are 0.0006 or more
# Slopes of one surface differ by this factor from day to day: a slant of 42 instead of 45 degrees
# makes them 10 % smaller, 5 % of ambient light left in another 5 %. Quarters of a frame do not show
# it, so it is added to their covariance.
_LOG_SLOPE_SCATTER = 0.15
# Mean squared difference of spectra between quarters of typical surfaces. It counts as
# `_TYPICAL_SETS` sets in the unit of distances: one set with a figure in a corner would double it.
_TYPICAL_SPECTRAL = 0.045 * ANGLES
_TYPICAL_SETS = 10
# Patches of a texture differ in contrast, which changes all rings of a channel alike: that is one
# difference and not one per ring. It counts by half where its variance between quarters is
# `_CONTRAST_VARIANCE`. Typical variances of relief, albedo and coherence are those of 22 scanned
# materials (0.18 to 0.38, 0.33 to 0.38, 0.06 to 0.15 at 256 and 128 px); see "Contrast" in
# classify/DECISIONS.md.
_CONTRAST_VARIANCE = 0.3
_TYPICAL_CONTRASTS = (0.3, 0.3, 0.1)
# Quarters of any surface with noise differ by 1 or more; smooth plates without noise differ by the
# rounding of single precision, which must not become the unit (test_a_smooth_plate_is_a_class...).
_LEAST_DISTANCE = 0.1


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
    whitening = _whitening(statistics[:, 1:], len(relief_floors))
    metric = {
        **floors,
        CONTRAST_GAINS: _contrast_gains(trainings, density_floor),
        "whitening": whitening,
    }
    spectral, local = quarter_distances(trainings, statistics, metric)
    variances = [heading_variances(frame.statistics.headings) for frame in frames]
    learned = {
        **metric,
        SPECTRAL_SHARE: np.array(_SPECTRAL_SHARE),
        "heading_variances": np.mean(variances, axis=0),
        "pixels": np.array(np.median([float(frame.pixels) for frame in frames])),
        "spectral_scatter": np.array(_spectral_unit(spectral.mean(axis=1))),
        "local_scatter": np.array(max(float(local.mean()), _LEAST_DISTANCE)),
    }
    curves = np.stack(
        [blur_curve(training.frame, training.blurred, learned) for training in trainings]
    )
    learned[BLUR_BASIS] = blur_basis(curves, SERIES)
    return {**learned, "limit": np.array(unit_limit(float(learned["pixels"])))}


def parameter_shapes(segment_px: int) -> Mapping[str, Shape]:
    """Shape of each parameter of a library with segments of that side."""
    levels = levels_for(segment_px)
    length = statistics_length(levels)
    numbers = ("density_floor", "pixels", "spectral_scatter", "local_scatter", "limit")
    return {
        **dict.fromkeys((*numbers, SPECTRAL_SHARE), ()),
        **dict.fromkeys(("relief_floors", "albedo_floors"), (levels,)),
        "heading_variances": (levels - 1, MOMENTS),
        "whitening": (length, length),
        CONTRAST_GAINS: (CHANNELS,),
        BLUR_BASIS: (RING_DIRECTIONS + LOCAL_DIRECTIONS, SERIES + length),
    }


def _contrast_gains(trainings: Sequence[JointTraining], density_floor: Floats) -> Floats:
    """(3,) gains of the contrast of each channel, from its variance between quarters."""
    levels = np.stack([contrasts(training.quarters, density_floor) for training in trainings])
    measured = levels.var(axis=1, ddof=1, dtype=np.float64).sum(axis=0)
    typical = _TYPICAL_SETS * np.array(_TYPICAL_CONTRASTS)
    variances = (measured + typical) / (len(levels) + _TYPICAL_SETS)
    gains: Floats = 1.0 / np.sqrt(1.0 + variances / _CONTRAST_VARIANCE)
    return gains


def _spectral_unit(distances: Floats) -> float:
    """Geometric mean of spectral distances between quarters, over sets and a prior."""
    logs = np.log(np.maximum(distances, _LEAST_DISTANCE))
    total = float(logs.sum()) + _TYPICAL_SETS * math.log(_TYPICAL_SPECTRAL)
    return math.exp(total / (len(logs) + _TYPICAL_SETS))


def _whitening(quarters: Floats, levels: int) -> Floats:
    """(d, d) W of (sets, 4, d) quarters: |W (x - y)|^2 is a squared Mahalanobis distance."""
    deviations = (quarters - quarters.mean(axis=1, keepdims=True)).reshape(-1, quarters.shape[-1])
    degrees = len(quarters) * (QUARTERS - 1)
    covariance = deviations.T @ deviations / degrees
    np.fill_diagonal(covariance, np.diag(covariance) + _LEAST_VARIANCE)
    variances = np.diag(covariance)
    typical = np.exp(np.log(variances).mean())
    scatter = np.sqrt(
        (degrees * variances + _TYPICAL_DEGREES * typical) / (degrees + _TYPICAL_DEGREES)
    )
    correlation = covariance / np.sqrt(np.outer(variances, variances))
    correlation *= degrees / (degrees + len(variances))
    np.fill_diagonal(correlation, 1.0)
    # The first statistics are the logarithms of the rms of relief, level by level.
    slopes = np.where(np.arange(len(scatter)) < levels, _LOG_SLOPE_SCATTER / scatter, 0.0)
    correlation += np.outer(slopes, slopes)
    whitening: Floats = np.linalg.inv(np.linalg.cholesky(correlation)) / scatter
    return whitening
