"""Plan of a reproduction: textures, conditions, training, tests, experiments."""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from classify.base.errors import InputError
from classify.classifiers import classifier_named
from classify.methods import CLASSIFIER_NAMES, Method
from classify.texture.spectra import segment_for
from rig import EQUAL_SPECTRUM_TWINS, SYNTHETIC_30, SYNTHETIC_TEXTURES
from rig.scene.material_folder import bundled_materials

from .faults import ALL_FAULTS, NEAR_LEDS, NO_FAULTS, OTHER_RIG, OUT_OF_FOCUS, Faults

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

# Seven sets of four images are the 28 training images of each class in table 9.1.
_ORIENTATIONS_OF_28_IMAGES_DEG = tuple(180.0 * i / 7 for i in range(7))
# The other 22 of the 30 and the 8 bundled materials make the 30 textures of the chapter. Each of
# these eight differs little from another one of the 30.
_NOT_AMONG_22 = (
    "rock_smooth", "malv_near", "ripples_near", "ripples_wavy", "lattice", "rock_speckled",
    "sand_striped", "ridged_tinted",
)  # fmt: skip
_MATERIAL_MAPS = ("height.png", "normal.png", "normal.jpg")


Place = tuple[float, float]
"""Right and up of the centre of a material, in tiles."""

