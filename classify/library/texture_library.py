"""Trained textures: which of them is this surface, and how far is it turned."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from classify.classifiers import Classifier, Comparison, Observation, Parameters, classifier_named
from classify.errors import InputError, LibraryError
from classify.labels import checked_label
from classify.lighting import Lighting
from classify.methods import DEFAULT_CLASSIFIER
from classify.surface.estimate import FloatMap, SurfaceEstimate
from classify.texture.heading import LEAST_SCORE
from classify.texture.spectra import segment_for

from . import ps4lib
from .candidates import COMPARED_AT_ONCE, Sieve
from .match import Match, match_of

__all__ = ["TextureLibrary", "TrainingRow", "observe"]

TrainingSample = tuple[str, SurfaceEstimate] | tuple[str, SurfaceEstimate, float | None]

# Lights further than this from those a library of images was learned under make other images.
_SAME_LIGHT_DEG = 1.0


class TrainingRow(NamedTuple):
    """What training keeps of one set: its class, its observation, its orientation if known."""

    label: str
    observation: Observation
    orientation_deg: float | None = None


def observe(
    surface: SurfaceEstimate, segment_px: int, classifier: str = DEFAULT_CLASSIFIER
) -> Observation:
    """What `TextureLibrary.from_observations` needs of one training surface.

    A pure function of small result, so that sets can be observed by other processes.

    Raises
    ------
    InputError
        If the surface is smaller than a segment, or has no valid pixel.
    """
    return classifier_named(classifier).training_observation(surface, segment_px)


@dataclass(frozen=True, eq=False)
class TextureLibrary:
    """References of every class, all from segments of one size.

    Attributes
    ----------
    classifier
        What compares, by name; see ``classify/classifiers/``.
    labels
        (n,) class of each reference.
    orientations_deg
        (n,) float64 orientation each lay in, [0, 360); of one without a heading modulo 180.
    signatures
        (n, ...) float32; of a large library a view of its file.
    parameters
        What the classifier learned from all sets together.
    segment_px
        Side of the segments.
    limits
        For each class the distance beyond which a surface is none of it; empty where the
        classifier knows none.
    lighting
        The lights of the training sets, where all had the same.
    simulated
        Whether some of them never lay under a real camera.
    sources
        Where the training sets came from, as whoever trained it noted: (name, SHA-256 of the
        pixels) each.
    """

    classifier: str
    labels: tuple[str, ...]
    orientations_deg: npt.NDArray[np.float64]
    signatures: FloatMap
    parameters: Parameters
    segment_px: int
    limits: Mapping[str, float] = field(default_factory=dict)
    lighting: Lighting | None = None
    simulated: bool = False
    sources: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        if not self.labels:
            raise LibraryError("a library needs at least one training set")

    @property
    def classes(self) -> tuple[str, ...]:
        """The classes, in order of their first training set."""
        return tuple(dict.fromkeys(self.labels))

    @classmethod
    def train(
        cls, samples: Iterable[TrainingSample], classifier: str = DEFAULT_CLASSIFIER
    ) -> TextureLibrary:
        """Learn from any number of surfaces per class.

        Parameters
        ----------
        samples
            (label, surface) or (label, surface, orientation_deg). Where the orientation of a
            training surface is not given, the first of a class defines 0 and later ones are
            aligned to it.
        classifier
            One of `CLASSIFIERS`.

        Raises
        ------
        LibraryError, InputError
            Without samples, for an empty label, an orientation that is no number, or a surface too
            small for a texture.
        """
        rows = [
            (sample[0], sample[1], sample[2] if len(sample) > 2 else None) for sample in samples
        ]
        if not rows:
            raise LibraryError("nothing to train on; give at least one set")
        segment_px = min(segment_for(surface.shape) for _, surface, _ in rows)
        return cls.from_observations(
            [
                TrainingRow(label, observe(surface, segment_px, classifier), orientation_deg)
                for label, surface, orientation_deg in rows
            ],
            segment_px,
            classifier,
            lighting=common_lighting([surface.lighting for _, surface, _ in rows]),
        )

    @classmethod
    def from_observations(
        cls,
        rows: Sequence[TrainingRow],
        segment_px: int,
        classifier: str = DEFAULT_CLASSIFIER,
        *,
        lighting: Lighting | None = None,
        simulated: bool = False,
        sources: Sequence[tuple[str, str]] = (),
    ) -> TextureLibrary:
        """Learn from what `observe` made of each set; see `train`."""
        if not rows:
            raise LibraryError("nothing to train on; give at least one set")
        for row in rows:
            _check(row)
        how = classifier_named(classifier)
        parameters = how.learn([row.observation for row in rows], [row.label for row in rows])
        labels: list[str] = []
        orientations_deg: list[float] = []
        signatures: list[FloatMap] = []
        sets: list[int] = []
        first_of_class: dict[str, int] = {}
        for number, row in enumerate(rows):
            learned = how.training_signatures(row.observation, parameters)
            first = first_of_class.setdefault(row.label, len(labels))
            orientation_deg = row.orientation_deg
            if orientation_deg is None:
                orientation_deg = 0.0
                if first < len(labels):
                    found = how.compare(learned[0], signatures[first][None], parameters)
                    turn_deg = (
                        0.0 if found.orientations_deg is None else float(found.orientations_deg[0])
                    )
                    heading = 0.0 if found.headings is None else float(found.headings[0])
                    orientation_deg = orientations_deg[first] + turn_deg + 180.0 * (heading < 0.0)
                    if abs(heading) < LEAST_SCORE and how.without_heading is not None:
                        # It may lie the other way round, and so would whatever is found by it.
                        learned = how.without_heading(learned)
            labels += [row.label] * len(learned)
            sets += [number] * len(learned)
            # Rounded first: a hair below 0 is 0, not a hair below 360.
            orientations_deg += [round(orientation_deg, 6) % 360.0] * len(learned)
            signatures += list(learned)
        stacked = np.stack(signatures)
        return cls(
            classifier=classifier,
            labels=tuple(labels),
            orientations_deg=np.array(orientations_deg),
            signatures=stacked,
            parameters=parameters,
            segment_px=segment_px,
            limits={} if how.limits is None else how.limits(labels, sets, stacked, parameters),
            lighting=lighting,
            simulated=simulated,
            sources=tuple(sources),
        )

    def observe(self, surface: SurfaceEstimate) -> FloatMap:
        """The signature of a surface to be asked about.

        Raises
        ------
        InputError
            If the surface is smaller than the library's segments, has no valid pixel, or was lit
            from elsewhere than a library of images.
        """
        if self._how.from_images:
            _check_same_lights(surface.lighting, self.lighting, self.classifier)
        observation = self._how.observe(surface, self.segment_px)
        try:
            return self._how.signature(observation, self.parameters)
        except (LookupError, ValueError) as error:
            raise LibraryError(
                f"what the library learned does not fit {self.classifier} ({error}); train it again"
            ) from error

    def match(self, signature: FloatMap) -> Match:
        """The nearest class, or unknown, and the orientation; `signature` as from `observe`."""
        if signature.shape != self.signatures.shape[1:]:
            raise LibraryError(
                f"the library's signatures are of shape {self.signatures.shape[1:]}, those of "
                f"{self.classifier} {signature.shape}; train it again"
            )
        chosen, found = self._compared(signature)
        if not np.isfinite(found.distances).all():
            raise LibraryError("the library holds numbers that are none; train it again")
        labels = [self.labels[index] for index in chosen.tolist()]
        return match_of(found, labels, self.orientations_deg[chosen], self.limits)

    def classify(self, surface: SurfaceEstimate) -> Match:
        """The nearest class, or unknown, and the orientation of a surface.

        Raises
        ------
        InputError
            As `observe`.
        """
        return self.match(self.observe(surface))

    def save(self, path: str | Path) -> None:
        """Write one ``.ps4lib`` file; whole or not at all."""
        ps4lib.write(Path(path), self._contents())

    @classmethod
    def load(cls, path: str | Path) -> TextureLibrary:
        """Read a ``.ps4lib`` file; the signatures of a large one stay in it until they are asked.

        Raises
        ------
        LibraryError
            If it is missing, damaged, or of a version this program does not know.
        """
        contents = ps4lib.read(Path(path))
        header = contents.header
        lighting = None
        if header.light_directions is not None:
            try:
                lighting = Lighting(np.array(header.light_directions))
            except InputError as error:
                raise LibraryError(f"{path}: {error}; train it again") from error
        library = cls(
            classifier=header.classifier,
            labels=tuple(header.classes[index] for index in contents.class_indices.tolist()),
            orientations_deg=contents.orientations_deg,
            signatures=contents.signatures,
            parameters=contents.parameters,
            segment_px=header.segment_px,
            limits=header.limits,
            lighting=lighting,
            simulated=header.simulated,
            sources=header.sources,
        )
        if contents.invariants is not None:
            # What was made when the library was trained is not made again.
            library.__dict__["_sieve"] = Sieve(contents.invariants, library.labels)
        return library

    def _contents(self) -> ps4lib.Contents:
        indices = {label: index for index, label in enumerate(self.classes)}
        directions = None if self.lighting is None else self.lighting.directions.tolist()
        header = ps4lib.Header(
            classifier=self.classifier,
            segment_px=self.segment_px,
            simulated=self.simulated,
            classes=self.classes,
            limits=dict(self.limits),
            light_directions=directions,
            sources=self.sources,
        )
        return ps4lib.Contents(
            header=header,
            class_indices=np.array([indices[label] for label in self.labels], np.int32),
            orientations_deg=self.orientations_deg,
            signatures=self.signatures,
            parameters=self.parameters,
            invariants=None if self._sieve is None else self._sieve.invariants,
        )

    @property
    def _how(self) -> Classifier:
        return classifier_named(self.classifier)

    @cached_property
    def _sieve(self) -> Sieve | None:
        """What spares a large library most of its comparisons."""
        invariants, count = self._how.invariants, len(self.labels)
        if invariants is None or count <= COMPARED_AT_ONCE:
            return None
        # A part at a time: what they are made from takes several times the memory of the part.
        starts = range(0, count, COMPARED_AT_ONCE)
        parts = [invariants(self.signatures[i : i + COMPARED_AT_ONCE]) for i in starts]
        return Sieve(np.concatenate(parts), self.labels)

    def _compared(self, signature: FloatMap) -> tuple[npt.NDArray[np.intp], Comparison]:
        """The references that can be nearest or second, and the comparison with each."""

        def compare(indices: npt.NDArray[np.intp]) -> Comparison:
            return self._how.compare(signature, self.signatures[indices], self.parameters)

        if self._sieve is None or self._how.invariants is None:
            everything = np.arange(len(self.labels))
            return everything, self._how.compare(signature, self.signatures, self.parameters)
        invariants = self._how.invariants(signature[None])[0]
        if invariants.shape != self._sieve.invariants.shape[1:]:
            raise LibraryError("the library's invariants do not fit its signatures; train it again")
        return self._sieve.nearest(invariants, compare)


def common_lighting(lightings: Sequence[Lighting | None]) -> Lighting | None:
    """The lighting that all have, to a degree; None where they differ or one is not known."""
    first = lightings[0]
    if first is None:
        return None
    alike = all(other is not None and first.within(_SAME_LIGHT_DEG, other) for other in lightings)
    return first if alike else None


def _check(row: TrainingRow) -> None:
    if not row.label.strip():
        raise LibraryError("a training set has no label; give each set its class")
    checked_label(row.label)
    if row.orientation_deg is not None and not math.isfinite(row.orientation_deg):
        raise LibraryError(
            f"the orientation of a training set of {row.label} is {row.orientation_deg}; "
            "give degrees, or none"
        )


def _check_same_lights(asked: Lighting | None, learned: Lighting | None, classifier: str) -> None:
    if asked is None or learned is None or asked.within(_SAME_LIGHT_DEG, learned):
        return
    raise InputError(
        f"this set was lit from slant {asked.slants_deg.mean():.0f}, the library's from "
        f"{learned.slants_deg.mean():.0f} degrees or other tilts: to {classifier}, which compares "
        "images, it is another surface; capture it under the library's lights, or train a library "
        "that compares surfaces"
    )
