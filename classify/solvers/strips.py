"""Solve a frame in strips of rows, and what all methods do to a strip while it is in the cache."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from classify.compiling import kernel
from classify.images.stack import ImageStack
from classify.lights.flat_field import DividedStack
from classify.lights.near_light import Shear, middle_px
from classify.shadow_rule import MIN_NORMAL_Z
from classify.threads import STRIP_PX, run_on_rows

from .dark import judge_dark_pixels
from .problem import Maps, Problem

Array = npt.NDArray[Any]
Solve = Callable[[ImageStack, Maps, int, int], None]

# Lights out of one plane are solved a second time if that can change an image by so much of the
# albedo: 0.06 degrees for three lights at right angles.
_LEAST_EXCESS = 1e-3
# A pixel so near to the plane of the lights, as a share of its distance from the middle of the
# frame, is lit along that plane: its slope across it is not known.
_NEAR_PLANE = np.float32(0.05)


def solve_strips(problem: Problem, maps: Maps, solve: Solve, strip_px: int | None = None) -> None:
    """Solve a frame into its maps, judge its dark pixels, and correct for near lights.

    Methods that fill in (`Maps.unlit`) call `correct_for_near_lights` when they are done.

    Parameters
    ----------
    solve
        Called as ``solve(stack, maps, first, last)`` to write these rows of the maps from the same
        rows of the stack. Both are of the whole frame, or of a strip with images to be prepared.
    strip_px
        Pixels of a strip; by default as many values as of four images in `STRIP_PX`, so that they
        stay in the cache.
    """
    rows, done = problem.shape[0], list[int]()
    divided = isinstance(problem.stack, DividedStack)
    # The threads would each compute it.
    problem.dark_level  # noqa: B018

    def solve_strip(first: int, last: int) -> None:
        stack, part, begin, end = problem.stack, maps, first, last
        if divided or problem.shear is not None:
            stack, part, begin, end = (
                stack.rows(first, last),
                maps.rows(first, last),
                0,
                last - first,
            )
        solve(stack, part, begin, end)
        if problem.shear is not None and _matters(problem.shear, problem.shape):
            _subtract_excess(problem, stack, part, first)
            solve(stack, part, begin, end)
        judge_dark_pixels(problem, stack, part, begin, end)
        if problem.shear is not None and maps.unlit is None:
            _correct(problem.shear, part, problem.shape, first)
        done.append(last - first)
        if problem.on_progress is not None:
            problem.on_progress(sum(done) / rows)

    run_on_rows(solve_strip, problem.shape, strip_px or 4 * STRIP_PX // len(problem.lighting))


def correct_for_near_lights(problem: Problem, maps: Maps) -> None:
    """Replace solutions b' of distant lights by those of near lights (`near_light`), if they are.

    Slopes that face away, or lie across the plane of the lights, become invalid.
    """
    shear, shape = problem.shear, problem.shape
    if shear is not None:
        run_on_rows(
            lambda first, last: _correct(shear, maps.rows(first, last), shape, first), shape
        )


def _matters(shear: Shear, shape: tuple[int, int]) -> bool:
    """Whether lights out of one plane need a second solution."""
    return float(np.abs(shear.excess).max()) * 0.5 * float(np.hypot(*shape)) > _LEAST_EXCESS


def _correct(shear: Shear, maps: Maps, shape: tuple[int, int], first: int) -> None:
    x, y = middle_px(shape[1]), -middle_px(shape[0])[first : first + len(maps.p)]
    _undo_shear(shear.plane, x, y, maps.p, maps.q, maps.albedo, maps.valid)


def _subtract_excess(problem: Problem, stack: ImageStack, maps: Maps, first: int) -> None:
    """Subtract from the images of a strip what lights out of one plane add, by a first solution."""
    shear, shape = problem.shear, problem.shape
    assert shear is not None
    x, y = middle_px(shape[1]), -middle_px(shape[0])[first : first + len(maps.p)]
    _subtract(
        shear.plane, shear.excess / problem.gains, x, y, maps.p, maps.q, maps.albedo,
        problem.saturation, stack.images,
    )  # fmt: skip


@kernel
def _undo_shear(
    plane: Array, x: Array, y: Array, p: Array, q: Array, albedo: Array, valid: Array
) -> None:
    """Replace the maps of b' by those of b = b' + c (b' . X) / (1 - c . X), at X = (x, y, 0)."""
    cx, cy, cz = plane
    zero, one = np.float32(0.0), np.float32(1.0)
    rows, columns = p.shape
    for r in range(rows):
        for c in range(columns):
            across = one - cx * x[c] - cy * y[r]
            known = across > _NEAR_PLANE
            # In units of b'_z.
            inner = -(p[r, c] * x[c] + q[r, c] * y[r]) / (across if known else one)
            bx, by, bz = cx * inner - p[r, c], cy * inner - q[r, c], one + cz * inner
            length = np.sqrt(bx * bx + by * by + bz * bz)
            known &= bz > MIN_NORMAL_Z * length
            slope = -one / bz if known else zero
            albedo[r, c] *= length / np.sqrt(one + p[r, c] * p[r, c] + q[r, c] * q[r, c])
            p[r, c] = bx * slope
            q[r, c] = by * slope
            valid[r, c] &= known


@kernel
def _subtract(
    plane: Array, excess: Array, x: Array, y: Array, p: Array, q: Array, albedo: Array,
    saturation: np.float32, images: Array,
) -> None:  # fmt: skip
    """Subtract e_k (b . X) from images below `saturation`, with `excess` e_k in their units."""
    cx, cy, _ = plane
    one = np.float32(1.0)
    rows, columns = p.shape
    for r in range(rows):
        for k in range(images.shape[0]):
            for c in range(columns):
                across = max(one - cx * x[c] - cy * y[r], _NEAR_PLANE)
                px, qx = p[r, c], q[r, c]
                scale = albedo[r, c] / (across * np.sqrt(one + px * px + qx * qx))
                added = -excess[k] * scale * (px * x[c] + qx * y[r])
                raw = images[k, r, c]
                images[k, r, c] = raw - added if raw < saturation else raw
