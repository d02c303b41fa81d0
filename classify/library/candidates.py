"""Few comparisons in a large library: what cannot be nearest is passed over."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from classify.classifiers import Comparison
from classify.compiling import FAST
from classify.surface.estimate import FloatMap

__all__ = ["COMPARED_AT_ONCE", "Sieve"]

COMPARED_AT_ONCE = 1024
"""A library of up to so many references is compared as a whole: a sieve would gain nothing."""

_FIRST = 64
_MOST = 4096
# Error of the numbers in single precision, and of their sums, relative to all of them together.
_ROUNDING = np.float32(2e-6)

Array = npt.NDArray[Any]
Indices = npt.NDArray[np.intp]
Bounds = npt.NDArray[np.float64]


class Sieve:
    """Bounds from below on the distance to every reference, from numbers that no turn changes.

    Parameters
    ----------
    invariants
        (n, k + 1) float32: k numbers, and one that only counts in a test, as a divisor. The squared
        Euclidean distance of k numbers, over that divisor, is never above the distance.
    labels
        (n,) class of each reference.
    """

    def __init__(self, invariants: FloatMap, labels: Sequence[str]) -> None:
        self.invariants = invariants
        numbers: dict[str, int] = {}
        self._classes = np.array([numbers.setdefault(label, len(numbers)) for label in labels])

    def bounds(self, invariants: FloatMap) -> Bounds:
        """(n,) bounds on the distances of a test with the invariants (k + 1,)."""
        bounds = np.empty(len(self.invariants), np.float64)
        _bounds(self.invariants, invariants, bounds)
        # A number that is none bounds nothing.
        return np.fmax(bounds, 0.0, out=bounds)

    def nearest(
        self, invariants: FloatMap, compare: Callable[[Indices], Comparison]
    ) -> tuple[Indices, Comparison]:
        """Indices, rising, of all references that may be the nearest or the runner-up, compared.

        A few of the lowest bounds, of two classes or more, are compared first. Whatever has a
        bound above the distance of the best of them cannot be the nearest; nor the runner-up, if
        it is of the class of the best or has a bound above the distance of the best of another.
        The rest is compared, lowest bounds first, up to a number that keeps the time bounded.
        """
        bounds = self.bounds(invariants)
        lowest = _lowest(bounds, _FIRST)
        rest = np.flatnonzero(self._classes != self._classes[lowest[0]])
        first = np.union1d(lowest, rest[_lowest(bounds[rest], _FIRST)])
        found = compare(first)
        best = int(np.argmin(found.distances))
        others = self._classes != self._classes[first[best]]
        second_best = found.distances[others[first]].min(initial=np.inf)
        within = bounds <= np.where(others, second_best, found.distances[best])
        within[first] = False
        more = np.flatnonzero(within)
        more = more[_lowest(bounds[more], _MOST)]
        if not len(more):
            return first, found
        indices = np.concatenate([first, more])
        order = np.argsort(indices)
        return indices[order], _joined(found, compare(more), order)


@njit(parallel=True, fastmath=FAST, cache=True, error_model="numpy")
def _bounds(references: Array, test: Array, bounds: Array) -> None:
    """Squared distances, less what rounding may have added, over the divisor."""
    count, numbers = references.shape
    last = numbers - 1
    energy = np.float32(0.0)
    for k in range(last):
        energy += test[k] * test[k]
    # That of the references is not needed: it differs only where the distance is large.
    added = _ROUNDING * np.sqrt(energy)
    for n in prange(count):
        square = np.float32(0.0)
        for k in range(last):
            difference = references[n, k] - test[k]
            square += difference * difference
        distance = np.float64(max(np.sqrt(square) - added, np.float32(0.0)))
        bounds[n] = distance * distance / np.float64(test[last])


def _lowest(values: Bounds, count: int) -> Indices:
    """Indices of so many of the lowest values, in any order; of all, where there are fewer."""
    if len(values) <= count:
        return np.arange(len(values))
    return np.argpartition(values, count)[:count]


def _joined(first: Comparison, second: Comparison, order: Indices) -> Comparison:
    def both(one: Bounds | None, other: Bounds | None) -> Bounds | None:
        return None if one is None or other is None else np.concatenate([one, other])[order]

    return Comparison(
        np.concatenate([first.distances, second.distances])[order],
        both(first.orientations_deg, second.orientations_deg),
        both(first.sharpness, second.sharpness),
        both(first.headings, second.headings),
    )
