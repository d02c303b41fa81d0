"""What one classification costs: milliseconds on this machine, and training images."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from classify import TextureLibrary

from .plan import BEST_SOLVER, OURS, TEXTONS, THESIS, Plan
from .scenes import Patch, solve
from .training import library_path

__all__ = ["Cost", "measured_costs"]

_ROUNDS = 9


@dataclass(frozen=True)
class Cost:
    """Of one set: the shortest of some times, from pixel values to a match.

    `images` is how many images of the set are looked at. One that is looked at by itself need
    not be solved.
    """

    classifier: str
    training_images: int
    images: int
    solve_ms: float
    match_ms: float


def measured_costs(plan: Plan, folder: Path) -> list[Cost]:
    """Costs of ours, of the thesis's and of Varma and Zisserman's, on the thirty textures."""
    experiment = plan.thirty
    place = experiment.test_place(experiment.textures[0], 0, "disjoint")
    costs = []
    for exam in experiment.exams[: len(experiment.exams) // len(plan.chapter_slants_deg)]:
        if exam.lesson.one_segment:
            continue
        shot = Patch(place, experiment.frame_px).shot(exam.conditions)
        solve_ms = _least_ms(partial(solve, shot, BEST_SOLVER))
        surface = solve(shot, BEST_SOLVER)
        for solver, classifier in exam.lesson.systems:
            if solver != BEST_SOLVER or classifier not in (OURS, THESIS, TEXTONS):
                continue
            library = TextureLibrary.load(
                library_path(folder, experiment.name, exam.lesson.name, solver, classifier)
            )
            one_image = classifier == TEXTONS
            costs.append(
                Cost(
                    classifier,
                    training_images=4 * len(exam.lesson.turns_deg),
                    images=1 if one_image else 4,
                    solve_ms=0.0 if one_image else solve_ms,
                    match_ms=_least_ms(partial(library.classify, surface)),
                )
            )
    return costs


def _least_ms(function: Callable[[], object]) -> float:
    """The shortest of some calls. The first, which compiles and fills caches, is not counted."""
    function()
    rounds = []
    for _ in range(_ROUNDS):
        started_s = time.perf_counter()
        function()
        rounds.append(time.perf_counter() - started_s)
    return 1e3 * min(rounds)
