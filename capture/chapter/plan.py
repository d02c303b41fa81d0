"""Plan of a reproduction: textures, conditions, training, tests, experiments."""

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from classify.classifiers import classifier_named
from classify.methods import CLASSIFIER_NAMES, Method
from classify.texture.spectra import segment_for
from rig import SYNTHETIC_30, SYNTHETIC_TEXTURES
from rig.scene.material_folder import bundled_materials
from rig.scene.render import SceneImages
from rig.scene.surfaces import PeriodicSurface

Protocol = Literal["disjoint", "rotated"]
"""Tests on patches that share no pixel with training, or on the training patch, rotated."""

OURS, TEXTONS = "joint", "varma_zisserman"
THESIS, ONE_D = "spectra_2d", "polar_radial"
THESIS_TEXTURES = SYNTHETIC_TEXTURES[:4]
"""The four synthetic surfaces of the thesis."""
SPECTRA_CLASSIFIERS = ("polar", ONE_D, "spectra_2d_power", THESIS)
"""The classifiers of the thesis that compare spectra of surfaces."""

SOLVERS: tuple[Method, ...] = ("ps3a", "ps4", "ps4_robust")
BEST_SOLVER: Method = SOLVERS[-1]

ONE_SEGMENT, WITH_28_IMAGES = ", one segment", ", 28 images"
"""Suffixes of the names of runs."""

# Seven sets of four images are the 28 training images of each class in table 9.1.
_ORIENTATIONS_FOR_28_IMAGES_DEG = tuple(180.0 * i / 7 for i in range(7))
# Synthetic textures that differ little from another one. The other 22 and the 8 bundled materials
# are the 30 textures of the chapter.
_NEAR_DUPLICATES = (
    "rock_smooth", "malv_near", "ripples_near", "ripples_wavy", "lattice", "rock_speckled",
    "sand_striped", "ridged_tinted",
)  # fmt: skip

Place = tuple[float, float]
"""Offset to the right of the centre of a material, and upwards, in tiles."""

_TRAINED_PLACE: Place = (0.0, 0.0)
_TESTED_PLACE: Place = (0.5, 0.5)  # of disjoint tests


SceneFaults = Callable[[PeriodicSurface, float, int, float, tuple[float, float], int], SceneImages]
"""Renders a frame under four lights with faults of the rig, and can be hashed.

Its arguments: surface, slant in degrees, side in px, rotation in degrees, shift in px, seed.
"""


@dataclass(frozen=True)
class Texture:
    """A synthetic texture by its name, or a scanned material in its folder."""

    name: str
    folder: Path | None = None


@dataclass(frozen=True)
class PatchPosition:
    """Position and orientation of a patch on a texture."""

    texture: Texture
    seed: int  # realisation of a synthetic texture
    shift_tiles: Place
    rotate_deg: float  # anticlockwise


@dataclass(frozen=True)
class Conditions:
    """Lighting and exposure of a set.

    Without `shadows`, light passes through relief, and is negative where the surface faces away.
    """

    slant_deg: float
    size_px: int  # side of the frame; smaller frames are the middle of larger ones
    bits: int = 12
    shadows: bool = True
    exposure: float = 1.0  # relative to 20 ms, with which white fills 85 % of the pixel's well
    weak_led: float = 1.0  # level of the second LED, unknown to the solver
    # Not in the repr, which seeds the noise: a set with faults has the noise of the set without.
    faults: SceneFaults | None = field(default=None, repr=False)


@dataclass(frozen=True)
class TrainingRun:
    """Libraries trained on sets of each texture, captured at `places` in turn.

    With `one_segment`, a spectrum is one periodogram of the whole frame.
    """

    name: str
    textures: tuple[Texture, ...]
    conditions: Conditions
    classifiers: tuple[str, ...]
    solvers: tuple[Method, ...]
    orientations_deg: tuple[float, ...] = (0.0,)  # of the sets
    one_segment: bool = False
    places: tuple[Place, ...] = (_TRAINED_PLACE,)

    def positions(self, texture: Texture) -> list[PatchPosition]:
        """Positions of the training patches of a texture, one for each set."""
        patches = itertools.cycle(enumerate(self.places))
        return [
            PatchPosition(texture, patch, place, rotate_deg)
            for (patch, place), rotate_deg in zip(patches, self.orientations_deg, strict=False)
        ]

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
    tested_places: tuple[Place, ...] = (_TESTED_PLACE,)  # of disjoint tests, in turn

    @property
    def training(self) -> list[TrainingRun]:
        """All training runs."""
        return list(dict.fromkeys(test.training for test in self.tests))

    @property
    def textures(self) -> list[Texture]:
        """The textures of all training runs."""
        return list(dict.fromkeys(t for run in self.training for t in run.textures))

    @property
    def frame_px(self) -> int:
        """Side of the largest frame."""
        conditions = {test.conditions for test in self.tests}
        conditions |= {run.conditions for run in self.training}
        return max(condition.size_px for condition in conditions)

    @property
    def facts(self) -> dict[str, object]:
        """Numbers of the first training run for the text of exhibits."""
        first, tests = self.training[0], len(self.orientations_deg)
        return {
            "classes": len(first.textures), "size": first.conditions.size_px, "tests": tests,
        }  # fmt: skip

    def test_position(self, texture: Texture, number: int, protocol: Protocol) -> PatchPosition:
        """Position of a test patch. The seed of the training patch is 0."""
        seed, place = 0, _TRAINED_PLACE
        if protocol == "disjoint":
            seed, place = 1000 + number, self.tested_places[number % len(self.tested_places)]
        return PatchPosition(texture, seed, place, self.orientations_deg[number])


