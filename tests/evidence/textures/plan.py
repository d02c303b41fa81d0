"""Plan of the study of textures: experiments beyond the chapter."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

from capture.chapter.plan import (
    BEST_SOLVER,
    ONE_D,
    OURS,
    SOLVERS,
    SPECTRA_CLASSIFIERS,
    THESIS,
    Conditions,
    Experiment,
    Place,
    TestRun,
    Texture,
    TrainingRun,
    plan_of,
    same_conditions,
    spread_orientations_deg,
    synthetic_textures,
)
from classify.methods import CLASSIFIER_NAMES
from rig import EQUAL_SPECTRUM_TWINS, SYNTHETIC_30

from .faults import ALL_FAULTS, NEAR_LEDS, OTHER_RIG, OUT_OF_FOCUS

_TRAINED_PLACES: tuple[Place, ...] = ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5))
# On a tile of 512 px, tested frames of 128 px share no pixel with trained ones, in any orientation.
# No frame crosses the edge of the tile, where a material that is not seamless has a seam.
_SMALL_TRAINED: tuple[Place, ...] = ((0.0, 0.0), (0.31, 0.31), (-0.31, -0.31))
_SMALL_TESTED: tuple[Place, ...] = tuple(itertools.permutations((0.0, 0.31, -0.31), 2))


@dataclass(frozen=True)
class OpenSetRun(TrainingRun):
    """A training run whose tests are also matched without their own class."""


@dataclass(frozen=True)
class TexturePlan:
    """All experiments of the study; `thirty` are the textures of the chapter."""

    quick: bool
    frame_px: int
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
            self.thirty, self.synthetic, self.materials, self.robustness, self.days,
            self.small_frames,
        )  # fmt: skip


def texture_plan(quick: bool, materials: tuple[Texture, ...]) -> TexturePlan:
    """The full plan, or a quick one that takes three minutes on two cores."""
    frame_px, materials_px = (128, (128, 256)) if quick else (256, (128, 256, 320))
    orientations_deg, twelve_deg = (
        spread_orientations_deg(count) for count in (12 if quick else 24, 12)
    )
    if quick:
        materials = materials[:: -(-len(materials) // 6)]
    return TexturePlan(
        quick=quick,
        frame_px=frame_px,
        thirty=_thirty(quick),
        synthetic=_synthetic(frame_px, orientations_deg, quick),
        materials=_materials(materials, materials_px, orientations_deg),
        robustness=_robustness(2 * frame_px, twelve_deg, quick),
        days=_days(materials, twelve_deg),
        small_frames=_small_frames(materials, twelve_deg),
    )


def _thirty(quick: bool) -> Experiment:
    """The textures of the chapter on disjoint patches, by the classifiers of `orientation`."""
    thirty = plan_of(quick).thirty
    tests = []
    for test in thirty.tests:
        if OURS in test.training.classifiers:
            run = replace(test.training, classifiers=(OURS, THESIS), solvers=(BEST_SOLVER,))
            tests.append(replace(test, training=run))
    return replace(thirty, tests=tuple(tests), protocols=("disjoint",))


def _synthetic(frame_px: int, orientations_deg: tuple[float, ...], quick: bool) -> Experiment:
    """All classifiers on the synthetic 30; some with the twins and on patches of half the side."""
    chosen = {*(SYNTHETIC_30[::6] if quick else SYNTHETIC_30), *EQUAL_SPECTRUM_TWINS.values()}
    textures = synthetic_textures(name for name in SYNTHETIC_30 if name in chosen)
    with_twins = textures + synthetic_textures(EQUAL_SPECTRUM_TWINS)
    compared = (OURS, THESIS, ONE_D)
    runs = []
    for slant_deg in (30, 50, 70):
        large = Conditions(float(slant_deg), frame_px, bits=8)
        small = Conditions(float(slant_deg), frame_px // 2, bits=8)
        name = f"slant {slant_deg}"
        runs += [
            OpenSetRun(name, textures, large, CLASSIFIER_NAMES, SOLVERS),
            TrainingRun(f"{name}, twins", with_twins, large, compared, SOLVERS),
            TrainingRun(f"{name}, small", textures, small, compared, SOLVERS),
        ]
    return Experiment("synthetic", same_conditions(runs), orientations_deg)


def _materials(
    textures: tuple[Texture, ...], sizes_px: Sequence[int], orientations_deg: tuple[float, ...]
) -> Experiment:
    """Scanned materials at slant 45, patches of several sizes, both protocols."""
    classifiers = (OURS, *SPECTRA_CLASSIFIERS)
    runs = []
    for size_px in sizes_px:
        kind, at = OpenSetRun if size_px == 256 else TrainingRun, Conditions(45.0, size_px)
        runs.append(kind(f"{size_px} px", textures, at, classifiers, SOLVERS[1:]))
    tests = same_conditions(runs)
    return Experiment("materials", tests, orientations_deg, ("rotated", "disjoint"))


def _robustness(size_px: int, orientations_deg: tuple[float, ...], quick: bool) -> Experiment:
    """Tests under other conditions than training: slant 45, 16 bit."""
    textures = synthetic_textures(SYNTHETIC_30[::5] if quick else SYNTHETIC_30)
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
    return Experiment("days", (*tests, *same_conditions([three])), orientations_deg)


def _small_frames(textures: tuple[Texture, ...], orientations_deg: tuple[float, ...]) -> Experiment:
    """Unknown textures by the number of sets, frames of 128 px at several places."""
    usual = Conditions(45.0, 128)
    places = [(place,) for place in _SMALL_TRAINED] + [_SMALL_TRAINED]
    tests = same_conditions(_open_set(textures, usual, each) for each in places)
    return Experiment("small_frames", tests, orientations_deg, tested_places=_SMALL_TESTED)


def _open_set(
    textures: tuple[Texture, ...], conditions: Conditions, places: tuple[Place, ...]
) -> OpenSetRun:
    """A training run of one set at each place, each in another orientation."""
    where = ", ".join(f"{right:g} {up:g}" for right, up in places)
    return OpenSetRun(
        f"{conditions.size_px} px at {where}", textures, conditions, (OURS,), (BEST_SOLVER,),
        (0.0, 90.0, 180.0)[: len(places)], places=places,
    )  # fmt: skip
