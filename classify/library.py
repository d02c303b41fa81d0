"""Trained textures: which of them is this surface, and how far is it turned."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from . import library_file
from .errors import LibraryError
from .scheme import Reference, compare, signature
from .spectra import segment_for, surface_spectra
from .surface import FloatMap, SurfaceEstimate

__all__ = ["Match", "TextureLibrary"]

TrainingSample = tuple[str, SurfaceEstimate] | tuple[str, SurfaceEstimate, float | None]


@dataclass(frozen=True)
class Match:
    """The answer of a library.

    Attributes
    ----------
    label
        The class, or None where no class is nearer than all others.
    nearest
        The nearest class, even then.
    orientation_deg
        Orientation of the surface, anticlockwise, modulo 180, in the terms of the training set.
    distance
        Distance to the nearest class, 0 (equal spectra) to 1.
    runner_up, runner_up_distance
        The next other class; None in a library of one class.
    margin
        1 - distance / runner_up_distance: 0 undecided, 1 beyond doubt; None without a runner-up.
    """

    label: str | None
    nearest: str
    orientation_deg: float
    distance: float
    runner_up: str | None
    runner_up_distance: float | None
    margin: float | None


@dataclass(frozen=True, eq=False)
class TextureLibrary:
    """References of every class, all from segments of one size.

    `simulated` says that some of them never lay under a real camera.
    """

    references: tuple[Reference, ...]
    segment_px: int
    simulated: bool = False

    def __post_init__(self) -> None:
        if not self.references:
            raise LibraryError("a library needs at least one training set")

    @property
    def labels(self) -> tuple[str, ...]:
        """The classes, in order of their first training set."""
        return tuple(dict.fromkeys(reference.label for reference in self.references))

    @classmethod
    def train(cls, samples: Iterable[TrainingSample]) -> TextureLibrary:
        """Learn from any number of surfaces per class.

        Parameters
        ----------
        samples
            (label, surface) or (label, surface, orientation_deg). Where the orientation of a
            training surface is not given, the first of a class defines 0 and later ones are
            aligned to it.

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
        references: list[Reference] = []
        for label, surface, orientation_deg in rows:
            if not label.strip():
                raise LibraryError("a training set has no label; give each set its class")
            if orientation_deg is not None and not math.isfinite(orientation_deg):
                raise LibraryError(
                    f"the orientation of a training set of {label} is {orientation_deg}; "
                    "give degrees, or none"
                )
            learned = signature(surface_spectra(surface, segment_px))
            if orientation_deg is None:
                orientation_deg = _orientation_within(label, learned, references)
            references.append(Reference(label, learned, _modulo_half_turn(orientation_deg)))
        return cls(tuple(references), segment_px)

    def classify(self, surface: SurfaceEstimate) -> Match:
        """The nearest class and the orientation of the surface.

        Raises
        ------
        InputError
            If the surface is smaller than the library's segments or has no valid pixel.
        """
        test = signature(surface_spectra(surface, self.segment_px))
        distances, turns_deg = compare(test, self._stack)
        best_of_class: dict[str, int] = {}
        for index in np.argsort(distances, kind="stable"):
            best_of_class.setdefault(self.references[index].label, int(index))
        ranked = list(best_of_class.items())
        nearest, winner = ranked[0]
        distance = float(distances[winner])
        runner_up, second = ranked[1] if len(ranked) > 1 else (None, None)
        runner_up_distance = None if second is None else float(distances[second])
        margin = None
        if runner_up_distance is not None:
            margin = 1.0 - distance / runner_up_distance if runner_up_distance > 0.0 else 0.0
        orientation = self.references[winner].orientation_deg + turns_deg[winner]
        return Match(
            # Two classes at the same distance: to name one would be to toss a coin.
            label=None if margin == 0.0 else nearest,
            nearest=nearest,
            orientation_deg=_modulo_half_turn(float(orientation)),
            distance=distance,
            runner_up=runner_up,
            runner_up_distance=runner_up_distance,
            margin=margin,
        )

    def save(self, path: str | Path) -> None:
        """Write one ``.ps4lib`` file; whole or not at all."""
        library_file.write(Path(path), self.references, self.segment_px, self.simulated)

    @staticmethod
    def load(path: str | Path) -> TextureLibrary:
        """Read a ``.ps4lib`` file.

        Raises
        ------
        LibraryError
            If it is missing, damaged, or of a version this program does not know.
        """
        return TextureLibrary(*library_file.read(Path(path)))

    @cached_property
    def _stack(self) -> FloatMap:
        return np.stack([reference.signature for reference in self.references])


def _orientation_within(label: str, learned: FloatMap, references: list[Reference]) -> float:
    """Orientation in terms of the first reference of the class; 0 for that one."""
    for reference in references:
        if reference.label == label:
            _, turns_deg = compare(learned, reference.signature[None])
            return float(turns_deg[0]) + reference.orientation_deg
    return 0.0


def _modulo_half_turn(degrees: float) -> float:
    # Rounded first: a hair below 0 is 0, not a hair below 180.
    return round(degrees, 6) % 180.0
