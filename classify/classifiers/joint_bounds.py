"""Lower bounds on the distances of the joint classifier.

They follow from numbers that rotations do not change. A reference and its changes by blur form a
path in feature space. Each change is split into its components along the few directions in which
the references of a library change most, and a remainder, of which only the length is kept. Along
these directions a bound is exact. Across them a change brings a reference nearer by at most the
length of its remainder (triangle inequality).
"""

from functools import partial

import numpy as np

from classify.base.arrays import Array, FloatMap, Floats
from classify.base.compiling import kernel
from classify.base.threads import run_on_rows
from classify.texture.blur import EXTRAPOLATION, KNOTS_PX2, blur_penalty, min_on_path, path_products

from . import Parameters
from .joint_features import SERIES

BLUR_BASIS = "blur_basis"
"""Parameter with the directions; a library without it was trained before blur was estimated."""

RING_DIRECTIONS, LOCAL_DIRECTIONS = 6, 10
"""Number of directions of rings and of statistics.

On 30,000 references mixed as in ``tests.evidence.benchmark``, 90 % of the queries compare at most
119 references. With 10 and 24 directions it is 75, but the bounds take 20 % longer.
"""

# Relative error of the norm of the difference of two vectors of single precision.
_ROUNDING = np.float32(2e-6)


def blur_basis(curves: FloatMap) -> Floats:
    """(16, d) orthonormal directions of the largest of (n, 3, d) changes; rings first, then 0."""
    changes = curves.reshape(-1, curves.shape[-1]).astype(np.float64)
    basis = np.zeros((RING_DIRECTIONS + LOCAL_DIRECTIONS, changes.shape[1]))
    for first, count, part in (
        (0, RING_DIRECTIONS, np.s_[:SERIES]),
        (RING_DIRECTIONS, LOCAL_DIRECTIONS, np.s_[SERIES:]),
    ):
        directions = np.linalg.svd(changes[:, part], full_matrices=False)[2][:count]
        basis[first : first + len(directions), part] = directions
    return basis


def blur_coordinates(features: FloatMap, curves: FloatMap, basis: Floats) -> FloatMap:
    """(n, 4 m + 6) features and changes along m directions, and lengths of the remainders."""
    # Three lengths are of whole changes, by knot. The others are for a sharper test, see
    # `path_products`: of the statistics at the first knot, of the rings at the first two.
    directions = basis.astype(np.float32)
    coordinates = features @ directions.T
    changes = curves @ directions.T
    remainders = np.square(curves - changes @ directions)
    squares = [
        remainders.sum(axis=2),
        remainders[:, :1, SERIES:].sum(axis=2),
        remainders[:, :2, :SERIES].sum(axis=2),
    ]
    lengths = np.sqrt(np.concatenate(squares, axis=1))
    return np.concatenate([coordinates, changes.reshape(len(features), -1), lengths], axis=1)


def bounds(test: FloatMap, references: FloatMap, parameters: Parameters) -> Floats:
    """(n,) lower bounds on the distances from a test, with (k,) invariants, to n references."""
    # Invariants: ring means, norms of the other harmonics, statistics; blur coordinates; factor.
    count = 2 * SERIES + len(parameters["whitening"])
    test_path = (rows[0] for rows in _paths(test[None, count:-1]))
    paths = (*test_path, *_paths(references[:, count:-1]))
    penalty = blur_penalty(float(parameters["pixels"]))
    lower_bounds = np.empty(len(references), np.float64)
    bound_rows = partial(
        _bounds, SERIES, test[:count], references, *paths, penalty, test[-1], lower_bounds
    )
    run_on_rows(bound_rows, references.shape)
    return lower_bounds


def _paths(coordinates: FloatMap) -> tuple[FloatMap, FloatMap, FloatMap]:
    """Split `blur_coordinates` into features, changes by knot, and lengths."""
    size = RING_DIRECTIONS + LOCAL_DIRECTIONS
    changes = coordinates[:, size : 4 * size].reshape(len(coordinates), len(KNOTS_PX2), size)
    return coordinates[:, :size], changes, coordinates[:, 4 * size :]


@kernel
def _bounds(
    series: int, test: Array, references: Array,
    test_features: Array, test_changes: Array, test_lengths: Array,
    features: Array, changes: Array, lengths: Array,
    penalty: np.float32, divisor: np.float32, bounds: Array, first: int, stop: int,
) -> None:  # fmt: skip
    """Squared distances to the paths, less rounding errors, over the divisor."""
    zero = np.float32(0.0)
    energy = zero
    for k in range(len(test)):
        energy += test[k] * test[k]
    # The energy of a reference differs from the test's only where the distance is large.
    rounding = _ROUNDING * np.sqrt(energy)
    for n in range(first, stop):
        reference, length = references[n], lengths[n]
        directional = _square(test, reference, series, 2 * series)
        across = _square(test, reference, 0, series)
        across += _square(test, reference, 2 * series, len(test))
        across -= _ROUNDING * across
        for k in range(len(test_features)):
            across -= (features[n, k] - test_features[k]) ** 2
        # Least distance across the directions at each corner of the path.
        r2 = np.sqrt(max(across, zero))
        r0 = r2 - test_lengths[5] - np.float32(EXTRAPOLATION) * length[3]
        r1 = r2 - test_lengths[4] - length[3]
        r3, r4, r5 = r2 - length[0], r2 - length[1], r2 - length[2]
        s, p = path_products(test_features, test_changes, features[n], changes[n], RING_DIRECTIONS)
        if min(r0, r1, r3, r4, r5) > zero:
            squares = (
                s[0] + r0 * r0, s[1] + r1 * r1, s[2] + r2 * r2,
                s[3] + r3 * r3, s[4] + r4 * r4, s[5] + r5 * r5,
            )  # fmt: skip
            products = (
                p[0] + r0 * r1,
                p[1] + r1 * r2,
                p[2] + r2 * r3,
                p[3] + r3 * r4,
                p[4] + r4 * r5,
            )
            minimum, _ = min_on_path(squares, products, penalty)
        else:
            minimum, _ = min_on_path(s, p, penalty)
        distance = np.sqrt(max(directional + minimum, zero)) - rounding
        bounds[n] = np.float64(max(distance, zero)) ** 2 / np.float64(divisor)


@kernel
def _square(test: Array, reference: Array, start: int, stop: int) -> np.float32:
    """Squared distance over `start` to `stop`, by four independent sums."""
    s0, s1, s2, s3 = np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
    last = start + (stop - start) // 4 * 4
    for k in range(start, last, 4):
        d0, d1 = reference[k] - test[k], reference[k + 1] - test[k + 1]
        d2, d3 = reference[k + 2] - test[k + 2], reference[k + 3] - test[k + 3]
        s0 += d0 * d0
        s1 += d1 * d1
        s2 += d2 * d2
        s3 += d3 * d3
    for k in range(last, stop):
        s0 += (reference[k] - test[k]) ** 2
    return s0 + s1 + s2 + s3
