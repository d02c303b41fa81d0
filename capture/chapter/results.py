"""Measurement of a plan: all numbers that the exhibits of the chapter show."""

import itertools
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from capture.base.console import progress
from capture.batch.runner import Batch
from classify import Lighting, Method, SurfaceEstimate, TextureLibrary, Trial, integrate_gradients
from classify.base.arrays import FloatMap
from classify.library.evaluation import nearest_accuracy
from classify.methods import CLASSIFIER_NAMES
from classify.texture.fields import TextureFields, texture_fields
from classify.texture.spectra import field_spectra, segment_for
from rig.scene.render import SceneImages, render_frame

from . import runs
from .plan import (
    BEST_SOLVER,
    OURS,
    SOLVERS,
    TEXTONS,
    THESIS,
    THESIS_TEXTURES,
    Conditions,
    PatchPosition,
    Plan,
    Protocol,
    Texture,
)

_SHADOW_SLANTS_DEG = tuple(map(float, range(10, 90, 10)))  # figures 9.2 and 9.3
_POLAR_ORIENTATIONS_DEG = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0)  # figures 9.5 and 9.10
_Item = TypeVar("_Item")
_Result = TypeVar("_Result")
Work: TypeAlias = Callable[[], Any]
_Clock: TypeAlias = Callable[[], float]


def shortest_ms(
    functions: Mapping[str, Work], rounds: int, clock_s: _Clock = time.perf_counter
) -> dict[str, float]:
    """Shortest duration of each function in ms, over `rounds` calls; other processes only add time.

    A first call of each function is not timed. The functions are then called alternately.
    """
    for function in functions.values():
        function()
    shortest = dict.fromkeys(functions, float("inf"))
    for _ in range(rounds):
        for name, function in functions.items():
            shortest[name] = min(shortest[name], time_ms(function, clock_s))
    return shortest


def time_ms(function: Work, clock_s: _Clock = time.perf_counter) -> float:
    """Duration of one call in milliseconds."""
    started_s = clock_s()
    function()
    return 1e3 * (clock_s() - started_s)


# Number of timed calls: even on a busy machine, one of nine is undisturbed.
_ROUNDS = 9


@dataclass(frozen=True)
class _Cost:
    """Time of one classification, and numbers of images that it needs."""

    classifier: str
    training_images: int
    images: int  # in a test set
    solve_ms: float  # 0 for a classifier of one image
    match_ms: float


def _measured_costs(plan: Plan, folder: Path) -> list[_Cost]:
    """Time the classifiers of ours, the thesis, and Varma and Zisserman on thirty textures."""
    experiment = plan.thirty
    position = experiment.test_position(experiment.textures[0], 0, "disjoint")
    costs = []
    # The tests are ordered by slant; those of the first slant suffice.
    tests_per_slant = len(experiment.tests) // len(plan.chapter_slants_deg)
    for test in experiment.tests[:tests_per_slant]:
        run = test.training
        # Runs with one segment hold `THESIS` again; only its spectra of several segments are timed.
        if run.one_segment:
            continue
        images = runs.CachedPatch(position, experiment.frame_px).images(test.conditions)
        solve_images = partial(
            runs.solve, images, BEST_SOLVER, planar=runs.solves_as_planar(BEST_SOLVER)
        )
        surface = solve_images()
        functions: dict[str, Work] = {"solve": solve_images}
        for classifier in (OURS, THESIS, TEXTONS):
            if classifier in run.classifiers:
                path = runs.library_path(folder, experiment.name, run, BEST_SOLVER, classifier)
                functions[classifier] = partial(TextureLibrary.load(path).classify, surface)
        durations_ms = shortest_ms(functions, _ROUNDS)
        solve_ms = durations_ms.pop("solve")
        for classifier, match_ms in durations_ms.items():
            one_image = classifier == TEXTONS
            costs.append(
                _Cost(
                    classifier,
                    training_images=4 * len(run.orientations_deg),
                    images=1 if one_image else 4,
                    solve_ms=0.0 if one_image else solve_ms,
                    match_ms=match_ms,
                )
            )
    return costs


