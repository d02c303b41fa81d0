"""How far windows of a part are from the good windows that look most like them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from classify.base.arrays import Indices
from classify.surface.estimate import FloatMap

# Good windows that are kept for each compared feature, and at most: half of them at random, so that
# common ones have many, and half of them by their distance from all others, so that rare ones have
# one. With 150 instead of 400 windows of 4 features twice as many holes of 80 px passed.
_CENTRES_PER_FEATURE, _MOST_CENTRES = 100, 1000
# Good windows whose differences from their look-alikes give the whitening, in rounds.
_PAIRS, _ROUNDS = 1500, 2
# Share of the variance of each feature that is added to it; more where few windows measure it.
_RIDGE = 0.05
_LEAST_VARIANCE = 1e-6
# Number of good windows that the mean spread counts as beside those of one centre.
_PRIOR_WINDOWS = 10.0
_SEED = 1


@dataclass(frozen=True, eq=False)
class LookAlikes:
    """Good windows of one size, whitened so that look-alikes of two parts differ by about 1.

    Attributes
    ----------
    whitening
        (FEATURES, d) float32.
    centres
        (k, d) float32 good windows.
    spreads
        (k,) float32 mean squared distance of good windows of other parts from each of them. A place
        where good parts differ more, as a joint between bricks, excuses only its look-alikes.
    """

    whitening: FloatMap
    centres: FloatMap
    spreads: FloatMap

    @classmethod
    def of(cls, windows: Sequence[FloatMap], columns: Sequence[int]) -> tuple[Self, list[FloatMap]]:
        """Learn from the (n, FEATURES) windows of each good part, by the given features.

        Returns the model, and the scores of each part by the windows of the others.
        """
        features = np.concatenate(windows)
        chosen = features[:, columns]
        parts = np.repeat(np.arange(len(windows)), [len(each) for each in windows])
        order = np.random.default_rng(_SEED).permutation(len(features))
        whitening = _whitening(chosen, parts, order)
        kept = _spread_out(chosen @ whitening, order)
        found = _Found.of(chosen @ whitening, parts, kept)
        scores: list[FloatMap] = [np.zeros(0, np.float32)] * len(windows)
        for half in (0, 1):
            # The differences of a part must not have shaped the space in which it is scored; two
            # parts are needed for a difference.
            others = order[parts[order] % 2 != half] if len(windows) > 3 else order
            other = _whitening(chosen, parts, others)
            left_out = _Found.of(chosen @ other, parts, kept)
            for part in range(half, len(windows), 2):
                scores[part] = left_out.scores_of(part)
        rows = np.zeros((features.shape[1], len(columns)), np.float32)
        rows[list(columns)] = whitening
        return cls(rows, (chosen @ whitening)[kept], found.spreads()), scores

    def scores(self, features: FloatMap) -> FloatMap:
        """(n,) squared distances of (n, FEATURES) windows, in units of the spread there."""
        n, squares = _nearest(features @ self.whitening, self.centres)
        return np.asarray(squares / self.spreads[n], np.float32)


@dataclass(frozen=True, eq=False)
class _Found:
    """Index and squared distance of the look-alike of every window of each part."""

    nearest: list[Indices]
    squares: list[FloatMap]
    centres: int

    @classmethod
    def of(cls, white: FloatMap, parts: Indices, kept: Indices) -> Self:
        found = [
            _nearest(white[parts == part], white[kept], parts[kept] != part)
            for part in range(int(parts.max()) + 1)
        ]
        return cls([n for n, _ in found], [squares for _, squares in found], len(kept))

    def spreads(self, without: int | None = None) -> FloatMap:
        """Mean squared distance of the windows from each centre; one part may be left out."""
        used = [part for part in range(len(self.nearest)) if part != without]
        n = np.concatenate([self.nearest[part] for part in used])
        squares = np.concatenate([self.squares[part] for part in used])
        sums, counts = (np.bincount(n, each, self.centres) for each in (squares, np.ones(len(n))))
        prior = _PRIOR_WINDOWS * squares.mean()
        spreads = (sums + prior) / (counts + _PRIOR_WINDOWS)
        return np.asarray(np.maximum(spreads, _LEAST_VARIANCE), np.float32)

    def scores_of(self, part: int) -> FloatMap:
        """Scores of the windows of a part by the spreads of the others."""
        return np.asarray(self.squares[part] / self.spreads(part)[self.nearest[part]], np.float32)


def _whitening(features: FloatMap, parts: Indices, order: Indices) -> FloatMap:
    """(d, d) matrix in whose space windows and their look-alikes of other parts differ by 1."""
    kept, pairs = order[:_MOST_CENTRES], order[-_PAIRS:]
    whitening = np.diag(1.0 / (features.std(axis=0) + 1e-3)).astype(np.float32)
    for _ in range(_ROUNDS):
        centres, differences = features[kept] @ whitening, []
        for part in np.unique(parts[pairs]):
            own = pairs[parts[pairs] == part]
            n, _ = _nearest(features[own] @ whitening, centres, parts[kept] != part)
            differences.append((features[own] - features[kept][n]).astype(np.float64))
        rows = np.concatenate(differences)
        covariance = rows.T @ rows / len(rows)
        ridge = max(_RIDGE, len(covariance) / len(rows))
        covariance += np.diag(ridge * np.diag(covariance) + _LEAST_VARIANCE)
        values, vectors = np.linalg.eigh(covariance)
        whitening = (vectors / np.sqrt(values)).astype(np.float32)
    return whitening


def _spread_out(white: FloatMap, order: Indices) -> Indices:
    """Indices of the kept windows; see `_MOST_CENTRES`."""
    most = min(_CENTRES_PER_FEATURE * white.shape[1], _MOST_CENTRES)
    if len(white) <= most:
        return order
    kept = order[: most // 2].tolist()
    squares = np.square(white).sum(axis=1)
    blocks = (white[start : start + 4096] for start in range(0, len(white), 4096))
    distances = np.concatenate([_nearest(block, white[kept])[1] for block in blocks])
    while len(kept) < most:
        kept.append(int(distances.argmax()))
        last = white[kept[-1]]
        np.minimum(distances, squares - 2.0 * (white @ last) + squares[kept[-1]], out=distances)
        distances[kept[-1]] = 0.0
    return np.array(kept)


def _nearest(
    white: FloatMap, centres: FloatMap, allowed: npt.NDArray[np.bool_] | None = None
) -> tuple[Indices, FloatMap]:
    """Index and squared distance of the nearest (allowed) centre of each window."""
    lengths = np.square(centres).sum(axis=1)
    if allowed is not None:
        lengths = np.where(allowed, lengths, np.float32(np.inf))
    squares = white @ (-2.0 * centres.T)
    squares += lengths
    nearest = squares.argmin(axis=1)
    least = squares[np.arange(len(white)), nearest] + np.square(white).sum(axis=1)
    return nearest, np.maximum(least, 0.0)
