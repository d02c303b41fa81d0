"""The few references of a large library that can be the nearest or the runner-up."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from classify.base.arrays import Floats, Indices
from classify.classifiers import Comparison

# References of the lowest bounds that are compared first, and then as many of other classes.
FIRST = 64
# Largest number of references compared after that, which bounds the time. On 100,000 references the
# nearest is among them in 99.9 % of queries (``tests.evidence.benchmark``).
MOST = 4096


def nearest_references(
    classes: npt.NDArray[np.integer], bounds: Floats, compare: Callable[[Indices], Comparison]
) -> tuple[Indices, Comparison]:
    """Compare all references that may be the nearest or runner-up, `MOST` at most.

    The lowest bounds are compared first. With d1 the smallest distance, to class c, and d2 the
    smallest to another class, references of c with a bound of at most d1, and others with a bound
    of at most d2, are compared too; indices rise.
    """
    # NaN, which a mapped file may contain, gives no bound.
    bounds = np.fmax(bounds, 0.0)
    lowest = _lowest(bounds, FIRST)
    rest = np.flatnonzero(classes != classes[lowest[0]])
    first = np.union1d(lowest, rest[_lowest(bounds[rest], FIRST)])
    found = compare(first)
    best = int(np.argmin(found.distances))
    others = classes != classes[first[best]]
    second_best = found.distances[others[first]].min(initial=np.inf)
    within = bounds <= np.where(others, second_best, found.distances[best])
    within[first] = False
    more = np.flatnonzero(within)
    more = more[_lowest(bounds[more], MOST)]
    if not len(more):
        return first, found
    indices = np.concatenate([first, more])
    order = np.argsort(indices)
    return indices[order], _joined(found, compare(more), order)


def _lowest(values: Floats, count: int) -> Indices:
    """Indices of the `count` lowest values, in any order; of all if there are fewer."""
    if len(values) <= count:
        return np.arange(len(values))
    return np.argpartition(values, count)[:count]


def _joined(first: Comparison, second: Comparison, order: Indices) -> Comparison:
    def both(one: Floats | None, other: Floats | None) -> Floats | None:
        return None if one is None or other is None else np.concatenate([one, other])[order]

    return Comparison(
        np.concatenate([first.distances, second.distances])[order],
        both(first.orientations_deg, second.orientations_deg),
        both(first.sharpness, second.sharpness),
        both(first.headings, second.headings),
        both(first.blurs_px, second.blurs_px),
    )