SAND_SLANT_DEG = 60.0
"""Each light leaves a fifth of sand in shadow; the thesis does not state its slant."""

SHADOW_TILTS_DEG = (0.0, 30.0, 60.0, 90.0)
_SHADOW_PX, _MAPS_PX = 512, 256  # sides of the frames
_POLAR_SOLVERS: tuple[Method, ...] = ("ps3a", "ps3b", "ps3c", "ps3d", "ps4", "ps4_robust")
TRUTH = "truth"

_Polar = dict[str, list[float]]
"""1D polar spectra of the gradient field M at 90 angles, by solver or `TRUTH`."""


def _shadow_shares(texture_and_slant: tuple[str, float]) -> tuple[float, ...]:
    """Share of the pixels of a synthetic texture in shadow of a light, for each tilt."""
    name, slant_deg = texture_and_slant
    surface = runs.load_surface(Texture(name), 0, _SHADOW_PX)
    scene = render_frame(surface, Lighting.ring(slant_deg, SHADOW_TILTS_DEG), _SHADOW_PX)
    shares: list[float] = scene.shadowed.mean(axis=(1, 2)).tolist()
    return tuple(shares)


@dataclass(frozen=True, eq=False)
class _SandMaps:
    """(H, W) maps of one patch by solver and `TRUTH`, and their errors."""

    relief: dict[str, FloatMap]  # height in px, of mean 0
    # Of each solver, scaled to the mean of the true albedo over valid pixels without shadow.
    albedo: dict[str, FloatMap]
    errors: dict[str, tuple[float, float, float]]  # rms over valid pixels, of p, q and albedo
    shadows: dict[str, npt.NDArray[np.uint8]]  # number of lights in shadow


def _polar_spectra(rotate_deg: float, size_px: int) -> _Polar:
    """1D polar spectra of M of a patch of sand, at 90 angles over 180 degrees."""
    scene, surfaces = _solved_sand(rotate_deg, size_px, _POLAR_SOLVERS)
    fields = {solver: texture_fields(surface) for solver, surface in surfaces.items()}
    fields[TRUTH] = TextureFields(scene.p, scene.q, scene.albedo)
    segment_px = segment_for(scene.p.shape)
    return {
        name: [float(value) for value in field_spectra(fields[name], segment_px).polar[0]]
        for name in fields
    }


def _sand_maps(size_px: int) -> _SandMaps:
    """Maps of a patch of sand by all solvers, and their errors."""
    scene, surfaces = _solved_sand(0.0, size_px, SOLVERS)
    shadows = scene.shadowed.sum(axis=0).astype(np.uint8)
    relief = {TRUTH: integrate_gradients(scene.p, scene.q)}
    albedo = {TRUTH: scene.albedo}
    errors = {}
    for solver, surface in surfaces.items():
        unshadowed = (shadows == 0) & surface.valid
        scale = scene.albedo[unshadowed].mean() / surface.albedo[unshadowed].mean()
        albedo[solver] = surface.albedo * scale
        relief[solver] = integrate_gradients(surface.p, surface.q)
        estimates = (surface.p, surface.q, albedo[solver])
        p_error, q_error, albedo_error = (
            float(np.sqrt(np.square(estimate - truth)[surface.valid].mean()))
            for estimate, truth in zip(estimates, (scene.p, scene.q, scene.albedo), strict=True)
        )
        errors[solver] = (p_error, q_error, albedo_error)
    counts = {solver: surface.shadow_count for solver, surface in surfaces.items()}
    return _SandMaps(relief, albedo, errors, {TRUTH: shadows} | counts)


