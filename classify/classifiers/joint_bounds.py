"""Lower bounds on the distances of the joint classifier, from numbers that no rotation changes.

A reference and its changes by blur are a path through points. The path is projected on a few
directions, in which all references of a library change most, and its distance from these is kept.
The distance to the projected path less that of the path from its projection is a bound.
"""

from functools import partial

import numpy as np
import numpy.typing as npt

from classify.compiling import Array, kernel
from classify.surface.estimate import FloatMap
from classify.texture.blur import KNOTS_PX2, least_over_blur
from classify.threads import run_on_rows

from .classifier import Bounds, Parameters

BLUR_BASIS = "blur_basis"
"""Parameter with the directions; a library without it was trained before blur was estimated."""

RING_DIRECTIONS, LOCAL_DIRECTIONS = 6, 10
"""Directions of rings and of statistics.

On 100,000 references (``ps4rig bench``) half as many double the number that are compared.
"""

# Relative error of the norm of the difference of two vectors of single precision.
_ROUNDING = np.float32(2e-6)


def blur_basis(curves: FloatMap, rings: int) -> npt.NDArray[np.float64]:
    """(16, d) orthonormal directions of the largest changes, of rings first, then of statistics.

    `curves` are the (n, 3, d) changes of all training sets. Few sets give fewer directions; the
    others are 0.
    """
    changes = curves.reshape(-1, curves.shape[-1]).astype(np.float64)
    basis = np.zeros((RING_DIRECTIONS + LOCAL_DIRECTIONS, changes.shape[1]))
    for first, count, part in (
        (0, RING_DIRECTIONS, np.s_[:rings]),
        (RING_DIRECTIONS, LOCAL_DIRECTIONS, np.s_[rings:]),
    ):
        directions = np.linalg.svd(changes[:, part], full_matrices=False)[2][:count]
        basis[first : first + len(directions), part] = directions
    return basis


def blur_coordinates(
    levels: FloatMap, curves: FloatMap, basis: npt.NDArray[np.float64], rings: int
) -> FloatMap:
    """(n, 4 m + 1): features on m directions, their changes, the distance of path and projection.

    `levels` (n, d) and `curves` (n, 3, d) are those of `least_over_blurs`.
    """
    directions = basis.astype(np.float32)
    coordinates = levels @ directions.T
    changes = curves @ directions.T
    rest = curves - changes @ directions
    squares = np.square(rest).sum(axis=2)
    extrapolated = (KNOTS_PX2[1] / KNOTS_PX2[0]) ** 2 * np.square(rest[:, 0, rings:]).sum(axis=1)
    reach = np.sqrt(np.maximum(squares.max(axis=1), extrapolated))
    return np.concatenate([coordinates, changes.reshape(len(levels), -1), reach[:, None]], axis=1)


def bounds(test: FloatMap, references: FloatMap, parameters: Parameters) -> Bounds:
    """(n,) bounds on the distances of the test with the invariants (k + 1,) to n references."""
    size = RING_DIRECTIONS + LOCAL_DIRECTIONS if BLUR_BASIS in parameters else 0
    plain = references.shape[1] - 1 - (4 * size + 1 if size else 0)
    paths = []
    for rows in (test[None], references):
        numbers = rows[:, plain:-1]
        changes = numbers[:, size : 4 * size].reshape(len(rows), len(KNOTS_PX2), size)
        reach = numbers[:, -1] if size else np.zeros(len(rows), np.float32)
        paths.append((numbers[:, :size], changes, reach))
    (own, curve, own_reach), (others, curves, reach) = paths
    found = np.empty(len(references), np.float64)
    plain_numbers = (test[:plain], references[:, :plain])
    path = (own[0], curve[0], others, curves, own_reach[0] + reach)
    run_on_rows(partial(_bounds, *plain_numbers, *path, test[-1], found), references.shape)
    return found


@kernel
def _bounds(
    test: Array, references: Array, own: Array, curve: Array, others: Array, curves: Array,
    reach: Array, divisor: np.float32, bounds: Array, first: int, stop: int,
) -> None:  # fmt: skip
    """Squared distances to the paths, less reach and rounding error, over the divisor."""
    zero = np.float32(0.0)
    energy = zero
    for k in range(len(test)):
        energy += test[k] * test[k]
    # The energy of a reference differs from the test's only where the distance is large.
    rounding = _ROUNDING * np.sqrt(energy)
    count = len(test) // 4 * 4
    for n in range(first, stop):
        # Four sums, because one addition has to wait for the one before.
        s0, s1, s2, s3 = zero, zero, zero, zero
        for k in range(0, count, 4):
            d0, d1 = references[n, k] - test[k], references[n, k + 1] - test[k + 1]
            d2, d3 = references[n, k + 2] - test[k + 2], references[n, k + 3] - test[k + 3]
            s0 += d0 * d0
            s1 += d1 * d1
            s2 += d2 * d2
            s3 += d3 * d3
        for k in range(count, len(test)):
            s0 += (references[n, k] - test[k]) ** 2
        square = s0 + s1 + s2 + s3
        across = square - _ROUNDING * square
        for k in range(len(own)):
            across -= (others[n, k] - own[k]) ** 2
        along, _ = least_over_blur(own, curve, others[n], curves[n], RING_DIRECTIONS, zero)
        distance = np.sqrt(max(across + along, zero)) - rounding - reach[n]
        bounds[n] = np.float64(max(distance, zero)) ** 2 / np.float64(divisor)
