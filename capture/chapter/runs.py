"""Patches of textures, rendered and solved; libraries trained with them, and their matches."""

import zlib
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from classify import Lighting, Method, SurfaceEstimate, TextureLibrary, Trial
from classify.base.arrays import FloatMap
from classify.classifiers import Observation, classifier_named
from classify.library.training import TrainingRow
from rig import synthetic_surface
from rig.scene.material_folder import load_material
from rig.scene.render import SceneImages, render_frame
from rig.scene.surfaces import PeriodicSurface
from rig.simulation.sensor import SensorModel
from rig.simulation.simulated_set import EXPOSURE_MS, SimulatedSet

from . import plan
from .plan import BEST_SOLVER, Conditions, PatchPosition, SceneFaults, Texture

_Observe = Callable[[SurfaceEstimate, int], Observation]
_THESIS_METHODS = ("ps3a", "ps3b", "ps3c", "ps3d", "ps4")


@lru_cache(maxsize=2)
def load_surface(texture: Texture, seed: int, tile_px: int) -> PeriodicSurface:
    """Read or generate the surface that patches are cut from."""
    if texture.folder is not None:
        return load_material(texture.folder)
    return synthetic_surface(texture.name, seed, tile_px)


def render_patch(
    position: PatchPosition,
    slant_deg: float,
    size_px: int,
    surface: PeriodicSurface | None = None,
    faults: SceneFaults | None = None,
) -> SceneImages:
    """Ideal images of a patch under four lights; the faults depend on its position."""
    if surface is None:
        surface = load_surface(position.texture, position.seed, 2 * size_px)
    rows, columns = surface.height.shape
    right, up = position.shift_tiles
    shift_px = (right * columns, up * rows)
    if faults is None:
        lighting = Lighting.ring(slant_deg)
        return render_frame(surface, lighting, size_px, position.rotate_deg, shift_px)
    seed = _seed_of(position, "faults")
    return faults(surface, slant_deg, size_px, position.rotate_deg, shift_px, seed)


def expose(scene: SceneImages, conditions: Conditions, seed: int) -> SimulatedSet:
    """Expose a scene under the conditions."""
    return SimulatedSet.expose(
        scene,
        Lighting.ring(conditions.slant_deg),
        SensorModel(bit_depth=conditions.bits),
        seed,
        exposure_ms=EXPOSURE_MS * conditions.exposure,
        led_levels=(1.0, conditions.weak_led, 1.0, 1.0),
        shadows=conditions.shadows,
    )


def solve(images: SimulatedSet, method: Method, *, planar: bool = False) -> SurfaceEstimate:
    """Solve a set; by PS3 and PS4 as in the thesis, where every pixel is valid unless saturated."""
    surface = images.solve(method, planar=planar)
    if method in _THESIS_METHODS:
        return replace(surface, valid=~surface.saturated)
    return surface


def solves_as_planar(method: Method) -> bool:
    """Whether sets are solved as planar parts, as `ps4rig train` and `classify` do by default."""
    return method == BEST_SOLVER


class CachedPatch:
    """One patch under any conditions; each scene, solution and observation is computed once."""

    def __init__(self, position: PatchPosition, frame_px: int) -> None:
        self.position = position
        self._frame_px = frame_px
        self._scenes: dict[tuple[float, SceneFaults | None], SceneImages] = {}
        self._surfaces: dict[tuple[Conditions, Method], SurfaceEstimate] = {}
        self._observations: dict[Hashable, Observation] = {}

    def images(self, conditions: Conditions) -> SimulatedSet:
        """Image set of the patch; its noise depends on position and conditions only."""
        key = (conditions.slant_deg, conditions.faults)
        if key not in self._scenes:
            self._scenes[key] = render_patch(
                self.position, conditions.slant_deg, self._frame_px, faults=conditions.faults
            )
        scene = self._scenes[key].cropped(conditions.size_px, conditions.size_px)
        return expose(scene, conditions, _seed_of(self.position, conditions))

    def surface(self, conditions: Conditions, method: Method) -> SurfaceEstimate:
        """Surface as a solver estimates it."""
        key = (conditions, method)
        if key not in self._surfaces:
            planar = solves_as_planar(method)
            self._surfaces[key] = solve(self.images(conditions), method, planar=planar)
        return self._surfaces[key]

    def observation(
        self, conditions: Conditions, method: Method, observe: _Observe, segment_px: int
    ) -> Observation:
        """What a classifier observes of the surface; those with one `observe` share it."""
        key = (conditions, method, observe, segment_px)
        if key not in self._observations:
            self._observations[key] = observe(self.surface(conditions, method), segment_px)
        return self._observations[key]


def _seed_of(position: PatchPosition, use: object) -> int:
    """Seed that does not depend on the folder in which a material is stored."""
    named = replace(position, texture=Texture(position.texture.name))
    return zlib.crc32(f"{named} {use}".encode())


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
                    observe = classifier_named(classifier).observe_training
                    observation = patch.observation(run.conditions, solver, observe, run.segment_px)
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
    """Match of a test patch by one system; `signature` is what the library compares."""

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
        for solver, name in test.training.systems:
            path = library_path(task.folder, experiment.name, test.training, solver, name)
            library = load_library(path)
            classifier = classifier_named(name)
            observation = patch.observation(
                test.conditions, solver, classifier.observe, library.segment_px
            )
            signature = classifier.signature(observation, library.parameters)
            system = System(experiment.name, test.name, solver, name, task.protocol)
            trial = Trial(texture.name, position.rotate_deg, library.match(signature))
            yield _PatchMatch(system, trial, test.training, path, signature)


@lru_cache(maxsize=512)
def load_library(path: Path) -> TextureLibrary:
    """Load a library, or return the one that was loaded before."""
    return TextureLibrary.load(path)
