"""Solvers against the memory bus and against what one would write in numpy."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from classify import Lighting, Method, SurfaceEstimate

from .figures import Chapter, Figure
from .scenes import mosaic
from .stopwatch import Work, least_ms

__all__ = [
    "drop_darkest",
    "normal_least_squares",
    "read_four_write_all",
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
    floats, marks = _maps(shot.solve())
    lines = np.empty((floats, *FRAME_PX), np.float32)
    bytes_ = np.empty((marks, *FRAME_PX), np.uint8)
    floors: dict[str, Work] = {
        "floor": partial(read_four_write_three, shot.images, *lines[:3]),
        "all maps": partial(read_four_write_all, shot.images, lines, bytes_),
    }
    solvers: dict[str, Work] = {method: partial(shot.solve, method) for method in METHODS}
    plain: dict[str, Work] = {
        "numpy lstsq": partial(normal_least_squares, shot.images, shot.lighting),
        "numpy drop-darkest": partial(drop_darkest, shot.images, shot.lighting),
    }
    rounds, plain_rounds = (5, 1) if quick else (25, 3)
    times = least_ms(floors | solvers, rounds) | least_ms(plain, plain_rounds)
    floor, all_maps = times["floor"], times["all maps"]
    figures = [
        Figure("floor: read 4 planes, write 3 float32", 1.0, "x floor", floor),
        Figure(f"the same, but all {floats + marks} maps", all_maps / floor, "x floor", all_maps),
    ]
    for method in METHODS:
        ms = times[method]
        figures += [
            Figure(method, ms / floor, "x floor", ms, _MOST_OF_FLOOR),
            Figure(method, ms / all_maps, "x floor of all maps", ms),
        ]
    for name in plain:
        figures.append(Figure(name, times[name] / floor, "x floor", times[name]))
        for method in METHODS:
            target = _LEAST_OF_LSTSQ if name == "numpy lstsq" else None
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


def _maps(surface: SurfaceEstimate) -> tuple[int, int]:
    """How many maps of float32 and how many of one byte a solver writes."""
    sizes = [
        value.itemsize
        for name, value in vars(surface).items()
        if isinstance(value, np.ndarray) and name != "images"
    ]
    return sizes.count(4), sizes.count(1)


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


@njit(parallel=True, fastmath=True, cache=True, error_model="numpy")
def read_four_write_all(images: Array, lines: Array, marks: Array) -> None:
    """The same for any number of float32 maps and of byte maps."""
    _, rows, columns = images.shape
    for r in prange(rows):
        a, b, c, d = images[0, r], images[1, r], images[2, r], images[3, r]
        for k in range(len(lines)):
            line = lines[k, r]
            for x in range(columns):
                line[x] = np.float32(a[x]) + np.float32(b[x]) + np.float32(c[x]) + np.float32(d[x])
        for k in range(len(marks)):
            mark = marks[k, r]
            for x in range(columns):
                mark[x] = a[x] > b[x]


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