@dataclass(frozen=True)
class Plan:
    """All experiments of a reproduction."""

    quick: bool
    frame_px: int
    chapter_slants_deg: tuple[float, ...]
    slants: Experiment
    thirty: Experiment

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """All experiments."""
        return self.slants, self.thirty


def spread_orientations_deg(count: int) -> tuple[float, ...]:
    """Orientations over 180 degrees, unevenly spaced, none of them a multiple of 90."""
    return tuple(7.0 + 180.0 * i / count + 1.3 * (i % 3) for i in range(count))


def material_textures() -> tuple[Texture, ...]:
    """The bundled scanned materials."""
    return tuple(Texture(name, path) for name, path in bundled_materials().items())


def thirty_textures(quick: bool) -> tuple[Texture, ...]:
    """22 synthetic textures and the 8 bundled materials; every fourth of them if quick."""
    synthetic = [name for name in SYNTHETIC_30 if name not in _NEAR_DUPLICATES]
    textures = synthetic_textures(synthetic) + material_textures()
    return textures[::4] if quick else textures


def plan_of(quick: bool) -> Plan:
    """The full plan, or a quick one that takes two minutes on two cores."""
    frame_px, slants_deg = 128 if quick else 256, (45.0, 65.0)  # little shadow and much
    orientations_deg = spread_orientations_deg(12 if quick else 24)
    return Plan(
        quick=quick,
        frame_px=frame_px,
        chapter_slants_deg=slants_deg,
        slants=_slants(frame_px, orientations_deg, quick),
        thirty=_thirty(frame_px, orientations_deg, slants_deg, quick),
    )


def synthetic_textures(names: Iterable[str]) -> tuple[Texture, ...]:
    """The synthetic textures of these names."""
    return tuple(Texture(name) for name in names)


def same_conditions(runs: Iterable[TrainingRun]) -> tuple[TestRun, ...]:
    """Tests under the conditions of the training."""
    return tuple(TestRun(run.name, run, run.conditions) for run in runs)


def _slants(frame_px: int, orientations_deg: tuple[float, ...], quick: bool) -> Experiment:
    """Figure 9.1: the four surfaces of the thesis, with and without shadow."""
    four = synthetic_textures(THESIS_TEXTURES)
    runs = []
    for slant_deg in (40, 60, 80) if quick else range(10, 90, 10):
        for shadows in (False, True):
            conditions = Conditions(float(slant_deg), frame_px, shadows=shadows)
            name = f"slant {slant_deg} {'with' if shadows else 'without'} shadow"
            spectra = TrainingRun(
                name + ONE_SEGMENT, four, conditions, (ONE_D, THESIS), SOLVERS, one_segment=True
            )
            runs += [TrainingRun(name, four, conditions, (OURS,), SOLVERS), spectra]
    return Experiment("slants", same_conditions(runs), orientations_deg)


def _thirty(
    frame_px: int, orientations_deg: tuple[float, ...], slants_deg: Sequence[float], quick: bool
) -> Experiment:
    """Figures 9.11 and 9.13, table 9.1: the thirty textures of the chapter."""
    textures, runs = thirty_textures(quick), []
    for slant_deg in slants_deg:
        conditions = Conditions(slant_deg, frame_px)
        name = f"slant {slant_deg:g}"
        runs += [
            TrainingRun(name, textures, conditions, CLASSIFIER_NAMES, SOLVERS),
            TrainingRun(
                name + ONE_SEGMENT, textures, conditions, SPECTRA_CLASSIFIERS, SOLVERS,
                one_segment=True,
            ),
            TrainingRun(
                name + WITH_28_IMAGES, textures, conditions, (TEXTONS,), SOLVERS[-1:],
                _ORIENTATIONS_FOR_28_IMAGES_DEG,
            ),
        ]  # fmt: skip
    return Experiment("thirty", same_conditions(runs), orientations_deg, ("rotated", "disjoint"))
