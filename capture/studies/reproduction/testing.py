"""Test runs: each patch is matched with every library of its experiment."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from classify import Match, Method, TextureLibrary, Trial
from classify.classifiers import classifier_named

from .patches import CachedPatch
from .plan import BEST_SOLVER, OURS, THESIS, Experiment, Protocol, TestRun, Texture
from .training import library_path

__all__ = ["Outcome", "PatchTask", "System", "match_patch", "patch_tasks", "without_class"]


@dataclass(frozen=True)
class PatchTask:
    """One test patch under all conditions of an experiment."""

    experiment: Experiment
    texture: Texture
    number: int
    protocol: Protocol
    folder: Path


class System(NamedTuple):
    """What is tested: a solver and a classifier in a test run, under a protocol."""

    experiment: str
    test: str
    solver: str
    classifier: str
    protocol: Protocol = "disjoint"


class Outcome(NamedTuple):
    """Result of one patch with one system.

    `match_without_class` is the match with the library without the class of the patch, where the
    training run asks for it.
    """

    system: System
    trial: Trial
    match_without_class: Match | None


def patch_tasks(experiment: Experiment, folder: Path) -> Iterator[PatchTask]:
    """All test patches. Those of one texture follow each other and share its tile."""
    for texture in experiment.textures:
        for protocol in experiment.protocols:
            for number in range(len(experiment.orientations_deg)):
                yield PatchTask(experiment, texture, number, protocol, folder)


def match_patch(task: PatchTask) -> list[Outcome]:
    """Match one patch with all libraries."""
    experiment, texture = task.experiment, task.texture
    position = experiment.test_position(texture, task.number, task.protocol)
    patch = CachedPatch(position, experiment.frame_px)
    return [
        _outcome(task, patch, test, solver, classifier)
        for test in experiment.tests
        if texture in test.training.textures
        for solver, classifier in test.training.systems
    ]


def without_class(library: TextureLibrary, label: str) -> TextureLibrary:
    """Remove the references of a class. Parameters learned from all classes together stay."""
    kept = [index for index, other in enumerate(library.labels) if other != label]
    return replace(
        library,
        labels=tuple(library.labels[index] for index in kept),
        orientations_deg=library.orientations_deg[kept],
        signatures=library.signatures[kept],
    )


def _outcome(
    task: PatchTask, patch: CachedPatch, test: TestRun, solver: Method, classifier: str
) -> Outcome:
    experiment, label = task.experiment.name, task.texture.name
    library = _load(library_path(task.folder, experiment, test.training, solver, classifier))
    observation = patch.observation(
        test.conditions, solver, classifier, library.segment_px, train=False
    )
    signature = classifier_named(classifier).signature(observation, library.parameters)
    unknown = None
    if test.training.tests_unknown and solver == BEST_SOLVER and classifier in (OURS, THESIS):
        unknown = without_class(library, label).match(signature)
    return Outcome(
        System(experiment, test.name, solver, classifier, task.protocol),
        Trial(label, patch.position.rotate_deg, library.match(signature)),
        unknown,
    )


@lru_cache(maxsize=512)
def _load(path: Path) -> TextureLibrary:
    return TextureLibrary.load(path)
