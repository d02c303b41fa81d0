"""Few comparisons in a large library: what cannot be nearest is passed over."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from .classifiers import Comparison
from .surface import FloatMap

__all__ = ["COMPARED_AT_ONCE", "Sieve"]

COMPARED_AT_ONCE = 1024
"""A library of up to so many references is compared as a whole: a sieve would gain nothing."""

_FIRST = 64
_MOST = 4096
# What single precision may add to the square of a difference, relative to those of its terms.
_ROUNDING = 2e-6

Indices = npt.NDArray[np.intp]
Bounds = npt.NDArray[np.float64]


class Sieve:
    """Bounds from below on the distance to every reference, from numbers that no turn changes.

    Parameters
    ----------
    invariants
        (n, k + 1) float32: k numbers and a divisor of distances. The squared Euclidean distance of
        two rows of k, over both divisors, is never above the distance.
    labels
        (n,) class of each reference.
    """

    def __init__(self, invariants: FloatMap, labels: Sequence[str]) -> None:
        self.invariants = invariants
        self._vectors = invariants[:, :-1]
        self._divisors = invariants[:, -1].astype(np.float64)
        self._energies = np.einsum("nk,nk->n", self._vectors, self._vectors, dtype=np.float64)
        numbers: dict[str, int] = {}
        self._classes = np.array([numbers.setdefault(label, len(numbers)) for label in labels])

    def bounds(self, invariants: FloatMap) -> Bounds:
        """(n,) bounds on the distances of a test with the invariants (k + 1,)."""
        vector = invariants[:-1]
        energies = self._energies + float(vector @ vector)
        squares = (1.0 - _ROUNDING) * energies - 2.0 * (self._vectors @ vector)
        # A number that is none bounds nothing.
        bounds: Bounds = np.fmax(squares / (self._divisors * float(invariants[-1])), 0.0)
        return bounds

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
        both(first.turns_deg, second.turns_deg),
        both(first.sharpness, second.sharpness),
    )
