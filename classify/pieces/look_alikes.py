"""Distance of the windows of a part from the nearest good windows, their look-alikes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from classify.base.arrays import Indices
from classify.surface.estimate import FloatMap

# Largest number of centres. Half of them are drawn at random, so that common windows have many
# centres; the other half by farthest-point sampling (Gonzalez 1985), so that rare windows have one.
_MAX_CENTRES = 1000
# Number of pairs of look-alikes whose differences give the whitening, and of rounds of pairing and
# whitening.
_PAIRS, _ROUNDS = 1500, 2
# Ridge on the variances of the features; more where few windows measure them.
_RIDGE = 0.05
_MIN_VARIANCE = 1e-6
# Weight of the mean spread in the spread of one centre, as a number of windows.
_PRIOR_WINDOWS = 10.0
_SEED = 1


@dataclass(frozen=True, eq=False)
class LookAlikes:
    """Good windows of one size, whitened so that look-alikes of two parts differ by about 1."""

    whitening: FloatMap  # (FEATURES, d)
    centres: FloatMap  # (k, d) good windows
    # (k,) mean squared distance of good windows of other parts from each centre. Places where good
    # parts differ more, such as joints between bricks, have a larger spread.
    spreads: FloatMap

    @classmethod
    def of(cls, windows: Sequence[FloatMap], columns: Sequence[int]) -> tuple[Self, list[FloatMap]]:
        """Learn from the (n, FEATURES) windows of good parts.

        Returns the model, and the leave-one-out scores of each part.
        """
        features = np.concatenate(windows)
        compared = features[:, columns]
        parts = np.repeat(np.arange(len(windows)), [len(part) for part in windows])
        order = np.random.default_rng(_SEED).permutation(len(features))
        whitening = _whitening(compared, parts, order)
        centres = _centres(compared @ whitening, order)
        pairs = _Pairs.of(compared @ whitening, parts, centres)
        scores: list[FloatMap] = [np.zeros(0, np.float32)] * len(windows)
        for half in (0, 1):
            # Cross-validation: each half of the parts is scored by a whitening from the other half,
            # which must have two parts or more.
            others = order[parts[order] % 2 != half] if len(windows) > 3 else order
            left_out_whitening = _whitening(compared, parts, others)
            left_out = _Pairs.of(compared @ left_out_whitening, parts, centres)
            for part in range(half, len(windows), 2):
                scores[part] = left_out.scores_of(part)
        rows = np.zeros((features.shape[1], len(columns)), np.float32)
        rows[list(columns)] = whitening
        return cls(rows, (compared @ whitening)[centres], pairs.spreads()), scores

    def scores(self, features: FloatMap) -> FloatMap:
        """(n,) squared distances of (n, FEATURES) windows, divided by the spread of the centre."""
        nearest, squares = _nearest(features @ self.whitening, self.centres)
        return np.asarray(squares / self.spreads[nearest], np.float32)


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Index and squared distance of the look-alike of every window of each part."""

    nearest: list[Indices]
    squares: list[FloatMap]
    centre_count: int

    @classmethod
    def of(cls, whitened: FloatMap, parts: Indices, centres: Indices) -> Self:
        nearest, squares = zip(
            *(
                _nearest(whitened[parts == part], whitened[centres], parts[centres] != part)
                for part in range(int(parts.max()) + 1)
            ),
            strict=True,
        )
        return cls([*nearest], [*squares], len(centres))

    def spreads(self, without: int | None = None) -> FloatMap:
        """Mean squared distance of the windows from each centre; one part may be left out."""
        used = [part for part in range(len(self.nearest)) if part != without]
        nearest = np.concatenate([self.nearest[part] for part in used])
        squares = np.concatenate([self.squares[part] for part in used])
        sums = np.bincount(nearest, squares, self.centre_count)
        counts = np.bincount(nearest, minlength=self.centre_count)
        prior = _PRIOR_WINDOWS * squares.mean()
        spreads = (sums + prior) / (counts + _PRIOR_WINDOWS)
        return np.asarray(np.maximum(spreads, _MIN_VARIANCE), np.float32)

    def scores_of(self, part: int) -> FloatMap:
        """Scores of the windows of a part by the spreads of the others."""
        return np.asarray(self.squares[part] / self.spreads(part)[self.nearest[part]], np.float32)


def _whitening(features: FloatMap, parts: Indices, order: Indices) -> FloatMap:
    """(d, d) matrix in whose space windows and their look-alikes of other parts differ by 1."""
    candidates, pairs = order[:_MAX_CENTRES], order[-_PAIRS:]
    whitening = np.diag(1.0 / (features.std(axis=0) + 1e-3)).astype(np.float32)
    for _ in range(_ROUNDS):
        centres, differences = features[candidates] @ whitening, []
        for part in np.unique(parts[pairs]):
            of_part = pairs[parts[pairs] == part]
            nearest, _ = _nearest(features[of_part] @ whitening, centres, parts[candidates] != part)
            look_alikes = features[candidates][nearest]
            differences.append((features[of_part] - look_alikes).astype(np.float64))
        rows = np.concatenate(differences)
        covariance = rows.T @ rows / len(rows)
        ridge = max(_RIDGE, len(covariance) / len(rows))
        covariance += np.diag(ridge * np.diag(covariance) + _MIN_VARIANCE)
        values, vectors = np.linalg.eigh(covariance)
        whitening = (vectors / np.sqrt(values)).astype(np.float32)
    return whitening


def _centres(whitened: FloatMap, order: Indices) -> Indices:
    """Indices of the windows that become centres; see `_MAX_CENTRES`."""
    if len(whitened) <= _MAX_CENTRES:
        return order
    centres = order[: _MAX_CENTRES // 2].tolist()
    squares = np.square(whitened).sum(axis=1)
    blocks = (whitened[start : start + 4096] for start in range(0, len(whitened), 4096))
    distances = np.concatenate([_nearest(block, whitened[centres])[1] for block in blocks])
    while len(centres) < _MAX_CENTRES:
        farthest = int(distances.argmax())
        centres.append(farthest)
        products = whitened @ whitened[farthest]
        np.minimum(distances, squares - 2.0 * products + squares[farthest], out=distances)
        distances[farthest] = 0.0
    return np.array(centres)


def _nearest(
    whitened: FloatMap, centres: FloatMap, allowed: npt.NDArray[np.bool_] | None = None
) -> tuple[Indices, FloatMap]:
    """Index and squared distance of the nearest (allowed) centre of each window."""
    lengths = np.square(centres).sum(axis=1)
    if allowed is not None:
        lengths = np.where(allowed, lengths, np.float32(np.inf))
    squares = whitened @ (-2.0 * centres.T)
    squares += lengths
    nearest = squares.argmin(axis=1)
    nearest_squares = squares[np.arange(len(whitened)), nearest] + np.square(whitened).sum(axis=1)
    return nearest, np.maximum(nearest_squares, 0.0)
