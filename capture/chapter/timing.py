"""Timing of functions; time of one classification, and number of training images."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from classify import TextureLibrary

from .patches import CachedPatch, solve, solves_as_planar
from .plan import BEST_SOLVER, OURS, TEXTONS, THESIS, Plan
from .runs import library_path

Work: TypeAlias = Callable[[], Any]
_Clock: TypeAlias = Callable[[], float]


def shortest_ms(
    functions: Mapping[str, Work], rounds: int, clock_s: _Clock = time.perf_counter
) -> dict[str, float]:
    """Duration of the shortest of `rounds` calls of each function, in milliseconds.

    Each round calls every function once, so that a busy machine slows all of them. The shortest
    call counts, because other processes only add time. A first call of each, which compiles and
    fills caches, is not timed.
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


# Even on a busy machine, one of this many calls is undisturbed.
_ROUNDS = 9


@dataclass(frozen=True)
class Cost:
    """Cost of one classifier; a classifier of one image needs no solver."""

    classifier: str
    training_images: int
    images: int  # of a test set
    solve_ms: float
    match_ms: float


def measured_costs(plan: Plan, folder: Path) -> list[Cost]:
    """Time our classifier, the thesis's and Varma and Zisserman's on the thirty textures."""
    experiment = plan.thirty
    position = experiment.test_position(experiment.textures[0], 0, "disjoint")
    costs = []
    # The tests are ordered by slant; those of the first slant suffice.
    tests_per_slant = len(experiment.tests) // len(plan.chapter_slants_deg)
    for test in experiment.tests[:tests_per_slant]:
        run = test.training
        if run.one_segment:
            continue
        images = CachedPatch(position, experiment.frame_px).images(test.conditions)
        solved = partial(solve, images, BEST_SOLVER, planar=solves_as_planar(BEST_SOLVER))
        surface = solved()
        work: dict[str, Work] = {"solve": solved}
        for classifier in (OURS, THESIS, TEXTONS):
            if classifier in run.classifiers:
                path = library_path(folder, experiment.name, run, BEST_SOLVER, classifier)
                work[classifier] = partial(TextureLibrary.load(path).classify, surface)
        times = shortest_ms(work, _ROUNDS)
        solve_ms = times.pop("solve")
        for classifier, match_ms in times.items():
            one_image = classifier == TEXTONS
            costs.append(
                Cost(
                    classifier,
                    training_images=4 * len(run.orientations_deg),
                    images=1 if one_image else 4,
                    solve_ms=0.0 if one_image else solve_ms,
                    match_ms=match_ms,
                )
            )
    return costs
