"""Libraries of any size, mixed from the signatures of rendered textures.

Rendering thousands of textures would take hours. Instead, a class is a mixture of the signatures
of two synthetic textures, the second rotated, and part of the difference between two others. Two
sets of a class differ as much as two realisations of one texture, and have random orientations.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from classify import TextureLibrary
from classify.classifiers import classifier_named
from classify.classifiers.joint_features import JointObservation, JointTraining
from classify.library.training import TrainingRow
from classify.surface.estimate import FloatMap
from classify.texture.spectra import ANGLES, segment_for
from rig import SYNTHETIC_30

from .scenes import texture_tile

SETS_OF_A_CLASS = 4
# Largest weight of the difference of two other textures in a class. The difference makes more
# distinct classes; with a larger weight, signatures no longer resemble those of textures.
_DIFFERENCE_WEIGHT = 0.5
# Each set gets two differences of realisations, each times this and a standard normal number.
# Two sets of a class then have the mean squared distance of two realisations: 2 (2 * 0.5^2) = 1.
_SCATTER = 0.5
_CHUNK = 1000

Indices = npt.NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Textures:
    """The synthetic textures with a library of one set of each of the thirty.

    `signatures` are (textures, 2 realisations, 90 orientations, d) float32.
    """

    library: TextureLibrary
    signatures: FloatMap


def observed_textures(names: Sequence[str], frame_px: int) -> Textures:
    """Render, solve and observe two realisations of synthetic textures."""
    segment_px = segment_for((frame_px, frame_px))
    joint = classifier_named("joint")
    observed = []
    for seed, texture in enumerate(names):
        tiles = (texture_tile(texture, 2 * seed + k, frame_px) for k in (0, 1))
        first, second = (tile.solve(planar=True) for tile in tiles)
        training = joint.observe_training(first, segment_px)
        observed.append((training, joint.observe(second, segment_px)))
    thirty = [
        TrainingRow(texture, training, 0.0)
        for texture, (training, _) in zip(names, observed, strict=True)
        if texture in SYNTHETIC_30
    ]
    library = TextureLibrary.from_observations(
        thirty, segment_px, method="ps4_robust", planar=True, simulated=True
    )

    def signature(training: JointTraining, frame: JointObservation, shift: int) -> FloatMap:
        # A column of a polar map is 2 degrees: a shift by whole columns is exact.
        shifted = replace(frame, polar=np.roll(frame.polar, shift, axis=-1))
        changed = replace(training, frame=shifted, rotated=())
        return np.asarray(joint.references(changed, library.parameters)[0])

    signatures = [
        [
            [signature(training, frame, shift) for shift in range(ANGLES)]
            for frame in (training.frame, second)
        ]
        for training, second in observed
    ]
    return Textures(library, np.array(signatures, np.float32))


class Mixtures:
    """Random classes, each a mixture of four textures."""

    def __init__(self, textures: Textures, classes: int, seed: int = 0) -> None:
        self._library = textures.library
        self._signatures = textures.signatures
        self._rng = np.random.default_rng(seed)
        self._textures = self._rng.integers(len(textures.signatures), size=(classes, 4))
        self._realisations = self._rng.integers(2, size=(classes, 4))
        self._shifts = self._rng.integers(ANGLES, size=(classes, 4))
        share = self._rng.uniform(0.0, 1.0, classes)
        difference = self._rng.uniform(-_DIFFERENCE_WEIGHT, _DIFFERENCE_WEIGHT, classes)
        weights = np.stack([share, 1.0 - share, difference, -difference], axis=1)
        self._weights = weights.astype(np.float32)

    def library(self, count: int) -> TextureLibrary:
        """A library of `count` sets of the first classes."""
        classes = np.arange(count) // SETS_OF_A_CLASS
        signatures = np.empty((count, self._signatures.shape[-1]), np.float32)
        for start in range(0, count, _CHUNK):
            chunk = np.s_[start : start + _CHUNK]
            signatures[chunk] = self.sets(classes[chunk])
        names = [f"class {index}" for index in range(classes[-1] + 1)]
        return replace(
            self._library,
            labels=tuple(names[index] for index in classes.tolist()),
            orientations_deg=np.zeros(count),
            signatures=signatures,
            limits=dict.fromkeys(names, 3.0),
        )

    def sets(self, classes: Indices) -> FloatMap:
        """(n, d) float32 signatures of a new set of each of the classes, at any orientation."""
        count = len(classes)
        shift = self._rng.integers(ANGLES, size=count)
        sets = np.zeros((count, self._signatures.shape[-1]), np.float32)
        for part in range(self._weights.shape[1]):
            signatures = self._signatures[
                self._textures[classes, part],
                self._realisations[classes, part],
                (self._shifts[classes, part] + shift) % ANGLES,
            ]
            sets += self._weights[classes, part, None] * signatures
        for _ in range(2):
            texture = self._rng.integers(len(self._signatures), size=count)
            shift = self._rng.integers(ANGLES, size=count)
            amount = _SCATTER * self._rng.standard_normal((count, 1), dtype=np.float32)
            first, second = (self._signatures[texture, k, shift] for k in (0, 1))
            sets += np.float32(amount) * (first - second)
        return sets
