"""Solvers against the memory bus and against what one would write in numpy."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from classify import Lighting, Method

from .figures import Chapter, Figure
from .scenes import Shot, mosaic
from .stopwatch import Work, least_ms

__all__ = [
    "drop_darkest",
    "normal_least_squares",
    "read_four_write_three",
    "solver_chapters",
]

FRAME_PX = (1944, 2592)
"""Rows and columns of a common sensor of five megapixels."""

METHODS: tuple[Method, ...] = ("ps4", "ps4_robust", "least_squares")
_MOST_OF_FLOOR = 2.0
_LEAST_OF_LSTSQ = 100.0

Array = npt.NDArray[Any]


def solver_chapters(quick: bool) -> list[Chapter]:
    """Both pixel depths, at five megapixels."""
    return [_chapter(bits, quick) for bits in (8, 16)]


def _chapter(bits: int, quick: bool) -> Chapter:
    shot = mosaic(FRAME_PX, bits)
    maps = np.empty((3, *FRAME_PX), np.float32)
    floors: dict[str, Work] = {"floor": partial(read_four_write_three, shot.images, *maps)}
    solvers: dict[str, Work] = {method: partial(shot.solve, method) for method in METHODS}
    solvers["ps4 and every other map"] = partial(_every_map, shot)
    plain: dict[str, Work] = {
        "numpy lstsq": partial(normal_least_squares, shot.images, shot.lighting),
        "numpy drop-darkest": partial(drop_darkest, shot.images, shot.lighting),
    }
    rounds, plain_rounds = (15, 2) if quick else (40, 4)
    times = least_ms(floors | solvers, rounds) | least_ms(plain, plain_rounds)
    floor = times["floor"]
    figures = [Figure("floor: read 4 planes, write 3 float32", 1.0, "x floor", floor)]
    for name in solvers:
        target = _MOST_OF_FLOOR if name == "ps4" else None
        figures.append(Figure(name, times[name] / floor, "x floor", times[name], target))
    for name in plain:
        figures.append(Figure(name, times[name] / floor, "x floor", times[name]))
        for method in METHODS:
            target = _LEAST_OF_LSTSQ if (name, method) == ("numpy lstsq", "ps4") else None
            faster = times[name] / times[method]
            figures.append(Figure(name, faster, f"x {method}", None, target, "at least"))
    return Chapter(
        f"Solvers, {bits} bit, {shot.images[0].size / 1e6:.2f} megapixels",
        figures,
        (
            f"The shortest of {rounds} calls (numpy: {plain_rounds}), taken in turn.",
            "The floor writes into the same maps each time, a solver into new ones.",
            "lstsq: one np.linalg.lstsq of the lights, all pixels as right-hand sides; no slopes.",
        ),
    )


def _every_map(shot: Shot) -> None:
    surface = shot.solve("ps4")
    surface.dropped, surface.residual, surface.shadow_count, surface.saturated  # noqa: B018


@njit(parallel=True, fastmath=True, cache=True, error_model="numpy")
def read_four_write_three(images: Array, one: Array, two: Array, three: Array) -> None:
    """The least that a solver of p, q and albedo has to move, with next to no arithmetic."""
    rows, columns = one.shape
    for r in prange(rows):
        for c in range(columns):
            v0, v1 = np.float32(images[0, r, c]), np.float32(images[1, r, c])
            v2, v3 = np.float32(images[2, r, c]), np.float32(images[3, r, c])
            one[r, c] = v0 - v2
            two[r, c] = v1 - v3
            three[r, c] = v0 + v1 + v2 + v3


def normal_least_squares(images: Array, lighting: Lighting) -> Array:
    """(3, pixels) scaled normals by one call of numpy's least squares."""
    values = images.reshape(len(images), -1)
    normals: Array = np.linalg.lstsq(lighting.directions, values, rcond=None)[0]
    return normals


def drop_darkest(images: Array, lighting: Lighting) -> tuple[Array, Array, Array]:
    """p, q and albedo as one would write PS4 in numpy: an inverse for each light left out."""
    values = images.reshape(len(images), -1).astype(np.float32)
    darkest = values.argmin(axis=0)
    normals = np.empty((3, values.shape[1]), np.float32)
    for light in range(len(images)):
        others = np.delete(np.arange(len(images)), light)
        inverse = np.linalg.inv(lighting.directions[others]).astype(np.float32)
        chosen = darkest == light
        normals[:, chosen] = inverse @ values[others][:, chosen]
    x, y, z = normals
    return -x / z, -y / z, np.linalg.norm(normals, axis=0)