def _solved_sand(
    rotate_deg: float, size_px: int, solvers: tuple[Method, ...]
) -> tuple[SceneImages, dict[str, SurfaceEstimate]]:
    """Render a patch of sand, and solve its images by several solvers."""
    position = PatchPosition(Texture("sand"), 0, (0.0, 0.0), rotate_deg)
    scene = runs.render_patch(position, SAND_SLANT_DEG, size_px)
    # Each orientation has its own noise.
    images = runs.expose(scene, Conditions(SAND_SLANT_DEG, size_px), seed=round(rotate_deg))
    return scene, {solver: runs.solve(images, solver) for solver in solvers}


SOLVER_TITLES = {
    "ps3a": "PS3a",
    "ps3b": "PS3b",
    "ps3c": "PS3c",
    "ps3d": "PS3d",
    "ps4": "PS4",
    "ps4_robust": "robust PS4",
    "truth": "truth",
}
CLASSIFIER_TITLES = {name: name for name in CLASSIFIER_NAMES} | {
    "joint": "joint (ours)",
    "spectra_2d": "2D spectra, magnitude",
    "spectra_2d_power": "2D spectra, power",
    "polar_radial": "1D polar + radial",
    "polar": "1D polar",
    "image_polar": "1D polar of one image",
    "varma_zisserman": "Varma-Zisserman",
}


class Trials(dict[runs.System, list[Trial]]):
    """Trials of all test patches by system."""

    def accuracy_pct(
        self,
        experiment: str,
        test: str,
        solver: str,
        classifier: str,
        protocol: Protocol = "disjoint",
        texture: str | None = None,
    ) -> float | None:
        """Percent of tests whose nearest class is the true one, rejected or not."""
        trials = self.get(runs.System(experiment, test, solver, classifier, protocol), [])
        share = nearest_accuracy([t for t in trials if texture in (None, t.label)])
        return None if share is None else 100.0 * share


@dataclass(frozen=True, eq=False)
class Results:
    """Measurements of all exhibits."""

    plan: Plan
    trials: Trials
    # Share of pixels in shadow of a light at each of `SHADOW_TILTS_DEG`; the key is a texture and
    # a slant in degrees.
    shadow_shares: dict[tuple[str, float], tuple[float, ...]]
    polar: dict[float, _Polar]  # of sand, by orientation in degrees
    maps: _SandMaps
    costs: list[_Cost]


def measure(
    plan: Plan, output: Path, workers: int | None = None, scheduler: str | None = None
) -> Results:
    """Measure all numbers of a plan. The libraries are in a temporary folder in `output`."""
    # Workers read this when they start. With one worker on each core, BLAS threads wait for each
    # other, and texton histograms took eight times as long.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with (
        tempfile.TemporaryDirectory(dir=output.absolute(), prefix=".libraries-") as libraries,
        Batch(workers, scheduler) as batch,
    ):

        def run(
            function: Callable[[_Item], _Result], items: Sequence[_Item], name: str
        ) -> Iterator[_Result]:
            return progress(batch.map(function, items), len(items), name)

        folder = Path(libraries)
        shadows = list(itertools.product(THESIS_TEXTURES, _SHADOW_SLANTS_DEG))
        shares = list(run(_shadow_shares, shadows, "shadow"))
        spectra = partial(_polar_spectra, size_px=2 * plan.frame_px)
        polar = list(run(spectra, _POLAR_ORIENTATIONS_DEG, "polar spectra"))
        (maps,) = run(_sand_maps, [_MAPS_PX], "maps")
        training = [
            task
            for experiment in plan.experiments
            for task in runs.training_tasks(experiment, folder)
        ]
        for _ in run(runs.train, training, "train"):
            pass
        tests = [
            task for experiment in plan.experiments for task in runs.patch_tasks(experiment, folder)
        ]
        trials = Trials()
        for system, trial in itertools.chain.from_iterable(run(runs.match_patch, tests, "test")):
            trials.setdefault(system, []).append(trial)
        costs = _measured_costs(plan, folder)
    return Results(
        plan=plan,
        trials=trials,
        shadow_shares=dict(zip(shadows, shares, strict=True)),
        polar=dict(zip(_POLAR_ORIENTATIONS_DEG, polar, strict=True)),
        maps=maps,
        costs=costs,
    )
