"""Limits of the joint classifier: the distance beyond which a class rejects.

The distance of another patch of a class is taken as log-normal. Its median is expected from the
scatter of the quarters of a training frame, and measured where a class has several sets.
``tests/evidence/joint_constants.py`` prints what each tuned number gives halved
and doubled.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from classify.base.arrays import BoolArray, FloatMap, Floats, Indices

# The limit of a class grows with this power of its scatter: the distance between two patches does
# with power 0.7 to 1, the distance to other classes does not.
_SCATTER_POWER = 0.4
# Differences from day to day do not depend on the scatter of a class: sheets of corrugated steel,
# of scatter 0.2, are at 1.2 to 1.8 from their class with another rig and focus. See "When a
# surface is unknown" in classify/DECISIONS.md for what this gives.
_LEAST_SCATTER = 0.5
# The largest factor of the 22 materials. Quarters of a part with a figure in one of them differ
# more than textures do (test_a_class_with_a_figure_in_a_corner...).
_LARGEST_FACTOR = 1.5
# Median distance of another patch to a class of scatter 1, and standard deviations of its logarithm
# between classes of equal scatter and between patches of one class, together 0.43. On 22 scanned
# materials the median is 0.84 and the deviation 0.53; joint_constants.py prints what larger
# ones accept. A limit is the 99th percentile, 2.33 deviations above the median.
_MEDIAN = 0.82
_CLASS_SPREAD = 0.34
_PATCH_SPREAD = 0.26
_DEVIATIONS = 2.33
# Mean and standard deviation of the least of one, two and three normal numbers. More sets count as
# three: they seldom show as many independent patches.
_LEAST_NORMAL = ((0.0, 1.0), (-0.564, 0.826), (-0.846, 0.748))
# Below this side the limit falls with the eighth root of the side, by 8 % at 128 px: smaller frames
# distinguish textures less well.
_SUFFICIENT_PX = 256
# Most sets of one class, and most references of lowest bound, that are compared: more would take
# minutes and change little.
_MAX_SETS = 200
_MAX_REFERENCES = 256


def scatter_factor(distances: Floats) -> float:
    """Factor of the limit of a class, from distances between the quarters of a set."""
    scatter = max(float(distances.mean()), _LEAST_SCATTER)
    return float(min(scatter**_SCATTER_POWER, _LARGEST_FACTOR))


def unit_limit(pixels: float) -> float:
    """Limit of a class of scatter 1 with one set, for frames of that many pixels."""
    limit = _MEDIAN * math.exp(_DEVIATIONS * math.hypot(_CLASS_SPREAD, _PATCH_SPREAD))
    return float(limit * min(pixels / _SUFFICIENT_PX**2, 1.0) ** (1 / 16))


def limit_of_sets(limit: float, distances: Sequence[float]) -> float:
    """Limit of a class of several sets, from the distance of each to the others.

    A distance more than two standard deviations below the expected median (sets of one patch) is
    left out; the limit is at most the 99th percentile of the smallest of as many distances.
    """
    spread = math.hypot(_CLASS_SPREAD, _PATCH_SPREAD)
    expected = math.log(limit) - _DEVIATIONS * spread
    logs = [math.log(value) for value in distances if value > math.exp(expected - 2.0 * spread)]
    if not logs:
        return limit
    nearest, deviation = _LEAST_NORMAL[min(len(logs), len(_LEAST_NORMAL)) - 1]
    most = nearest * _PATCH_SPREAD + _DEVIATIONS * math.hypot(
        _CLASS_SPREAD, deviation * _PATCH_SPREAD
    )
    trust = 1.0 - 1.0 / (1.0 + len(logs) * (_CLASS_SPREAD / _PATCH_SPREAD) ** 2)
    above = trust * sum(max(value - expected, -spread) for value in logs) / len(logs)
    remaining = math.hypot(_CLASS_SPREAD * math.sqrt(1.0 - trust), _PATCH_SPREAD)
    return math.exp(expected + min(above + _DEVIATIONS * remaining, most))


def class_limits(
    labels: Sequence[str],
    sets: Sequence[int],
    single: FloatMap,
    lower_bounds: Callable[[int, Indices], Floats],
    nearest: Callable[[int, Indices], float],
) -> dict[str, float]:
    """Limit of each class, at most the distance to the nearest other class."""
    numbers, classes = np.array(sets), np.array(labels)
    firsts = np.unique(numbers, return_index=True)[1]

    def least(index: int, others: BoolArray) -> float:
        indices = np.flatnonzero(others)
        if len(indices) > _MAX_REFERENCES:
            lowest = np.argpartition(lower_bounds(index, indices), _MAX_REFERENCES)
            indices = indices[lowest[:_MAX_REFERENCES]]
        return nearest(index, indices) if len(indices) else math.inf

    limits = {}
    for label in dict.fromkeys(labels):
        same = classes == label
        own = firsts[same[firsts]][:_MAX_SETS]
        within = [least(i, same & (numbers != numbers[i])) for i in own] if len(own) > 1 else []
        between = min(least(i, ~same) for i in own)
        typical = limit_of_sets(float(single[own].mean()), within)
        limits[label] = min(typical, between)
    return limits
