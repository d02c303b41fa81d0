"""The experiments of a reproduction: textures, conditions, orientations, full or quick."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from classify.errors import InputError
from classify.methods import CLASSIFIER_NAMES
from rig import EQUAL_SPECTRUM_TWINS, SYNTHETIC_30, SYNTHETIC_TEXTURES
from rig.scene.material_folder import bundled_materials

from .plan import (
    OF_28_IMAGES,
    OF_SPECTRA,
    ONE_D,
    ONE_SEGMENT,
    OURS,
    SOLVERS,
    TEXTONS,
    THESIS,
    Conditions,
    Experiment,
    Plan,
    TestRun,
    Texture,
    TrainingRun,
)

__all__ = ["material_textures", "plan_of", "spread_orientations_deg", "thirty_textures"]

# Seven sets of four images are the 28 training images of each class in table 9.1.
_ORIENTATIONS_OF_28_IMAGES_DEG = tuple(180.0 * i / 7 for i in range(7))
# The other 22 of the 30 and the 8 bundled materials make the 30 textures of the chapter. Each of
# these eight differs little from another one of the 30.
_NOT_AMONG_22 = (
    "rock_smooth", "malv_near", "ripples_near", "ripples_wavy", "lattice", "rock_speckled",
    "sand_striped", "ridged_tinted",
)  # fmt: skip
_MATERIAL_MAPS = ("height.png", "normal.png", "normal.jpg")


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
    """The full plan, or one of two minutes on two cores."""
    frame_px = 128 if quick else 256
    orientations_deg = spread_orientations_deg(12 if quick else 24)
    slants_deg = (45.0, 65.0)  # with little shadow and with much
    if quick:
        materials = materials[:: -(-len(materials) // 6)]
    return Plan(
        quick=quick,
        frame_px=frame_px,
        chapter_slants_deg=slants_deg,
        slants=_slants(frame_px, orientations_deg, quick),
        thirty=_thirty(frame_px, orientations_deg, slants_deg, quick),
        synthetic=_synthetic(frame_px, orientations_deg, quick),
        materials=_materials(materials, (128, 256) if quick else (128, 256, 320), orientations_deg),
        robustness=_robustness(2 * frame_px, spread_orientations_deg(12), quick),
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
            spectra = (ONE_D, THESIS)
            runs += [
                TrainingRun(name, four, at, (OURS,), SOLVERS),
                TrainingRun(name + ONE_SEGMENT, four, at, spectra, SOLVERS, one_segment=True),
            ]
    return Experiment("slants", _same_conditions(runs), orientations_deg)


def _thirty(
    frame_px: int, orientations_deg: tuple[float, ...], slants_deg: Sequence[float], quick: bool
) -> Experiment:
    """Figures 9.11 and 9.13, table 9.1: the thirty textures of the chapter."""
    textures = thirty_textures(quick)
    runs = []
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