# Places of training patches, the first for one patch, and the place of disjoint tests.
_TRAINED_PLACES: tuple[Place, ...] = ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5))
_TESTED_PLACES: tuple[Place, ...] = ((0.5, 0.5),)
# On a tile of 512 px, tested frames of 128 px share no pixel with trained ones, in any orientation.
# No frame crosses the edge of the tile, where a material that is not seamless has a seam.
_SMALL_TRAINED: tuple[Place, ...] = ((0.0, 0.0), (0.31, 0.31), (-0.31, -0.31))
_SMALL_TESTED: tuple[Place, ...] = tuple(itertools.permutations((0.0, 0.31, -0.31), 2))


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

    Without `shadows`, light passes through the relief, is negative where the surface faces away,
    and is not clipped. No camera can take such images.
    """

    slant_deg: float
    size_px: int  # side of the frame; smaller frames are the middle of larger ones
    bits: int = 12
    shadows: bool = True
    exposure: float = 1.0  # relative to the 20 ms that fill 85 % of the well for white
    weak_led: float = 1.0  # level of the second LED, unknown to the solver
    # Not in the text from which the noise is drawn, so that it is that of the set without faults.
    faults: Faults = field(default=NO_FAULTS, repr=False)


@dataclass(frozen=True)
class TrainingRun:
    """Libraries trained on one or more sets of each texture under the same conditions.

    With `one_segment`, a spectrum is one periodogram of the whole frame, not an average over
    segments. With `tests_unknown`, each test is also matched without its own class. The sets of a
    texture are of patches at `places`: all of one patch, or each of its own.
    """

    name: str
    textures: tuple[Texture, ...]
    conditions: Conditions
    classifiers: tuple[str, ...]
    solvers: tuple[Method, ...]
    orientations_deg: tuple[float, ...] = (0.0,)  # of the sets
    one_segment: bool = False
    tests_unknown: bool = False
    places: tuple[Place, ...] = _TRAINED_PLACES[:1]

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
    tested_places: tuple[Place, ...] = _TESTED_PLACES  # of disjoint tests, in turn

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
        return max(at.size_px for at in conditions | {run.conditions for run in self.training})

    @property
    def facts(self) -> dict[str, object]:
        """Numbers of the first training run for the text of exhibits."""
        first, tests = self.training[0], len(self.orientations_deg)
        return {
            "classes": len(first.textures), "size": first.conditions.size_px, "tests": tests,
        }  # fmt: skip

    def test_position(self, texture: Texture, number: int, protocol: Protocol) -> PatchPosition:
        """Position of a test patch. The seed of the training patch is 0."""
        seed, place = 0, _TRAINED_PLACES[0]
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
    synthetic: Experiment
    materials: Experiment
    robustness: Experiment
    days: Experiment
    small_frames: Experiment

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """All experiments."""
        return (
            self.slants, self.thirty, self.synthetic, self.materials, self.robustness, self.days,
            self.small_frames,
        )  # fmt: skip


def spread_orientations_deg(count: int) -> tuple[float, ...]:
    """Orientations over 180 degrees, unevenly spaced, none of them a multiple of 90."""
    return tuple(7.0 + 180.0 * i / count + 1.3 * (i % 3) for i in range(count))


def material_textures(folder: Path | None) -> tuple[Texture, ...]:
    """The material folders in `folder`, by default the bundled ones.

    Raises
    ------
    InputError
        If there are fewer than two.
    """
    if folder is None:
        return tuple(Texture(name, path) for name, path in bundled_materials().items())
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; give one that holds material folders")
    found = tuple(
        Texture(path.name, path.absolute())
        for path in sorted(folder.iterdir())
        if any((path / name).is_file() for name in _MATERIAL_MAPS)
    )
    if len(found) < 2:
        raise InputError(
            f"{folder}: holds {len(found)} material folders; give at least two, each with a "
            "height.png or a normal.png"
        )
    return found


def thirty_textures(quick: bool) -> tuple[Texture, ...]:
    """22 synthetic textures and the 8 bundled materials; every fourth of them if quick."""
    synthetic = [name for name in SYNTHETIC_30 if name not in _NOT_AMONG_22]
    textures = _synthetic_textures(synthetic) + material_textures(None)
    return textures[::4] if quick else textures


def plan_of(quick: bool, materials: tuple[Texture, ...]) -> Plan:
    """The full plan, or a quick one that takes three minutes on two cores."""
    frame_px, materials_px = (128, (128, 256)) if quick else (256, (128, 256, 320))
    orientations_deg = spread_orientations_deg(12 if quick else 24)
    slants_deg = (45.0, 65.0)  # little shadow and much
    if quick:
        materials = materials[:: -(-len(materials) // 6)]
    return Plan(
        quick=quick,
        frame_px=frame_px,
        chapter_slants_deg=slants_deg,
        slants=_slants(frame_px, orientations_deg, quick),
        thirty=_thirty(frame_px, orientations_deg, slants_deg, quick),
        synthetic=_synthetic(frame_px, orientations_deg, quick),
        materials=_materials(materials, materials_px, orientations_deg),
        robustness=_robustness(2 * frame_px, spread_orientations_deg(12), quick),
        days=_days(materials, spread_orientations_deg(12)),
        small_frames=_small_frames(materials, spread_orientations_deg(12)),
    )


def _synthetic_textures(names: Iterable[str]) -> tuple[Texture, ...]:
    return tuple(Texture(name) for name in names)


def _same_conditions(runs: Iterable[TrainingRun]) -> tuple[TestRun, ...]:
    """Tests under the conditions of the training."""
    return tuple(TestRun(run.name, run, run.conditions) for run in runs)


def _slants(frame_px: int, orientations_deg: tuple[float, ...], quick: bool) -> Experiment:
    """Figure 9.1: the four surfaces of the thesis, with and without shadow."""
    four = _synthetic_textures(SYNTHETIC_TEXTURES[:4])
    runs = []
    for slant_deg in (40, 60, 80) if quick else range(10, 90, 10):
        for shadows in (False, True):
            at = Conditions(float(slant_deg), frame_px, shadows=shadows)
            name = f"slant {slant_deg} {'with' if shadows else 'without'} shadow"
            spectra = TrainingRun(
                name + ONE_SEGMENT, four, at, (ONE_D, THESIS), SOLVERS, one_segment=True
            )
            runs += [TrainingRun(name, four, at, (OURS,), SOLVERS), spectra]
    return Experiment("slants", _same_conditions(runs), orientations_deg)


def _thirty(
    frame_px: int, orientations_deg: tuple[float, ...], slants_deg: Sequence[float], quick: bool
) -> Experiment:
    """Figures 9.11 and 9.13, table 9.1: the thirty textures of the chapter."""
    textures, runs = thirty_textures(quick), []
    for slant_deg in slants_deg:
        at = Conditions(slant_deg, frame_px)
        name = f"slant {slant_deg:g}"
        runs += [
            TrainingRun(name, textures, at, CLASSIFIER_NAMES, SOLVERS),
            TrainingRun(name + ONE_SEGMENT, textures, at, OF_SPECTRA, SOLVERS, one_segment=True),
            TrainingRun(
                name + OF_28_IMAGES, textures, at, (TEXTONS,), SOLVERS[-1:],
                _ORIENTATIONS_OF_28_IMAGES_DEG,
            ),
        ]  # fmt: skip
    return Experiment("thirty", _same_conditions(runs), orientations_deg, ("rotated", "disjoint"))


def _synthetic(frame_px: int, orientations_deg: tuple[float, ...], quick: bool) -> Experiment:
    """All classifiers on the synthetic 30; some with the twins and on patches of half the side."""
    chosen = {*(SYNTHETIC_30[::6] if quick else SYNTHETIC_30), *EQUAL_SPECTRUM_TWINS.values()}
    textures = _synthetic_textures(name for name in SYNTHETIC_30 if name in chosen)
    with_twins = textures + _synthetic_textures(EQUAL_SPECTRUM_TWINS)
    compared = (OURS, THESIS, ONE_D)
    runs = []
    for slant_deg in (30, 50, 70):
        large = Conditions(float(slant_deg), frame_px, bits=8)
        small = Conditions(float(slant_deg), frame_px // 2, bits=8)
        name = f"slant {slant_deg}"
        runs += [
            TrainingRun(name, textures, large, CLASSIFIER_NAMES, SOLVERS, tests_unknown=True),
            TrainingRun(f"{name}, twins", with_twins, large, compared, SOLVERS),
            TrainingRun(f"{name}, small", textures, small, compared, SOLVERS),
        ]
    return Experiment("synthetic", _same_conditions(runs), orientations_deg)


def _materials(
    textures: tuple[Texture, ...], sizes_px: Sequence[int], orientations_deg: tuple[float, ...]
) -> Experiment:
    """Scanned materials at slant 45, patches of several sizes, both protocols."""
    runs = [
        TrainingRun(
            f"{size_px} px", textures, Conditions(45.0, size_px), (OURS, *OF_SPECTRA),
            SOLVERS[1:], tests_unknown=size_px == 256,
        )
        for size_px in sizes_px
    ]  # fmt: skip
    tests = _same_conditions(runs)
    return Experiment("materials", tests, orientations_deg, ("rotated", "disjoint"))


def _robustness(size_px: int, orientations_deg: tuple[float, ...], quick: bool) -> Experiment:
    """Tests under other conditions than training: slant 45, 16 bit."""
    textures = _synthetic_textures(SYNTHETIC_30[::5] if quick else SYNTHETIC_30)
    usual, half = Conditions(45.0, size_px, 16), Conditions(45.0, size_px // 2, 16)
    large, small = (
        TrainingRun(name, textures, at, (OURS, THESIS), SOLVERS[-1:])
        for name, at in (("large", usual), ("small", half))
    )
    tests = (
        TestRun("as trained", large, usual),
        TestRun("exposure halved", large, Conditions(45.0, size_px, 16, exposure=0.5)),
        TestRun("one LED 5 % weak", large, Conditions(45.0, size_px, 16, weak_led=0.95)),
        TestRun("8 bit", large, Conditions(45.0, size_px, 8)),
        TestRun(f"{size_px // 2} px, trained at {size_px} px", large, half),
        TestRun(f"{size_px // 2} px, trained at this size", small, half),
        TestRun("slant 40", large, Conditions(40.0, size_px, 16)),
        TestRun("slant 50", large, Conditions(50.0, size_px, 16)),
    )
    return Experiment("robustness", tests, orientations_deg)


def _days(textures: tuple[Texture, ...], orientations_deg: tuple[float, ...]) -> Experiment:
    """Faults in the tests only, and unknown textures by the number of sets: frames of 256 px."""
    usual = Conditions(45.0, 256)
    one, three = (_open_set(textures, usual, _TRAINED_PLACES[:sets]) for sets in (1, 3))
    faulty = (
        ("focus: blur of 0.5 to 1.1 px", replace(usual, faults=OUT_OF_FOCUS)),
        ("near LEDs: fall-off of 25 %", replace(usual, faults=NEAR_LEDS)),
        ("another rig", replace(usual, faults=OTHER_RIG, exposure=1.0 / 3.0)),
        ("all together", replace(usual, faults=ALL_FAULTS, exposure=1.0 / 3.0)),
    )
    tests = [TestRun("none", one, usual)]
    tests += [TestRun(name, one, conditions) for name, conditions in faulty]
    return Experiment("days", (*tests, *_same_conditions([three])), orientations_deg)


def _small_frames(textures: tuple[Texture, ...], orientations_deg: tuple[float, ...]) -> Experiment:
    """Unknown textures by the number of sets, frames of 128 px at several places."""
    usual = Conditions(45.0, 128)
    places = [(place,) for place in _SMALL_TRAINED] + [_SMALL_TRAINED]
    tests = _same_conditions(_open_set(textures, usual, each) for each in places)
    return Experiment("small_frames", tests, orientations_deg, tested_places=_SMALL_TESTED)


def _open_set(
    textures: tuple[Texture, ...], conditions: Conditions, places: tuple[Place, ...]
) -> TrainingRun:
    """A training run of one set at each place, each in another orientation."""
    where = ", ".join(f"{right:g} {up:g}" for right, up in places)
    return TrainingRun(
        f"{conditions.size_px} px at {where}", textures, conditions, (OURS,), (BEST_SOLVER,),
        (0.0, 90.0, 180.0)[: len(places)], tests_unknown=True, places=places,
    )  # fmt: skip
