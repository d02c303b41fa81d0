"""Libraries of any size, made of the signatures of real textures.

So many different textures cannot be rendered. A class is a mixture of two of the synthetic ones,
the second turned, and part of the difference between two others; its sets, and those that are
asked about, differ from each other as two realisations of one texture do, and lie at any angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from classify import TextureLibrary
from classify.classifiers import classifier_named
from classify.library.training import TrainingRow
from classify.surface.estimate import FloatMap
from classify.texture.spectra import ANGLES, segment_for
from rig import SYNTHETIC_30, SYNTHETIC_TEXTURES

from .scenes import patch

__all__ = ["SETS_OF_A_CLASS", "Mixtures", "Textures", "observed_textures"]

SETS_OF_A_CLASS = 4
_STRANGE = 0.5
"""The most of another two textures' difference that a class has in it."""
_SCATTER = 0.5
"""Two of these times a normal number are half the squared distance of two realisations."""
_AT_ONCE = 1000

Indices = npt.NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Textures:
    """The synthetic textures, learned.

    Attributes
    ----------
    library
        One set of each of the thirty.
    signatures
        (textures, 2 realisations, 90 turns, d) float32, of the thirty and their twins.
    """

    library: TextureLibrary
    signatures: FloatMap


def observed_textures(names: Sequence[str] = SYNTHETIC_TEXTURES, frame_px: int = 512) -> Textures:
    """Render, solve and observe two realisations of synthetic textures."""
    segment_px = segment_for((frame_px, frame_px))
    joint = classifier_named("joint")
    trainings, again = [], []
    for seed, texture in enumerate(names):
        first, second = (patch(texture, 2 * seed + k, frame_px).solve() for k in (0, 1))
        trainings.append(joint.observe_training(first, segment_px))
        again.append(joint.observe(second, segment_px))
    thirty = [
        TrainingRow(texture, training, 0.0)
        for texture, training in zip(names, trainings, strict=True)
        if texture in SYNTHETIC_30
    ]
    library = TextureLibrary.from_observations(thirty, segment_px, simulated=True)
    signatures = [
        [
            [
                # A column of a polar map is 2 degrees: whole columns turn it exactly.
                joint.references(
                    replace(
                        training,
                        frame=replace(frame, polar=np.roll(frame.polar, turn, axis=-1)),
                        rotated=(),
                    ),
                    library.parameters,
                )[0]
                for turn in range(ANGLES)
            ]
            for frame in (training.frame, second)
        ]
        for training, second in zip(trainings, again, strict=True)
    ]
    return Textures(library, np.array(signatures, np.float32))


class Mixtures:
    """Classes made of textures, any number of them."""

    def __init__(self, textures: Textures, classes: int, seed: int = 0) -> None:
        self._library = textures.library
        self._signatures = textures.signatures
        self._rng = np.random.default_rng(seed)
        self._textures = self._rng.integers(len(textures.signatures), size=(classes, 4))
        self._realisations = self._rng.integers(2, size=(classes, 4))
        self._turns = self._rng.integers(ANGLES, size=(classes, 4))
        share = self._rng.uniform(0.0, 1.0, classes)
        strange = self._rng.uniform(-_STRANGE, _STRANGE, classes)
        weights = np.stack([share, 1.0 - share, strange, -strange], axis=1)
        self._weights = weights.astype(np.float32)

    def library(self, count: int) -> TextureLibrary:
        """A library of `count` sets of the first classes."""
        classes = np.arange(count) // SETS_OF_A_CLASS
        signatures = np.empty((count, self._signatures.shape[-1]), np.float32)
        for start in range(0, count, _AT_ONCE):
            part = np.s_[start : start + _AT_ONCE]
            signatures[part] = self.sets(classes[part])
        names = [f"class {index}" for index in range(classes[-1] + 1)]
        return replace(
            self._library,
            labels=tuple(names[index] for index in classes.tolist()),
            orientations_deg=np.zeros(count),
            signatures=signatures,
            limits=dict.fromkeys(names, 3.0),
        )

    def sets(self, classes: Indices) -> FloatMap:
        """(n, d) float32 signatures of one more set of each of the classes, at any angle."""
        count = len(classes)
        turn = self._rng.integers(ANGLES, size=count)
        sets = np.zeros((count, self._signatures.shape[-1]), np.float32)
        for part in range(self._weights.shape[1]):
            found = self._signatures[
                self._textures[classes, part],
                self._realisations[classes, part],
                (self._turns[classes, part] + turn) % ANGLES,
            ]
            sets += self._weights[classes, part, None] * found
        for _ in range(2):
            texture = self._rng.integers(len(self._signatures), size=count)
            turn = self._rng.integers(ANGLES, size=count)
            much = _SCATTER * self._rng.standard_normal((count, 1), dtype=np.float32)
            first, second = (self._signatures[texture, k, turn] for k in (0, 1))
            sets += np.float32(much) * (first - second)
        return sets
