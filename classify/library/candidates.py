"""The few references of a large library that can be the nearest or the runner-up."""

from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt

from classify.classifiers import Comparison
from classify.compiling import Array, kernel
from classify.surface.estimate import FloatMap
from classify.threads import run_on_rows

# Relative error of the norm of the difference of two vectors of single precision.
_ROUNDING = np.float32(2e-6)

Indices = npt.NDArray[np.intp]
Bounds = npt.NDArray[np.float64]


class Sieve:
    """Lower bounds on the distance to every reference, from orientation-invariant numbers.

    Parameters
    ----------
    invariants
        (n, k + 1) float32; see `Classifier.invariants`.
    class_indices
        (n,) class of each reference.
    first
        References that are compared first, and again of other classes than the nearest of them.
    most
        References that are compared after that at most, which bounds the time. On 100,000
        references the nearest is among them in 99.9 % of queries (``ps4rig bench``).
    """

    def __init__(
        self,
        invariants: FloatMap,
        class_indices: npt.NDArray[np.integer],
        *,
        first: int = 64,
        most: int = 4096,
    ) -> None:
        self._invariants = invariants
        self._classes = class_indices
        self._first = first
        self._most = most

    def bounds(self, invariants: FloatMap) -> Bounds:
        """(n,) bounds on the distances of a test with the invariants (k + 1,)."""
        bounds = np.empty(len(self._invariants), np.float64)
        references = self._invariants
        run_on_rows(partial(_bounds, references, invariants, bounds), references.shape)
        # NaN, which a mapped file may contain, gives no bound.
        return np.fmax(bounds, 0.0, out=bounds)

    def nearest(
        self, invariants: FloatMap, compare: Callable[[Indices], Comparison]
    ) -> tuple[Indices, Comparison]:
        """Compare all references that may be the nearest or the runner-up.

        The references of the lowest bounds, of two classes or more, are compared first. Let d1 be
        their smallest distance, to a reference of class c, and d2 the smallest to any other class.
        References of c whose bound is at most d1 are compared too, and references of other classes
        whose bound is at most d2: lowest bounds first, `most` at most.

        Returns
        -------
        (m,) indices, rising, and the comparison with these references.
        """
        bounds = self.bounds(invariants)
        lowest = _lowest(bounds, self._first)
        rest = np.flatnonzero(self._classes != self._classes[lowest[0]])
        first = np.union1d(lowest, rest[_lowest(bounds[rest], self._first)])
        found = compare(first)
        best = int(np.argmin(found.distances))
        others = self._classes != self._classes[first[best]]
        second_best = found.distances[others[first]].min(initial=np.inf)
        within = bounds <= np.where(others, second_best, found.distances[best])
        within[first] = False
        more = np.flatnonzero(within)
        more = more[_lowest(bounds[more], self._most)]
        if not len(more):
            return first, found
        indices = np.concatenate([first, more])
        order = np.argsort(indices)
        return indices[order], _joined(found, compare(more), order)


@kernel
def _bounds(references: Array, test: Array, bounds: Array, first: int, stop: int) -> None:
    """Squared distances, less the rounding error, over the divisor of the test."""
    last = references.shape[1] - 1
    energy = np.float32(0.0)
    for k in range(last):
        energy += test[k] * test[k]
    # The energy of a reference differs from the test's only where the distance is large.
    rounding = _ROUNDING * np.sqrt(energy)
    for n in range(first, stop):
        square = np.float32(0.0)
        for k in range(last):
            difference = references[n, k] - test[k]
            square += difference * difference
        distance = np.float64(max(np.sqrt(square) - rounding, np.float32(0.0)))
        bounds[n] = distance * distance / np.float64(test[last])


def _lowest(values: Bounds, count: int) -> Indices:
    """Indices of the `count` lowest values, in any order; of all where there are fewer."""
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
