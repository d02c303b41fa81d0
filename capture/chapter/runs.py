"""Training runs and test runs: libraries, and matches of test patches with them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from classify import Lighting, Match, Method, TextureLibrary, Trial
from classify.classifiers import classifier_named
from classify.library.training import TrainingRow

from . import plan
from .patches import CachedPatch, solves_as_planar


@dataclass(frozen=True)
class TrainingTask:
    """The training runs of an experiment at one slant, on the same patches."""

    experiment: plan.Experiment
    runs: tuple[plan.TrainingRun, ...]
    folder: Path


@dataclass(frozen=True)
class PatchTask:
    """One test patch under all conditions of an experiment."""

    experiment: plan.Experiment
    texture: plan.Texture
    number: int
    protocol: plan.Protocol
    folder: Path


class System(NamedTuple):
    """Key of outcomes: a solver and a classifier in a test run, under a protocol."""

    experiment: str
    test: str
    solver: str
    classifier: str
    protocol: plan.Protocol = "disjoint"


class Outcome(NamedTuple):
    """Result of one patch with one system."""

    system: System
    trial: Trial
    match_without_class: Match | None  # only for training runs with `tests_unknown`


def training_tasks(experiment: plan.Experiment, folder: Path) -> list[TrainingTask]:
    """Group the runs that share scenes."""
    groups: dict[tuple[object, ...], list[plan.TrainingRun]] = {}
    for run in experiment.training:
        key = (run.conditions.slant_deg, run.orientations_deg, run.places)
        groups.setdefault(key, []).append(run)
    return [TrainingTask(experiment, tuple(runs), folder) for runs in groups.values()]


def library_path(
    folder: Path, experiment: str, run: plan.TrainingRun, solver: Method, classifier: str
) -> Path:
    """File of one library."""
    return folder / f"{experiment} {run.name} {solver} {classifier}.ps4lib"


def train(task: TrainingTask) -> None:
    """Write the libraries of some training runs."""
    experiment, first = task.experiment, task.runs[0]
    rows: dict[tuple[Path, int, Method, str], list[TrainingRow]] = {}
    for texture in dict.fromkeys(t for run in task.runs for t in run.textures):
        for position in first.positions(texture):
            patch = CachedPatch(position, experiment.frame_px)
            for run in task.runs:
                if texture not in run.textures:
                    continue
                for solver, classifier in run.systems:
                    path = library_path(task.folder, experiment.name, run, solver, classifier)
                    observation = patch.observation(
                        run.conditions, solver, classifier, run.segment_px, train=True
                    )
                    rows.setdefault((path, run.segment_px, solver, classifier), []).append(
                        TrainingRow(texture.name, observation, position.rotate_deg)
                    )
    lighting = Lighting.ring(first.conditions.slant_deg)
    for (path, segment_px, solver, classifier), trained in rows.items():
        TextureLibrary.from_observations(
            trained,
            segment_px,
            classifier,
            lighting=lighting,
            method=solver,
            planar=solves_as_planar(solver),
            simulated=True,
        ).save(path)


def patch_tasks(experiment: plan.Experiment, folder: Path) -> Iterator[PatchTask]:
    """List all test patches. Those of one texture follow each other and share its tile."""
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
    """Remove a class from the references and limits; parameters learned from all classes stay.

    References of one class and orientation are taken as one set.
    """
    kept = [index for index, other in enumerate(library.labels) if other != label]
    labels = tuple(library.labels[index] for index in kept)
    orientations_deg, signatures = library.orientations_deg[kept], library.signatures[kept]
    numbers: dict[tuple[str, float], int] = {}
    sets = [
        numbers.setdefault(key, len(numbers))
        for key in zip(labels, orientations_deg.tolist(), strict=True)
    ]
    limits = classifier_named(library.classifier).limits(
        labels, sets, signatures, library.parameters
    )
    return replace(
        library,
        labels=labels,
        orientations_deg=orientations_deg,
        signatures=signatures,
        limits=limits,
    )


def _outcome(
    task: PatchTask, patch: CachedPatch, test: plan.TestRun, solver: Method, classifier: str
) -> Outcome:
    experiment, label = task.experiment.name, task.texture.name
    path = library_path(task.folder, experiment, test.training, solver, classifier)
    library = _load(path)
    observation = patch.observation(
        test.conditions, solver, classifier, library.segment_px, train=False
    )
    signature = classifier_named(classifier).signature(observation, library.parameters)
    unknown = None
    if (
        test.training.tests_unknown
        and solver == plan.BEST_SOLVER
        and classifier in (plan.OURS, plan.THESIS)
    ):
        unknown = _load_without_class(path, label).match(signature)
    return Outcome(
        System(experiment, test.name, solver, classifier, task.protocol),
        Trial(label, patch.position.rotate_deg, library.match(signature)),
        unknown,
    )


@lru_cache(maxsize=512)
def _load(path: Path) -> TextureLibrary:
    return TextureLibrary.load(path)


@lru_cache(maxsize=64)
def _load_without_class(path: Path, label: str) -> TextureLibrary:
    return without_class(_load(path), label)
