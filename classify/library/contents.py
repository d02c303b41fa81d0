"""The contents of a texture library, in memory and in its file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from classify.classifiers import Parameters, classifier_named
from classify.errors import LibraryError
from classify.lighting import Lighting
from classify.methods import Method
from classify.surface.estimate import FloatMap


@dataclass(frozen=True, eq=False)
class LibraryContents:
    """References of all classes, from segments of one size.

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
        What the classifier learned from all sets together.
    segment_px
        Side of the segments.
    oriented
        Classes with a training set whose orientation was given. In the others the first set defines
        0, so that orientations compare with each other only.
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
        Number of references up to which all are compared. In a larger library bounds select a few;
        with fewer references bounds cost what they save (``ps4rig bench``). Not saved.
    """

    classifier: str
    labels: tuple[str, ...]
    orientations_deg: npt.NDArray[np.float64]
    signatures: FloatMap
    parameters: Parameters
    segment_px: int
    oriented: tuple[str, ...] = ()
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
            found = self.parameters[name].shape
            fits = all(n == m or m < 0 < n for n, m in zip(found, shape, strict=False))
            if len(found) != len(shape) or not fits:
                raise LibraryError(
                    f"parameter {name} has shape {found}, that of {self.classifier} {shape}; "
                    "train it again"
                )

    @cached_property
    def classes(self) -> tuple[str, ...]:
        """The classes, in order of their first training set."""
        return tuple(dict.fromkeys(self.labels))

    @cached_property
    def class_indices(self) -> npt.NDArray[np.int32]:
        """(n,) index into `classes` of each reference."""
        numbers = {label: index for index, label in enumerate(self.classes)}
        return np.array([numbers[label] for label in self.labels], np.int32)

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
