"""The experiments of a reproduction: textures, conditions, orientations, in full or quick."""

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
    Exam,
    Experiment,
    Lesson,
    Plan,
)
from .scenes import Conditions, Texture

__all__ = ["material_textures", "plan_of", "thirty_textures", "turns_deg_for"]

# Seven sets of four images are the 28 training images a class of table 9.1.
_TURNS_OF_28_IMAGES_DEG = tuple(180.0 * i / 7 for i in range(7))
# Beside the 8 materials that ship they make 30. Left out are eight that differ little from
# another one of the 30.
_NOT_AMONG_22 = (
    "rock_smooth", "malv_near", "ripples_near", "ripples_wavy", "lattice", "rock_speckled",
    "sand_striped", "ridged_tinted",
)  # fmt: skip


def turns_deg_for(count: int) -> tuple[float, ...]:
    """Orientations spread over half a turn, unevenly, none of them a multiple of 90."""
    return tuple(7.0 + 180.0 * i / count + 1.3 * (i % 3) for i in range(count))


def material_textures(folder: Path | None) -> tuple[Texture, ...]:
    """The material folders below `folder`; those that ship if none is given.

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
        if any((path / name).is_file() for name in ("height.png", "normal.png", "normal.jpg"))
    )
    if len(found) < 2:
        raise InputError(
            f"{folder}: holds {len(found)} material folders; give at least two, each with a "
            "height.png or a normal.png"
        )
    return found


def plan_of(quick: bool, materials: tuple[Texture, ...]) -> Plan:
    """The full plan, or one that is done within two minutes."""
    frame_px = 128 if quick else 256
    turns_deg = turns_deg_for(12 if quick else 24)
    chapter_slants_deg = (45.0, 65.0)
    material_sizes_px = (128, 256) if quick else (128, 256, 320)
    return Plan(
        quick=quick,
        frame_px=frame_px,
        chapter_slants_deg=chapter_slants_deg,
        material_sizes_px=material_sizes_px,
        rejection_size_px=256,
        slants=_slants(frame_px, turns_deg, quick),
        thirty=_thirty(frame_px, turns_deg, chapter_slants_deg, quick),
        synthetic=_synthetic(frame_px, turns_deg, quick),
        materials=_materials(_some(materials, quick), material_sizes_px, turns_deg),
        robustness=_robustness(2 * frame_px, turns_deg_for(12), quick),
    )


def _some(materials: tuple[Texture, ...], quick: bool) -> tuple[Texture, ...]:
    """All of them, or for a quick plan at most six from the whole range."""
    return materials[:: -(-len(materials) // 6)] if quick else materials


def thirty_textures(quick: bool) -> tuple[Texture, ...]:
    """22 synthetic ones and the 8 materials that ship; every fourth of them if quick."""
    synthetic = [name for name in SYNTHETIC_30 if name not in _NOT_AMONG_22]
    textures = _synthetic_textures(synthetic) + material_textures(None)
    return textures[::4] if quick else textures


def _synthetic_textures(names: Iterable[str]) -> tuple[Texture, ...]:
    return tuple(Texture(name) for name in names)


def _slants(frame_px: int, turns_deg: tuple[float, ...], quick: bool) -> Experiment:
    """Figure 9.1: the four surfaces of the thesis, with and without shadow."""
    slants_deg = (40, 60, 80) if quick else (10, 20, 30, 40, 50, 60, 70, 80)
    four = _synthetic_textures(SYNTHETIC_TEXTURES[:4])
    exams = []
    for slant_deg in slants_deg:
        for shadows in (False, True):
            conditions = Conditions(float(slant_deg), frame_px, shadows=shadows)
            name = f"slant {slant_deg} {'with' if shadows else 'without'} shadow"
            lessons = (
                Lesson(name, four, conditions, (OURS,), SOLVERS),
                Lesson(
                    name + ONE_SEGMENT, four, conditions, (ONE_D, THESIS), SOLVERS, one_segment=True
                ),
            )
            exams += [Exam(lesson.name, lesson, conditions) for lesson in lessons]
    return Experiment("slants", tuple(exams), turns_deg)


def _thirty(
    frame_px: int, turns_deg: tuple[float, ...], slants_deg: Sequence[float], quick: bool
) -> Experiment:
    """Figures 9.11 and 9.13, table 9.1: the thirty textures of the chapter."""
    textures = thirty_textures(quick)
    exams = []
    for slant_deg in slants_deg:
        conditions = Conditions(slant_deg, frame_px)
        name = f"slant {slant_deg:g}"
        lessons = (
            Lesson(name, textures, conditions, CLASSIFIER_NAMES, SOLVERS),
            Lesson(
                name + ONE_SEGMENT, textures, conditions, OF_SPECTRA, SOLVERS, one_segment=True
            ),
            Lesson(
                name + OF_28_IMAGES, textures, conditions, (TEXTONS,), SOLVERS[-1:],
                turns_deg=_TURNS_OF_28_IMAGES_DEG,
            ),
        )  # fmt: skip
        exams += [Exam(lesson.name, lesson, conditions) for lesson in lessons]
    return Experiment("thirty", tuple(exams), turns_deg, ("turned", "disjoint"))


def _synthetic(frame_px: int, turns_deg: tuple[float, ...], quick: bool) -> Experiment:
    """All classifiers on the synthetic 30; with the twins; on patches of half the side."""
    names = SYNTHETIC_30[::6] if quick else SYNTHETIC_30
    originals = EQUAL_SPECTRUM_TWINS.values()
    names = tuple(name for name in SYNTHETIC_30 if name in names or name in originals)
    textures = _synthetic_textures(names)
    with_twins = textures + _synthetic_textures(EQUAL_SPECTRUM_TWINS)
    compared: tuple[str, ...] = (OURS, THESIS, ONE_D)
    exams = []
    for slant_deg in (30, 50, 70):
        whole = Conditions(float(slant_deg), frame_px, bits=8)
        small = Conditions(float(slant_deg), frame_px // 2, bits=8)
        for name, learned, conditions, classifiers in (
            (f"slant {slant_deg}", textures, whole, CLASSIFIER_NAMES),
            (f"slant {slant_deg}, twins", with_twins, whole, compared),
            (f"slant {slant_deg}, small", textures, small, compared),
        ):
            rejecting = conditions == whole and learned == textures
            lesson = Lesson(name, learned, conditions, classifiers, SOLVERS, rejecting=rejecting)
            exams.append(Exam(name, lesson, conditions))
    return Experiment("synthetic", tuple(exams), turns_deg)


def _materials(
    textures: tuple[Texture, ...], sizes_px: Sequence[int], turns_deg: tuple[float, ...]
) -> Experiment:
    """Scanned materials at slant 45, patches of several sizes, both protocols."""
    exams = []
    for size_px in sizes_px:
        name = f"{size_px} px"
        conditions = Conditions(45.0, size_px)
        lesson = Lesson(
            name,
            textures,
            conditions,
            (OURS, *OF_SPECTRA),
            SOLVERS[1:],
            rejecting=size_px == 256,
        )
        exams.append(Exam(name, lesson, conditions))
    return Experiment("materials", tuple(exams), turns_deg, ("turned", "disjoint"))


def _robustness(size_px: int, turns_deg: tuple[float, ...], quick: bool) -> Experiment:
    """Tests under other conditions than those learned: slant 45, 16 bit."""
    textures = _synthetic_textures(SYNTHETIC_30[::5] if quick else SYNTHETIC_30)
    learned = Conditions(45.0, size_px, bits=16)
    half = Conditions(45.0, size_px // 2, bits=16)
    classifiers = (OURS, THESIS)
    lesson = Lesson("whole", textures, learned, classifiers, SOLVERS[-1:])
    half_lesson = Lesson("half", textures, half, classifiers, SOLVERS[-1:])
    exams = (
        Exam("as learned", lesson, learned),
        Exam("exposure halved", lesson, Conditions(45.0, size_px, 16, exposure=0.5)),
        Exam("one LED 5 % weak", lesson, Conditions(45.0, size_px, 16, weak_led=0.95)),
        Exam("8 bit", lesson, Conditions(45.0, size_px, 8)),
        Exam(f"{size_px // 2} px, learned at {size_px} px", lesson, half),
        Exam(f"{size_px // 2} px, learned so too", half_lesson, half),
        Exam("slant 40", lesson, Conditions(40.0, size_px, 16)),
        Exam("slant 50", lesson, Conditions(50.0, size_px, 16)),
    )
    return Experiment("robustness", exams, turns_deg)
