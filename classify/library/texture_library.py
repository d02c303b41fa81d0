"""`TextureLibrary`: train textures, then classify surfaces."""

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np
import numpy.typing as npt

from classify.base.array_archive import is_cut_short
from classify.base.arrays import Array, FloatMap, Floats, Indices
from classify.base.errors import InputError, LibraryError
from classify.classifiers import Comparison, Parameters, classifier_named
from classify.lighting import Lighting
from classify.methods import DEFAULT_CLASSIFIER, METHODS, Method
from classify.surface.estimate import SurfaceEstimate
from classify.texture.blur import blurred_surface
from classify.texture.orientation import OrientationProfile
from classify.texture.spectra import segment_for
from classify.texture.uniformity import Uniformity

from . import ps4lib
from .match import MIN_MARGIN, Match, match_of, nearest_references
from .training import SAME_LIGHT_DEG, TrainingRow, common_lighting, learn_references, observe

# The first comparison extrapolates the statistics of a training set to those of a sharper surface.
# On 22 materials this adds 0.002 to the distance at 0.5 px, 0.05 at 0.7 px and 0.13 at 0.9 px.
_MIN_SHARPENING_PX = 0.5

_TrainingSample = tuple[str, SurfaceEstimate] | tuple[str, SurfaceEstimate, float | None]


