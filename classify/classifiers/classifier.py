"""What every classifier does, so that one library, file and evaluation serves them all."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from classify.surface.estimate import FloatMap, SurfaceEstimate

__all__ = ["Classifier", "Comparison", "Observation", "Parameters"]

Observation = Mapping[str, npt.NDArray[Any]]
"""All that a classifier keeps of one surface: plain arrays, cheap to send to another process."""

Parameters = Mapping[str, npt.NDArray[np.float64]]
"""What a classifier learns from all training sets together, such as floors and weights."""


class Comparison(NamedTuple):
    """One signature compared with n references, as (n,) arrays.

    Attributes
    ----------
    distances
        How different they are; 0 equal.
    orientations_deg
        Orientation of the surface relative to the reference, anticlockwise, [0, 180). None where
        the classifier finds no orientation, as are the fields that follow.
    sharpness
        How well the orientation is determined: 0 not at all, 1 exactly.
    headings
        Standard deviations in favour of this orientation against the opposite one (180 degrees
        more); negative where the opposite one fits better, 0 where both do.
    """

    distances: npt.NDArray[np.float64]
    orientations_deg: npt.NDArray[np.float64] | None = None
    sharpness: npt.NDArray[np.float64] | None = None
    headings: npt.NDArray[np.float64] | None = None


def _nothing(_observations: Sequence[Observation], _labels: Sequence[str]) -> Parameters:
    return {}


@dataclass(frozen=True)
class Classifier:
    """A way to tell textures apart, as functions on arrays.

    Attributes
    ----------
    name
        As in ``--classifier NAME``.
    observe
        (surface, segment_px) to what a test is judged by.
    signature
        (observation, parameters) to an array of fixed shape, float32.
    compare
        (test signature, (n, ...) reference signatures, parameters) to a `Comparison`.
    learn
        (observations of all training sets, their labels) to parameters.
    observe_training
        As `observe`, where training looks at more than a test does.
    references
        (training observation, parameters) to (k, ...) signatures, where a set gives several.
    limits
        (label and set of each reference, (n, ...) references, parameters) to the distance, for each
        class, beyond which a surface is none of it; None where a classifier cannot say.
    invariants
        (n, ...) signatures to (n, k + 1): k numbers whose squared Euclidean distance, over the
        last number of the test, is never above the distance. A large library is sifted by them.
    without_heading
        (k, ...) references to the same without a heading; None where they have none.
    from_images
        Whether it looks at images rather than at the surface: then a set under another lighting
        is another thing.
    """

    name: str
    observe: Callable[[SurfaceEstimate, int], Observation]
    signature: Callable[[Observation, Parameters], FloatMap]
    compare: Callable[[FloatMap, FloatMap, Parameters], Comparison]
    learn: Callable[[Sequence[Observation], Sequence[str]], Parameters] = _nothing
    observe_training: Callable[[SurfaceEstimate, int], Observation] | None = None
    references: Callable[[Observation, Parameters], FloatMap] | None = None
    limits: (
        Callable[[Sequence[str], Sequence[int], FloatMap, Parameters], dict[str, float]] | None
    ) = None
    invariants: Callable[[FloatMap], FloatMap] | None = None
    without_heading: Callable[[FloatMap], FloatMap] | None = None
    from_images: bool = False

    def training_observation(self, surface: SurfaceEstimate, segment_px: int) -> Observation:
        """What training keeps of a surface."""
        observe = self.observe_training or self.observe
        return observe(surface, segment_px)

    def training_signatures(self, observation: Observation, parameters: Parameters) -> FloatMap:
        """(k, ...) references that one training set gives."""
        if self.references is not None:
            return self.references(observation, parameters)
        return self.signature(observation, parameters)[None]
