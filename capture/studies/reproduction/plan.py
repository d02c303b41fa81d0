"""What a reproduction measures, as data: training runs, test runs, experiments, the plan."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from classify.classifiers import classifier_named
from classify.methods import Method
from classify.texture.spectra import segment_for

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
    "Conditions",
    "Experiment",
    "PatchPosition",
    "Plan",
    "Protocol",
    "TestRun",
    "Texture",
    "TrainingRun",
]

Protocol = Literal["disjoint", "rotated"]
"""Tests on patches that share no pixel with training, or on the training patch, rotated."""

OURS, TEXTONS = "joint", "varma_zisserman"
THESIS, ONE_D = "spectra_2d", "polar_radial"
OF_SPECTRA = ("polar", ONE_D, "spectra_2d_power", THESIS)
"""The classifiers of the thesis that compare spectra of surfaces."""

SOLVERS: tuple[Method, ...] = ("ps3a", "ps4", "ps4_robust")
BEST_SOLVER: Method = SOLVERS[-1]

ONE_SEGMENT, OF_28_IMAGES = ", one segment", ", 28 images"
"""Suffixes of the names of runs."""


@dataclass(frozen=True)
class Texture:
    """A synthetic texture by its name, or a scanned material in its folder."""

    name: str
    folder: Path | None = None


@dataclass(frozen=True)
class PatchPosition:
    """Position and orientation of a patch on a texture.

    Attributes
    ----------
    seed
        Realisation of a synthetic texture.
    half_tile_away
        Whether the patch of a material, which is one tile, is shifted by half a tile.
    rotate_deg
        Rotation of the surface, anticlockwise.
    """

    texture: Texture
    seed: int
    half_tile_away: bool
    rotate_deg: float


@dataclass(frozen=True)
class Conditions:
    """Lighting and exposure of a set.

    Attributes
    ----------
    size_px
        Side of the frame; smaller frames are the middle of larger ones.
    shadows
        False renders light that passes through the relief, negative where the surface faces
        away, and does not clip it. No camera can take such images.
    exposure
        Relative to the 20 ms that fill 85 % of the well for white.
    weak_led
        Level of the second LED, unknown to the solver.
    """

    slant_deg: float
    size_px: int
    bits: int = 12
    shadows: bool = True
    exposure: float = 1.0
    weak_led: float = 1.0


@dataclass(frozen=True)
class TrainingRun:
    """Libraries trained on one or more sets of each texture under the same conditions.

    Attributes
    ----------
    orientations_deg
        Orientations of the training patch, one set each.
    one_segment
        Whether a spectrum is one periodogram of the whole frame, not an average over segments.
    tests_unknown
        Whether each test is also matched without its own class in the library.
    """

    name: str
    textures: tuple[Texture, ...]
    conditions: Conditions
    classifiers: tuple[str, ...]
    solvers: tuple[Method, ...]
    orientations_deg: tuple[float, ...] = (0.0,)
    one_segment: bool = False
    tests_unknown: bool = False

    @property
    def segment_px(self) -> int:
        """Side of the segments of the spectra."""
        side = self.conditions.size_px
        return side if self.one_segment else segment_for((side, side))

    @property
    def systems(self) -> list[tuple[Method, str]]:
        """Solver and classifier of each library; one solver for classifiers of images."""
        return [
            (solver, classifier)
            for classifier in self.classifiers
            for solver in self.solvers
            if solver == self.solvers[-1] or not classifier_named(classifier).from_images
        ]


@dataclass(frozen=True)
class TestRun:
    """Tests of the libraries of a training run under some conditions."""

    __test__ = False  # for pytest

    name: str
    training: TrainingRun
    conditions: Conditions


@dataclass(frozen=True)
class Experiment:
    """Test runs on the same patches, so that each scene is rendered once for all of them."""

    name: str
    tests: tuple[TestRun, ...]
    orientations_deg: tuple[float, ...]
    protocols: tuple[Protocol, ...] = ("disjoint",)

    @property
    def training(self) -> list[TrainingRun]:
        """The training runs, each once."""
        return list(dict.fromkeys(test.training for test in self.tests))

    @property
    def textures(self) -> list[Texture]:
        """The textures of all training runs, each once."""
        return list(dict.fromkeys(t for run in self.training for t in run.textures))

    @property
    def frame_px(self) -> int:
        """Side of the largest frame."""
        conditions = [run.conditions for run in self.tests]
        conditions += [run.conditions for run in self.training]
        return max(each.size_px for each in conditions)

    @property
    def facts(self) -> dict[str, object]:
        """Numbers of the first training run for the text of exhibits."""
        first = self.training[0]
        return {
            "classes": len(first.textures),
            "size": first.conditions.size_px,
            "tests": len(self.orientations_deg),
        }

    @property
    def patches(self) -> int:
        """Number of test patches."""
        return len(self.textures) * len(self.protocols) * len(self.orientations_deg)

    def training_position(self, texture: Texture, rotate_deg: float) -> PatchPosition:
        """Position of the training patch."""
        return PatchPosition(texture, 0, False, rotate_deg)

    def test_position(self, texture: Texture, number: int, protocol: Protocol) -> PatchPosition:
        """Position of a test patch: another realisation or another place if disjoint."""
        disjoint = protocol == "disjoint"
        seed = 1000 + number if disjoint else 0
        return PatchPosition(texture, seed, disjoint, self.orientations_deg[number])


@dataclass(frozen=True)
class Plan:
    """All experiments of a reproduction."""

    quick: bool
    frame_px: int
    chapter_slants_deg: tuple[float, ...]
    slants: Experiment
    thirty: Experiment
    synthetic: Experiment
    materials: Experiment
    robustness: Experiment

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """All of them."""
        return (self.slants, self.thirty, self.synthetic, self.materials, self.robustness)
