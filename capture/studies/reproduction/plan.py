"""What is measured, as data: lessons, exams on what was learned, experiments, the plan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from classify.classifiers import classifier_named
from classify.methods import METHODS, Method
from classify.texture.spectra import segment_for

from .scenes import Conditions, Place, Texture

__all__ = [
    "BEST_SOLVER",
    "OF_28_IMAGES",
    "OF_SPECTRA",
    "ONE_D",
    "ONE_SEGMENT",
    "OURS",
    "SOLVERS",
    "TEXTONS",
    "THESIS",
    "Exam",
    "Experiment",
    "Lesson",
    "Plan",
    "Protocol",
]

Protocol = Literal["disjoint", "turned"]
"""Tests on patches that were not learned, or on the learned patch, turned under the lights."""

OURS, TEXTONS = "joint", "varma_zisserman"
THESIS, ONE_D = "spectra_2d", "polar_radial"
OF_SPECTRA = ("polar", ONE_D, "spectra_2d_power", THESIS)
"""The classifiers of the thesis that compare spectra of surfaces."""

SOLVERS: tuple[Method, ...] = tuple(
    method for method in METHODS if method in ("ps3a", "ps4", "ps4_robust")
)
BEST_SOLVER: Method = SOLVERS[-1]

ONE_SEGMENT, OF_28_IMAGES = ", one segment", ", 28 images"
"""What the names of some exams end in."""


@dataclass(frozen=True)
class Lesson:
    """What is learned: one set of images of each texture, or several, under some conditions.

    Attributes
    ----------
    turns_deg
        Orientations of the learned patch, one set each.
    one_segment
        Whether a spectrum is one periodogram of the whole frame and not an average over segments.
    rejecting
        Whether the quarters of the sets are kept too, for the scores that tell the unknown.
    """

    name: str
    textures: tuple[Texture, ...]
    conditions: Conditions
    classifiers: tuple[str, ...]
    solvers: tuple[Method, ...]
    turns_deg: tuple[float, ...] = (0.0,)
    one_segment: bool = False
    rejecting: bool = False

    @property
    def segment_px(self) -> int:
        """Side of the segments of its spectra."""
        side = self.conditions.size_px
        return side if self.one_segment else segment_for((side, side))

    @property
    def systems(self) -> list[tuple[Method, str]]:
        """Solver and classifier of each library. What looks at images needs but one solver."""
        return [
            (solver, classifier)
            for classifier in self.classifiers
            for solver in self.solvers
            if solver == self.solvers[-1] or not classifier_named(classifier).from_images
        ]


@dataclass(frozen=True)
class Exam:
    """Tests under some conditions of what was learned in a lesson."""

    name: str
    lesson: Lesson
    conditions: Conditions


@dataclass(frozen=True)
class Experiment:
    """Exams on the same patches. Each scene is rendered once for all of them."""

    name: str
    exams: tuple[Exam, ...]
    turns_deg: tuple[float, ...]
    protocols: tuple[Protocol, ...] = ("disjoint",)

    @property
    def lessons(self) -> list[Lesson]:
        """Each once."""
        return list(dict.fromkeys(exam.lesson for exam in self.exams))

    @property
    def textures(self) -> list[Texture]:
        """Of all lessons, each once."""
        return list(dict.fromkeys(t for lesson in self.lessons for t in lesson.textures))

    @property
    def frame_px(self) -> int:
        """Side of the largest frame."""
        sizes = [exam.conditions.size_px for exam in self.exams]
        return max(sizes + [lesson.conditions.size_px for lesson in self.lessons])

    def learned_place(self, texture: Texture, turn_deg: float) -> Place:
        """Where the training sets are taken."""
        return Place(texture, seed=0, elsewhere=False, rotate_deg=turn_deg)

    def test_place(self, texture: Texture, test: int, protocol: Protocol) -> Place:
        """Where test number `test` is taken."""
        disjoint = protocol == "disjoint"
        return Place(texture, 1000 + test if disjoint else 0, disjoint, self.turns_deg[test])


@dataclass(frozen=True)
class Plan:
    """All that a reproduction measures."""

    quick: bool
    frame_px: int
    chapter_slants_deg: tuple[float, ...]
    material_sizes_px: tuple[int, ...]
    rejection_size_px: int
    slants: Experiment
    thirty: Experiment
    synthetic: Experiment
    materials: Experiment
    robustness: Experiment

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """All of them."""
        return (self.slants, self.thirty, self.synthetic, self.materials, self.robustness)
