"""Solve a frame in strips of rows, each in all steps while it is in the cache."""

import math
from collections.abc import Callable

import numpy as np

from classify.base.threads import STRIP_PX, run_on_rows
from classify.images.stack import ImageStack
from classify.lights.flat_field import DividedStack
from classify.shadow_rule import SHADOW_FLOOR, SHADOW_FRACTION

from .near_rows import NearRows
from .problem import Maps, Problem
from .unsolved import LOST

# A light is missing if it is below the shadow limit, and below the prediction by this many standard
# deviations: one normal deviate in 740 is.
_MISSING = 3.0


def _judge_dark_pixels(
    problem: Problem, stack: ImageStack, maps: Maps, first: int, last: int
) -> None:
    """Invalidate dark pixels at which a light is missing, in rows `first` to `last`."""
    part = maps.rows(first, last)
    if not part.dark_counts.any():
        return
    # The prediction from the other lights is noisy as well: 2 sigma of the difference for four.
    lights = len(problem.lighting)
    noise = np.float32(_MISSING * problem.sigma * math.sqrt(lights / max(lights - 3, 1)))
    p, q, albedo, valid = part.p.ravel(), part.q.ravel(), part.albedo.ravel(), part.valid.ravel()
    pixels = np.flatnonzero((albedo < problem.dark_albedo) & valid)
    values = stack.values_at(first * problem.shape[1] + pixels) * problem.gains[:, None]
    dark = values.mean(axis=0) < problem.dark_level
    pixels, values = pixels[dark], values[:, dark]
    rho = albedo[pixels]
    normals = np.stack([-p[pixels], -q[pixels], np.ones_like(rho)])
    normals *= rho / np.sqrt(np.square(normals).sum(axis=0))
    predicted = np.maximum(problem.directions @ normals, SHADOW_FLOOR * rho)
    missing = (values <= SHADOW_FRACTION * predicted) & (predicted - values > noise)
    pixels = pixels[missing.any(axis=0)]
    p[pixels] = q[pixels] = 0.0
    valid[pixels] = False
    if part.unlit is not None:
        part.unlit.ravel()[pixels] = LOST


_Solve = Callable[[ImageStack, Maps, int, int], None]


def solve_strips(
    problem: Problem,
    maps: Maps,
    solve: _Solve,
    strip_px: int | None = None,
    *,
    from_all_lights: bool = False,
) -> None:
    """Solve a frame into its maps, judge its dark pixels, and correct for near lights.

    `solve(stack, maps, first, last)` writes rows of the maps, of the frame or of strips of
    `strip_px`; methods that fill in call `correct_for_near_lights` when they are done.
    """
    rows, done = problem.shape[0], list[int]()
    # The threads would each compute them.
    problem.dark_albedo, problem.shear, problem.plane_px  # noqa: B018

    def solve_strip(first: int, last: int) -> None:
        if problem.shear is not None or isinstance(problem.stack, DividedStack):
            solve_prepared(problem.stack.rows(first, last), maps.rows(first, last), first)
        else:
            solve(problem.stack, maps, first, last)
            _judge_dark_pixels(problem, problem.stack, maps, first, last)
        done.append(last - first)
        if problem.on_progress is not None:
            problem.on_progress(sum(done) / rows)

    def solve_prepared(stack: ImageStack, maps: Maps, first: int) -> None:
        height = len(maps.p)
        near = NearRows.of(problem, first, height)
        if near is not None:
            near.subtract_excess(stack)
        solve(stack, maps, 0, height)
        if near is not None and near.excess_is_large and not from_all_lights:
            near.subtract_rest_of_excess(stack, maps)
            solve(stack, maps, 0, height)
        _judge_dark_pixels(problem, stack, maps, 0, height)
        if near is not None and maps.unlit is None:
            near.correct(maps)

    run_on_rows(solve_strip, problem.shape, strip_px or 4 * STRIP_PX // len(problem.lighting))


def correct_for_near_lights(problem: Problem, maps: Maps) -> None:
    """Replace the solution b' of distant lights by b of near ones, if they are near."""

    def correct(first: int, last: int) -> None:
        near = NearRows.of(problem, first, last - first)
        if near is not None:
            near.correct(maps.rows(first, last))

    if problem.shear is not None:
        run_on_rows(correct, problem.shape)