@dataclass(frozen=True, eq=False)
class TextureLibrary:
    """Trained textures: references of all classes, from segments of one size.

    Attributes
    ----------
    classifier
        Name of the classifier; see ``classify/classifiers/``.
    labels
        (n,) class of each reference.
    orientations_deg
        (n,) float64 orientation of each reference, [0, 360); modulo 180 without a heading.
    signatures
        (n, ...) float32; in a large library that was loaded, a view of its file.
    parameters
        Numbers that the classifier learned from all sets together.
    segment_px
        Side of the segments.
    oriented
        Classes with a training set whose orientation was given. In the others the first set defines
        0, so that orientations compare with each other only.
    uniformity
        Whether each class is uniform, varied or no texture; empty where the classifier does not
        measure it.
    limits
        Distance beyond which each class rejects; empty where the classifier rejects nothing.
    lighting
        The lights of the training sets, where all had the same.
    method
        Solver of the training sets; None if they do not come from a solver.
    planar
        Whether the training sets were solved as planar parts.
    simulated
        Whether some training sets come from a simulated camera.
    sources
        (name, SHA-256 of the pixels) of each training set, as given in training.
    compare_all_up_to
        Number of references up to which all are compared. In a larger library lower bounds of the
        distances select a few; in a smaller one the bounds cost as much as they save
        (``tests.evidence.benchmark``). Not saved.
    """

    classifier: str
    labels: tuple[str, ...]
    orientations_deg: Floats
    signatures: FloatMap
    parameters: Parameters
    segment_px: int
    oriented: tuple[str, ...] = ()
    uniformity: Mapping[str, Uniformity] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)
    lighting: Lighting | None = None
    method: Method | None = None
    planar: bool = False
    simulated: bool = False
    sources: tuple[tuple[str, str], ...] = ()
    compare_all_up_to: int = 1024

    def __post_init__(self) -> None:
        if not self.labels:
            raise LibraryError("a library needs at least one training set")
        classifier = classifier_named(self.classifier)
        for name, shape in classifier.parameter_shapes(self.segment_px).items():
            if name not in self.parameters:
                raise LibraryError(f"{self.classifier} needs a parameter {name}; train it again")
            actual = self.parameters[name].shape
            fits = all(n == m or m < 0 < n for n, m in zip(actual, shape, strict=False))
            if len(actual) != len(shape) or not fits:
                raise LibraryError(
                    f"parameter {name} has shape {actual}, that of {self.classifier} {shape}; "
                    "train it again"
                )

    @cached_property
    def classes(self) -> tuple[str, ...]:
        """The classes, in order of their first training set."""
        return tuple(dict.fromkeys(self.labels))

    @cached_property
    def class_indices(self) -> npt.NDArray[np.int32]:
        """(n,) index into `classes` of each reference."""
        index_of = {label: index for index, label in enumerate(self.classes)}
        return np.array([index_of[label] for label in self.labels], np.int32)

    @cached_property
    def invariants(self) -> FloatMap | None:
        """(n, k) `Classifier.invariants` of the references; None where all are compared."""
        classifier, count = classifier_named(self.classifier), len(self.labels)
        if not classifier.has_invariants or count <= self.compare_all_up_to:
            return None
        # In parts: a call needs several times the memory of its signatures.
        step = self.compare_all_up_to
        parts = [
            classifier.invariants(self.signatures[start : start + step], self.parameters)
            for start in range(0, count, step)
        ]
        return np.concatenate(parts)

    @classmethod
    def train(
        cls, samples: Iterable[_TrainingSample], classifier: str = DEFAULT_CLASSIFIER
    ) -> Self:
        """Learn from any number of surfaces per class, within their masks (`inscribed`).

        Parameters
        ----------
        samples
            (label, surface) or (label, surface, orientation_deg). Surfaces of no given orientation
            are aligned to the first of their class with one; without any, the first defines 0.
        classifier
            One of `CLASSIFIER_NAMES`.

        Raises
        ------
        LibraryError, InputError
            Without samples, where they are not solved alike, for a label that cannot name a class,
            an orientation that is not finite, or a surface too small for a texture.
        """
        rows = [
            (sample[0], sample[1].inscribed, sample[2] if len(sample) > 2 else None)
            for sample in samples
        ]
        if not rows:
            raise LibraryError("nothing to train on; give at least one set")
        solved = {(surface.method, surface.planar): label for label, surface, _ in rows}
        if len(solved) > 1:
            solvers = (f"{_solver_text(*solver)} ({label})" for solver, label in solved.items())
            raise LibraryError(f"training sets are solved {', '.join(solvers)}; solve all alike")
        method = rows[0][1].method
        segment_px = min(segment_for(surface.shape) for _, surface, _ in rows)
        return cls.from_observations(
            [
                TrainingRow(label, observe(surface, segment_px, classifier), orientation_deg)
                for label, surface, orientation_deg in rows
            ],
            segment_px,
            classifier,
            lighting=common_lighting([surface.lighting for _, surface, _ in rows]),
            method=method if method in METHODS else None,
            planar=rows[0][1].planar,
        )

    @classmethod
    def from_observations(
        cls,
        rows: Sequence[TrainingRow],
        segment_px: int,
        classifier: str = DEFAULT_CLASSIFIER,
        *,
        lighting: Lighting | None = None,
        method: Method | None = None,
        planar: bool = False,
        simulated: bool = False,
        sources: Sequence[tuple[str, str]] = (),
    ) -> Self:
        """Learn from sets observed by `training.observe` in equal segments; see `train`."""
        return cls(
            classifier=classifier,
            segment_px=segment_px,
            lighting=lighting,
            method=method,
            planar=planar,
            simulated=simulated,
            sources=tuple(sources),
            **learn_references(rows, classifier_named(classifier))._asdict(),
        )

    @classmethod
    def load(cls, path: str | Path, *, map_from_bytes: int = ps4lib.MAP_FROM_BYTES) -> Self:
        """Read a ``.ps4lib`` file.

        Arrays of `map_from_bytes` or more are mapped into memory instead of read: signatures of a
        large library stay in the file until a match needs them.

        Raises
        ------
        LibraryError
            If it is missing, damaged, or of a version this program does not know.
        """
        return ps4lib.read(Path(path), cls, map_from_bytes=map_from_bytes)

    def save(self, path: str | Path) -> None:
        """Write one ``.ps4lib`` file; whole or not at all."""
        ps4lib.write(Path(path), self)

    def observe(self, surface: SurfaceEstimate) -> FloatMap:
        """Compute the signature of a surface, for `match`.

        Raises
        ------
        InputError
            If the surface is smaller than the library's segments, has no valid pixel, or the
            classifier compares images and the lights were others.
        """
        self._require_whole_file()
        classifier = classifier_named(self.classifier)
        if classifier.from_images:
            _check_same_lights(surface.lighting, self.lighting, self.classifier)
        observation = classifier.observe(surface, self.segment_px)
        with np.errstate(all="ignore"):  # the result is tested instead
            signature = classifier.signature(observation, self.parameters)
        if not np.isfinite(signature).all():
            raise LibraryError("the library's parameters give NaN or infinity; train it again")
        return signature

    def match(self, signature: FloatMap, *, blurred_px: float = 0.0) -> Match:
        """Find the nearest class, or unknown, and the orientation.

        `signature` is from `observe`, and `blurred_px` the blur that was added to the surface.
        """
        if signature.shape != self.signatures.shape[1:]:
            raise LibraryError(
                f"the library's signatures have shape {self.signatures.shape[1:]}, those of "
                f"{self.classifier} {signature.shape}; train it again"
            )
        with np.errstate(all="ignore"):  # the result is tested instead
            indices, comparison = self.candidates(signature)
        if not np.isfinite(comparison.distances).all():
            raise LibraryError("the library contains NaN or infinity; train it again")
        labels = [self.labels[index] for index in indices.tolist()]
        return match_of(
            comparison,
            labels,
            self.orientations_deg[indices],
            self.limits,
            self.uniformity,
            blurred_px=blurred_px,
        )

    def classify(self, surface: SurfaceEstimate) -> Match:
        """Match a surface as `match_surface`; raises as `observe`.

        Warns where a solver solved the surface otherwise than the training sets.
        """
        trained = (self.method or surface.method, self.planar)
        if surface.images is not None and (surface.method, surface.planar) != trained:
            warnings.warn(
                f"this surface was solved {_solver_text(surface.method, surface.planar)}, the "
                f"training sets of the library {_solver_text(*trained)}; solve it alike, because "
                "textures differ between solvers",
                stacklevel=2,
            )
        return self.match_surface(surface.inscribed)

    def match_surface(self, surface: SurfaceEstimate, signature: FloatMap | None = None) -> Match:
        """Find the nearest class, or unknown, and the orientation; raises as `observe`.

        `signature` is that of the surface, by `observe`, if it is known.
        A surface that is sharper than its nearest training set is blurred and compared again,
        unless its margin is below `MIN_MARGIN`: blur would raise the distance to the runner-up
        alone, and hide the doubt.
        """
        match = self.match(self.observe(surface) if signature is None else signature)
        decided = match.margin is None or match.margin >= MIN_MARGIN
        if match.blur_px is None or match.blur_px > -_MIN_SHARPENING_PX or not decided:
            return match
        blurred = blurred_surface(surface, -match.blur_px)
        return self.match(self.observe(blurred), blurred_px=-match.blur_px)

    def distances(self, surface: SurfaceEstimate) -> dict[str, float]:
        """Distance of a surface to the nearest reference of each class.

        Raises as `observe`. Unlike `classify` it compares all references.
        """
        signature, classifier = self.observe(surface), classifier_named(self.classifier)
        comparison = classifier.compare(signature, self.signatures, self.parameters)
        nearest = dict.fromkeys(self.classes, np.inf)
        for label, distance in zip(self.labels, comparison.distances.tolist(), strict=True):
            nearest[label] = min(nearest[label], distance)
        return nearest

    def orientation_profile(self, surface: SurfaceEstimate) -> OrientationProfile | None:
        """How well a surface agrees with its nearest reference at each orientation.

        None if the classifier finds no orientation. Raises as `observe`.
        """
        signature, classifier = self.observe(surface), classifier_named(self.classifier)
        if classifier.agreement is None:
            return None
        indices, comparison = self.candidates(signature)
        nearest = int(indices[np.argmin(comparison.distances)])
        (agreement,) = classifier.agreement(signature, self.signatures[nearest : nearest + 1])
        # Orientations of a reference count from its own training set.
        degrees = np.arange(180) - self.orientations_deg[nearest]
        return OrientationProfile(np.interp(degrees, np.arange(180), agreement, period=180.0))

    def _require_whole_file(self) -> None:
        """Raise LibraryError if a mapped file was cut short: reading it would end the process."""
        arrays: list[Array] = [self.signatures, self.orientations_deg, *self.parameters.values()]
        if vars(self).get("invariants") is not None:  # the property would compute them
            arrays.append(vars(self)["invariants"])
        if any(is_cut_short(array) for array in arrays):
            raise LibraryError("the file of the library was cut short; train it again")

    def candidates(self, signature: FloatMap) -> tuple[Indices, Comparison]:
        """Compare the references that can be nearest or runner-up; their indices come first."""
        self._require_whole_file()
        classifier = classifier_named(self.classifier)
        if self.invariants is None:
            all_indices = np.arange(len(self.labels))
            return all_indices, classifier.compare(signature, self.signatures, self.parameters)
        invariants = classifier.invariants(signature[None], self.parameters)[0]
        if invariants.shape != self.invariants.shape[1:]:
            raise LibraryError("the library's invariants do not fit its signatures; train it again")

        def compare(indices: Indices) -> Comparison:
            return classifier.compare(signature, self.signatures[indices], self.parameters)

        bounds = classifier.bounds(invariants, self.invariants, self.parameters)
        return nearest_references(self.class_indices, bounds, compare)


def _solver_text(method: str, planar: bool) -> str:
    return f"by {method} as planar parts" if planar else f"by {method}"


def _check_same_lights(
    lighting: Lighting | None, trained: Lighting | None, classifier: str
) -> None:
    if lighting is None or trained is None or lighting.within(SAME_LIGHT_DEG, trained):
        return
    raise InputError(
        f"the lights of this set, at slant {lighting.slants_deg.mean():.0f}, differ in slant or "
        f"tilt from the library's, at slant {trained.slants_deg.mean():.0f}: {classifier} compares "
        "images, which depend on them; capture the set under the library's lights, or train with "
        "--classifier joint"
    )
