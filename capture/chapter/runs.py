"""Training runs and test runs: libraries, and matches of test patches with them."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from classify import Lighting, Method, TextureLibrary, Trial
from classify.classifiers import classifier_named
from classify.library.training import TrainingRow
from classify.surface.estimate import FloatMap

from . import plan
from .patches import CachedPatch, solves_as_planar


@dataclass(frozen=True)
class _TrainingTask:
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


def training_tasks(experiment: plan.Experiment, folder: Path) -> list[_TrainingTask]:
    """Group the runs that share scenes."""
    groups: dict[tuple[object, ...], list[plan.TrainingRun]] = {}
    for run in experiment.training:
        key = (run.conditions.slant_deg, run.orientations_deg, run.places)
        groups.setdefault(key, []).append(run)
    return [_TrainingTask(experiment, tuple(runs), folder) for runs in groups.values()]


def library_path(
    folder: Path, experiment: str, run: plan.TrainingRun, solver: Method, classifier: str
) -> Path:
    """File of one library."""
    return folder / f"{experiment} {run.name} {solver} {classifier}.ps4lib"


def train(task: _TrainingTask) -> None:
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


class _PatchMatch(NamedTuple):
    """A test patch with one system; `signature` is what the library compares."""

    system: System
    trial: Trial
    run: plan.TrainingRun
    library: Path
    signature: FloatMap


def match_patch(task: PatchTask) -> list[tuple[System, Trial]]:
    """Match one patch with all libraries."""
    return [(match.system, match.trial) for match in patch_matches(task)]


def patch_matches(task: PatchTask) -> Iterator[_PatchMatch]:
    """Match one patch with all libraries, one after the other."""
    experiment, texture = task.experiment, task.texture
    position = experiment.test_position(texture, task.number, task.protocol)
    patch = CachedPatch(position, experiment.frame_px)
    for test in experiment.tests:
        if texture not in test.training.textures:
            continue
        for solver, classifier in test.training.systems:
            path = library_path(task.folder, experiment.name, test.training, solver, classifier)
            library = load_library(path)
            observation = patch.observation(
                test.conditions, solver, classifier, library.segment_px, train=False
            )
            signature = classifier_named(classifier).signature(observation, library.parameters)
            system = System(experiment.name, test.name, solver, classifier, task.protocol)
            trial = Trial(texture.name, position.rotate_deg, library.match(signature))
            yield _PatchMatch(system, trial, test.training, path, signature)


@lru_cache(maxsize=512)
def load_library(path: Path) -> TextureLibrary:
    """Load a library, or return the one that was loaded before."""
    return TextureLibrary.load(path)
