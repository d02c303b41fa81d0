"""Training runs: their libraries are written to files that every worker can read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from classify import Lighting, Method, TextureLibrary
from classify.library.training import TrainingRow

from .patches import CachedPatch
from .plan import Experiment, TrainingRun

__all__ = ["TrainingTask", "library_path", "train", "training_tasks"]


@dataclass(frozen=True)
class TrainingTask:
    """The training runs of an experiment at one slant and the same orientations."""

    experiment: Experiment
    runs: tuple[TrainingRun, ...]
    folder: Path


def training_tasks(experiment: Experiment, folder: Path) -> list[TrainingTask]:
    """Group the runs that share scenes."""
    groups: dict[tuple[float, tuple[float, ...]], list[TrainingRun]] = {}
    for run in experiment.training:
        groups.setdefault((run.conditions.slant_deg, run.orientations_deg), []).append(run)
    return [TrainingTask(experiment, tuple(runs), folder) for runs in groups.values()]


def library_path(
    folder: Path, experiment: str, run: TrainingRun, solver: Method, classifier: str
) -> Path:
    """File of one library."""
    return folder / f"{experiment} {run.name} {solver} {classifier}.ps4lib"


def train(task: TrainingTask) -> None:
    """Write the libraries of some training runs."""
    experiment, first = task.experiment, task.runs[0]
    rows: dict[tuple[Path, int, str], list[TrainingRow]] = {}
    for texture in dict.fromkeys(t for run in task.runs for t in run.textures):
        for rotate_deg in first.orientations_deg:
            position = experiment.training_position(texture, rotate_deg)
            patch = CachedPatch(position, experiment.frame_px)
            for run in task.runs:
                if texture not in run.textures:
                    continue
                for solver, classifier in run.systems:
                    path = library_path(task.folder, experiment.name, run, solver, classifier)
                    observation = patch.observation(
                        run.conditions, solver, classifier, run.segment_px, train=True
                    )
                    rows.setdefault((path, run.segment_px, classifier), []).append(
                        TrainingRow(texture.name, observation, rotate_deg)
                    )
    lighting = Lighting.ring(first.conditions.slant_deg)
    for (path, segment_px, classifier), trained in rows.items():
        TextureLibrary.from_observations(
            trained, segment_px, classifier, lighting=lighting, simulated=True
        ).save(path)
