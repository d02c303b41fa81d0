"""Exams: turned patches, and what each library answers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from classify import Method, TextureLibrary
from classify.classifiers import classifier_named
from classify.surface.estimate import FloatMap

from .plan import BEST_SOLVER, OURS, THESIS, Exam, Experiment, Protocol
from .rejection import References, ScorePair, distance_pair, without
from .scenes import Patch, Texture
from .training import library_path, quarters_path

__all__ = ["Answer", "ExamResult", "ExamTask", "Rejection", "exam_tasks", "take_exam"]


@dataclass(frozen=True)
class ExamTask:
    """One patch under all conditions of an experiment, against all its libraries."""

    experiment: Experiment
    texture: Texture
    test: int
    protocol: Protocol
    folder: Path


class Answer(NamedTuple):
    """What one library says of one patch. Angles in degrees, modulo 180."""

    experiment: str
    exam: str
    protocol: str
    solver: str
    classifier: str
    texture: str
    turn_deg: float
    nearest: str
    found_deg: float | None
    sharpness: float | None
    rejected: bool

    @property
    def right(self) -> bool:
        """Whether the nearest class is the true one."""
        return self.nearest == self.texture


class Rejection(NamedTuple):
    """Scores of one patch, and whether our library calls it unknown.

    `rejected_unknown` is what it says when it has not learned the texture of the patch.
    """

    experiment: str
    exam: str
    protocol: str
    texture: str
    pairs: dict[str, ScorePair]
    rejected: bool
    rejected_unknown: bool


class ExamResult(NamedTuple):
    """All that one patch gave."""

    answers: list[Answer]
    rejections: list[Rejection]


def exam_tasks(experiment: Experiment, folder: Path) -> Iterable[ExamTask]:
    """All patches of an experiment. Those of one texture follow each other and share its tile."""
    for texture in experiment.textures:
        for protocol in experiment.protocols:
            for test in range(len(experiment.turns_deg)):
                yield ExamTask(experiment, texture, test, protocol, folder)


def take_exam(task: ExamTask) -> ExamResult:
    """Ask all libraries about one patch."""
    experiment, texture = task.experiment, task.texture
    place = experiment.test_place(texture, task.test, task.protocol)
    patch = Patch(place, experiment.frame_px)
    result = ExamResult([], [])
    for exam in experiment.exams:
        if texture not in exam.lesson.textures:
            continue
        for solver, classifier in exam.lesson.systems:
            result.answers.append(_answer(task, patch, exam, solver, classifier))
        if exam.lesson.rejecting:
            result.rejections.append(_rejection(task, patch, exam))
    return result


def _answer(task: ExamTask, patch: Patch, exam: Exam, solver: Method, classifier: str) -> Answer:
    library = _library(task, exam, solver, classifier)
    match = library.match(_signature(patch, exam, solver, library))
    return Answer(
        experiment=task.experiment.name,
        exam=exam.name,
        protocol=task.protocol,
        solver=solver,
        classifier=classifier,
        texture=task.texture.name,
        turn_deg=patch.place.rotate_deg,
        nearest=match.nearest,
        found_deg=match.orientation_deg,
        sharpness=match.sharpness,
        rejected=match.label is None,
    )


def _rejection(task: ExamTask, patch: Patch, exam: Exam) -> Rejection:
    label = task.texture.name
    library = _library(task, exam, BEST_SOLVER, OURS)
    thesis = _library(task, exam, BEST_SOLVER, THESIS)
    quarters = quarters_path(task.folder, task.experiment.name, exam.lesson.name)
    references = _references(_path(task, exam, BEST_SOLVER, OURS), quarters)
    signature = _signature(patch, exam, BEST_SOLVER, library)
    pairs = references.score_pairs(patch.estimate(exam.conditions, BEST_SOLVER), signature, label)
    pairs["thesis"] = distance_pair(_signature(patch, exam, BEST_SOLVER, thesis), label, thesis)
    return Rejection(
        experiment=task.experiment.name,
        exam=exam.name,
        protocol=task.protocol,
        texture=label,
        pairs=pairs,
        rejected=library.match(signature).label is None,
        rejected_unknown=without(library, label).match(signature).label is None,
    )


def _signature(patch: Patch, exam: Exam, solver: Method, library: TextureLibrary) -> FloatMap:
    """What `library.observe` would make of the patch, from observations that libraries share."""
    observation = patch.observation(
        exam.conditions, solver, library.classifier, library.segment_px, train=False
    )
    return classifier_named(library.classifier).signature(observation, library.parameters)


def _library(task: ExamTask, exam: Exam, solver: Method, classifier: str) -> TextureLibrary:
    return _load(_path(task, exam, solver, classifier))


def _path(task: ExamTask, exam: Exam, solver: Method, classifier: str) -> Path:
    return library_path(task.folder, task.experiment.name, exam.lesson.name, solver, classifier)


@lru_cache(maxsize=512)
def _load(path: Path) -> TextureLibrary:
    return TextureLibrary.load(path)


@lru_cache(maxsize=16)
def _references(whole: Path, quarters: Path) -> References:
    return References(_load(whole), _load(quarters))
