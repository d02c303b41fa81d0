"""Scores that tell a known texture from an unknown one, to be compared with each other.

Each is a number that is to be low for a texture that was learned and high for any other. All but
the last come from the joint classifier's signatures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from classify import TextureLibrary
from classify.classifiers import Observation, Parameters, classifier_named
from classify.surface import FloatMap

from .plan import OURS

__all__ = [
    "SCORES",
    "References",
    "ScorePair",
    "distance_pair",
    "quarter_library",
    "score_pairs",
    "without",
]

SCORES: Mapping[str, str] = {
    "scatter": "joint distance, over the scatter of each class",
    "plain": "joint distance, one limit for all classes",
    "extreme": "joint distance, extreme-value fit of each class",
    "votes": "votes of four quarters",
    "local": "local statistics alone",
    "spectra": "polar spectra alone",
    "thesis": "2D spectra of the thesis",
}

_QUARTERS = 4
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


@dataclass(frozen=True, eq=False)
class References:
    """A library of one reference a class, in the order of the classes, and its quarters."""

    whole: TextureLibrary
    quarters: TextureLibrary

    @cached_property
    def extremes(self) -> tuple[Distances, Distances]:
        """Location and scale of each class: a Gumbel law by its moments.

        Fitted to the six distances between the quarters of the training set; the law of largest
        values stands for that of the distance to what is the same texture (after Scheirer et al.
        2011, who fit the tail of the match scores).
        """
        how = classifier_named(OURS)
        moments = []
        for index in range(len(self.whole.labels)):
            own = self.quarters.signatures[_QUARTERS * index : _QUARTERS * (index + 1)]
            pairs = [
                how.compare(one, own[number + 1 :], self.quarters.parameters).distances
                for number, one in enumerate(own[:-1])
            ]
            joined = np.concatenate(pairs)
            moments.append((joined.mean(), joined.std()))
        mean, spread = np.array(moments).T
        scale = np.maximum(spread * np.sqrt(6.0) / np.pi, _LEAST_SCALE)
        return mean - _EULER * scale, scale


def quarter_library(library: TextureLibrary, observations: Sequence[Observation]) -> TextureLibrary:
    """The quarters of each training set as references of their own, on the scale of `library`."""
    signatures = [_quarter_signatures(each, library.parameters) for each in observations]
    return replace(
        library,
        labels=tuple(label for label in library.labels for _ in range(_QUARTERS)),
        orientations_deg=np.repeat(library.orientations_deg, _QUARTERS),
        signatures=np.concatenate(signatures),
        segment_px=library.segment_px // 2,
        limits={},
    )


def without(library: TextureLibrary, label: str) -> TextureLibrary:
    """The library as if it had never seen a class, but for what it learned from all together."""
    kept = [index for index, other in enumerate(library.labels) if other != label]
    return replace(
        library,
        labels=tuple(library.labels[index] for index in kept),
        orientations_deg=library.orientations_deg[kept],
        signatures=library.signatures[kept],
    )


def score_pairs(
    observation: Observation, label: str, references: References
) -> dict[str, ScorePair]:
    """Scores of a test whose true class is `label`.

    Parameters
    ----------
    observation
        As for training: with quarters.
    """
    library = references.whole
    own = library.labels.index(label)
    whole = {name: values for name, values in observation.items() if name != "quarters"}
    how = classifier_named(OURS)
    signature = how.signature(whole, library.parameters)
    scaled = how.compare(signature, library.signatures, library.parameters).distances
    plain = scaled * library.signatures[:, -1]
    statistics = slice(-1 - len(library.parameters["whitening"]), -1)
    local = np.square(library.signatures[:, statistics] - signature[statistics]).sum(axis=1)
    location, scale = references.extremes
    scores = {
        "scatter": scaled,
        "plain": plain,
        "extreme": (plain - location) / scale,
        "local": local,
        "spectra": plain - local,
    }
    pairs = {name: _pair(values, own) for name, values in scores.items()}
    quarters = _quarter_distances(observation, references)
    pairs["votes"] = ScorePair(_votes(quarters), _votes(np.delete(quarters, own, axis=1)))
    return pairs


def distance_pair(signature: FloatMap, label: str, library: TextureLibrary) -> ScorePair:
    """The distance to the nearest class as a score, of any classifier."""
    how = classifier_named(library.classifier)
    distances = how.compare(signature, library.signatures, library.parameters).distances
    return _pair(distances, library.labels.index(label))


def _pair(distances: Distances, own: int) -> ScorePair:
    return ScorePair(float(distances.min()), float(np.delete(distances, own).min()))


def _quarter_signatures(observation: Observation, parameters: Parameters) -> FloatMap:
    """(4, ...) signatures of the quarters that a training observation holds."""
    how = classifier_named(OURS)
    quarters = [
        {
            "polar": observation["quarters"][index],
            "curl_density": observation["curl_density"],
            "moments": observation["moments"][index + 1 : index + 2],
            "energies": observation["energies"][index + 1 : index + 2],
        }
        for index in range(_QUARTERS)
    ]
    return np.stack([how.signature(quarter, parameters) for quarter in quarters])


def _quarter_distances(observation: Observation, references: References) -> Distances:
    """(4, classes): from each quarter of a test to the nearest quarter of a class."""
    how = classifier_named(OURS)
    library = references.quarters
    rows = [
        how.compare(signature, library.signatures, library.parameters).distances
        for signature in _quarter_signatures(observation, library.parameters)
    ]
    by_class: Distances = np.reshape(rows, (_QUARTERS, -1, _QUARTERS)).min(axis=2)
    return by_class


def _votes(distances: Distances) -> float:
    """Votes that the winner lacks; between equals the mean distance of its voters decides."""
    voted = distances.argmin(axis=1)
    outcomes = []
    for candidate in set(voted.tolist()):
        voters = voted == candidate
        mean = float(distances[voters, candidate].mean())
        outcomes.append(_QUARTERS - int(voters.sum()) + mean / (1.0 + mean))
    return min(outcomes)
