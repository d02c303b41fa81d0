"""Halves of the good parts, each scored by a model of the other."""

from collections.abc import Sequence

import numpy as np

from .good_cells import PowerSums


def unlike_halves(sums: Sequence[PowerSums]) -> tuple[list[int], list[int]]:
    """Split parts into halves that differ as much as possible.

    Parts of one place or of one batch are alike. If each part is left out alone, the others of its
    place stay in the model, and its departures come out smaller than those of a part of another
    place. The parts are therefore split along the first principal component of the means of their
    statistics.

    Parameters
    ----------
    sums
        `power_sums` of the window statistics of every part, at least two parts.

    Returns
    -------
    The indices of the parts of each half.
    """
    total = np.sum(sums, axis=0)
    total = total / total[0, 0]
    deviations = np.sqrt(np.maximum(np.diag(total)[1:] - total[0, 1:] ** 2, 1e-12))
    means = np.array([each[0, 1:] / each[0, 0] for each in sums]) / deviations
    _, _, components = np.linalg.svd(means - means.mean(axis=0), full_matrices=False)
    order = np.argsort(means @ components[0], kind="stable")
    lower, upper = np.array_split(order, 2)
    return lower.tolist(), upper.tolist()
