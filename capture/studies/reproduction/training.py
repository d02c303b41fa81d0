"""Lessons: what is learned goes into library files, which every worker can read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from classify import Lighting, Method, TextureLibrary
from classify.classifiers import Observation
from classify.library.training import TrainingRow, observe

from .plan import BEST_SOLVER, OURS, Experiment, Lesson
from .rejection import quartered
from .scenes import Patch

__all__ = ["TrainingTask", "library_path", "quarters_path", "train", "training_tasks"]


@dataclass(frozen=True)
class TrainingTask:
    """The lessons of an experiment under lights of one slant: they share their scenes."""

    experiment: Experiment
    lessons: tuple[Lesson, ...]
    folder: Path


def training_tasks(experiment: Experiment, folder: Path) -> list[TrainingTask]:
    """Tasks of much the same length."""
    groups: dict[tuple[float, tuple[float, ...]], list[Lesson]] = {}
    for lesson in experiment.lessons:
        groups.setdefault((lesson.conditions.slant_deg, lesson.turns_deg), []).append(lesson)
    return [TrainingTask(experiment, tuple(lessons), folder) for lessons in groups.values()]


def library_path(
    folder: Path, experiment: str, lesson: str, solver: Method, classifier: str
) -> Path:
    """The file of one library."""
    return folder / f"{experiment} {lesson} {solver} {classifier}.ps4lib"


def quarters_path(folder: Path, experiment: str, lesson: str) -> Path:
    """The file with the quarters of what our classifier learned."""
    return folder / f"{experiment} {lesson} quarters.ps4lib"


def train(task: TrainingTask) -> int:
    """Write the libraries of some lessons; returns how many."""
    name, frame_px = task.experiment.name, task.experiment.frame_px
    slant_deg, turns_deg = task.lessons[0].conditions.slant_deg, task.lessons[0].turns_deg
    rows: dict[_Library, list[TrainingRow]] = {}
    for texture in dict.fromkeys(t for lesson in task.lessons for t in lesson.textures):
        for turn_deg in turns_deg:
            patch = Patch(task.experiment.learned_place(texture, turn_deg), frame_px)
            for lesson in task.lessons:
                if texture not in lesson.textures:
                    continue
                for library, observation in _observed(patch, lesson, task.folder, name):
                    row = TrainingRow(texture.name, observation, turn_deg)
                    rows.setdefault(library, []).append(row)
    lighting = Lighting.ring(slant_deg)
    for library, learned in rows.items():
        TextureLibrary.from_observations(
            learned, library.segment_px, library.classifier, lighting=lighting, simulated=True
        ).save(library.path)
    return len(rows)


@dataclass(frozen=True)
class _Library:
    path: Path
    classifier: str
    segment_px: int


def _observed(
    patch: Patch, lesson: Lesson, folder: Path, experiment: str
) -> Iterator[tuple[_Library, Observation]]:
    """What each library of a lesson gets of a patch."""
    for solver, classifier in lesson.systems:
        path = library_path(folder, experiment, lesson.name, solver, classifier)
        yield (
            _Library(path, classifier, lesson.segment_px),
            patch.observation(lesson.conditions, solver, classifier, lesson.segment_px, train=True),
        )
    if lesson.rejecting:
        path = quarters_path(folder, experiment, lesson.name)
        segment_px = lesson.segment_px // 2
        for quarter in quartered(patch.estimate(lesson.conditions, BEST_SOLVER)):
            yield _Library(path, OURS, segment_px), observe(quarter, segment_px, OURS)
