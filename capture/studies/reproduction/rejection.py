"""Scores that tell a known texture from an unknown one, to be compared with each other.

Each is a number that is to be low for a texture that was learned and high for any other. All but
the last come from the joint classifier.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from classify import SurfaceEstimate, TextureLibrary
from classify.classifiers import classifier_named
from classify.classifiers.joint import STATISTICS
from classify.surface.estimate import FloatMap

__all__ = ["SCORES", "References", "ScorePair", "distance_pair", "quartered", "without"]

SCORES: Mapping[str, str] = {
    "scatter": "joint distance, over the scatter of each class",
    "plain": "joint distance, one limit for all classes",
    "extreme": "quarters, extreme-value fit of each class",
    "votes": "votes of four quarters",
    "local": "local statistics alone",
    "spectra": "polar spectra alone",
    "thesis": "2D spectra of the thesis",
}

_EULER = 0.5772156649015329
_LEAST_SCALE = 1e-3

Distances = npt.NDArray[np.float64]


class ScorePair(NamedTuple):
    """Of one test: its score, and what it would be had its texture not been learned.

    For that the references of its class are left out. What was learned from all classes
    together, floors and whitening, stays as it is.
    """

    known: float
    unknown: float


def quartered(surface: SurfaceEstimate) -> list[SurfaceEstimate]:
    """The four quarters of a surface as surfaces of their own."""
    rows, columns = (side // 2 for side in surface.shape)
    corners = [(row, column) for row in (0, rows) for column in (0, columns)]
    maps = {
        each.name: values
        for each in fields(surface)
        if isinstance(values := getattr(surface, each.name), np.ndarray)
    }
    quarters = []
    for row, column in corners:
        cut = np.s_[..., row : row + rows, column : column + columns]
        parts: dict[str, Any] = {
            name: np.ascontiguousarray(values[cut]) for name, values in maps.items()
        }
        quarters.append(replace(surface, **parts))
    return quarters


def without(library: TextureLibrary, label: str) -> TextureLibrary:
    """The library as if it had never seen a class, but for what it learned from all together."""
    kept = [index for index, other in enumerate(library.labels) if other != label]
    return replace(
        library,
        labels=tuple(library.labels[index] for index in kept),
        orientations_deg=library.orientations_deg[kept],
        signatures=library.signatures[kept],
    )


def distance_pair(signature: FloatMap, label: str, library: TextureLibrary) -> ScorePair:
    """The distance to the nearest class as a score, of any classifier."""
    return _pair(_by_class(_distances(signature, library), library), library, label)


@dataclass(frozen=True, eq=False)
class References:
    """A joint library, and another that has learned the quarters of the same sets."""

    whole: TextureLibrary
    quarters: TextureLibrary

    def score_pairs(
        self, surface: SurfaceEstimate, signature: FloatMap, label: str
    ) -> dict[str, ScorePair]:
        """Scores of a test, a surface and its signature, whose true class is `label`."""
        library = self.whole
        plain = _distances(signature, library) * signature[-1]
        local = np.square(library.signatures[:, STATISTICS] - signature[STATISTICS]).sum(axis=1)
        by_score = {"plain": plain, "local": local, "spectra": plain - local}
        pairs = {
            name: _pair(_by_class(values, library), library, label)
            for name, values in by_score.items()
        }
        rooms = np.array([library.signatures[own[0], -1] for own in _members(library)])
        pairs["scatter"] = _pair(_by_class(plain, library), library, label, rooms)
        signatures = [self.quarters.observe(quarter) for quarter in quartered(surface)]
        distances = np.stack([_distances(each, self.quarters) for each in signatures])
        location, scale = self._extremes
        means = np.array([distances[:, own].mean() for own in _members(self.quarters)])
        pairs["extreme"] = _pair((means - location) / scale, self.quarters, label)
        nearest = np.stack([_by_class(row, self.quarters) for row in distances])
        others = np.delete(nearest, self.quarters.classes.index(label), axis=1)
        pairs["votes"] = ScorePair(_votes(nearest), _votes(others))
        return pairs

    @cached_property
    def _extremes(self) -> tuple[Distances, Distances]:
        """Location and scale of the distances within each class: a Gumbel law, by its moments.

        The law of largest values stands for that of the distance to what is the same texture
        (after Scheirer et al. 2011, who fit the tail of the scores of matches).
        """
        library = self.quarters
        moments = []
        for own in _members(library):
            within = [
                _distances(library.signatures[index], library)[own[number + 1 :]]
                for number, index in enumerate(own)
            ]
            joined = np.concatenate(within)
            moments.append((joined.mean(), joined.std()))
        mean, spread = np.array(moments).T
        scale = np.maximum(spread * np.sqrt(6.0) / np.pi, _LEAST_SCALE)
        return mean - _EULER * scale, scale


def _distances(signature: FloatMap, library: TextureLibrary) -> Distances:
    """To each reference."""
    how = classifier_named(library.classifier)
    return how.compare(signature, library.signatures, library.parameters).distances


def _members(library: TextureLibrary) -> list[npt.NDArray[np.intp]]:
    """Indices of the references of each class."""
    labels = np.array(library.labels)
    return [np.flatnonzero(labels == label) for label in library.classes]


def _by_class(distances: Distances, library: TextureLibrary) -> Distances:
    """(classes,) distance to the nearest reference of each."""
    return np.array([distances[own].min() for own in _members(library)])


def _pair(
    by_class: Distances, library: TextureLibrary, label: str, rooms: Distances | float = 1.0
) -> ScorePair:
    """The distance of the nearest class over the room of that class, with and without `label`."""
    scores = by_class / rooms
    others = np.arange(len(by_class)) != library.classes.index(label)
    return ScorePair(
        float(scores[by_class.argmin()]), float(scores[others][by_class[others].argmin()])
    )


def _votes(distances: Distances) -> float:
    """Votes that the winner of (quarters, classes) lacks; between equals their mean distance."""
    voted = distances.argmin(axis=1)
    outcomes = []
    for candidate in set(voted.tolist()):
        voters = voted == candidate
        mean = float(distances[voters, candidate].mean())
        outcomes.append(len(distances) - int(voters.sum()) + mean / (1.0 + mean))
    return min(outcomes)
