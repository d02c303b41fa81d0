"""Lessons: what is learned goes into library files, which every worker can read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from classify import Lighting, Method, TextureLibrary
from classify.library import TrainingRow

from .plan import BEST_SOLVER, OURS, Experiment, Lesson
from .rejection import quarter_library
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
    experiment = task.experiment
    rows: dict[tuple[Lesson, Method, str], list[TrainingRow]] = {}
    textures = dict.fromkeys(texture for lesson in task.lessons for texture in lesson.textures)
    for texture in textures:
        for turn_deg in task.lessons[0].turns_deg:
            patch = Patch(experiment.learned_place(texture, turn_deg), experiment.frame_px)
            for lesson in task.lessons:
                if texture not in lesson.textures:
                    continue
                for solver, classifier in lesson.systems:
                    observation = patch.observation(
                        lesson.conditions, solver, classifier, lesson.segment_px, train=True
                    )
                    row = TrainingRow(texture.name, observation, turn_deg)
                    rows.setdefault((lesson, solver, classifier), []).append(row)
    for (lesson, solver, classifier), learned in rows.items():
        library = TextureLibrary.from_observations(
            learned,
            lesson.segment_px,
            classifier,
            lighting=Lighting.ring(lesson.conditions.slant_deg),
            simulated=True,
        )
        name = experiment.name
        library.save(library_path(task.folder, name, lesson.name, solver, classifier))
        if lesson.rejecting and (solver, classifier) == (BEST_SOLVER, OURS):
            quarters = quarter_library(library, [row.observation for row in learned])
            quarters.save(quarters_path(task.folder, name, lesson.name))
    return len(rows)

