"""Solvers against the memory bus and against what one would write in numpy."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit, prange

from classify import Lighting, Method, SurfaceEstimate

from .figures import Chapter, Figure
from .scenes import mosaic
from .stopwatch import least_ms

__all__ = ["bandwidth_floor", "drop_darkest", "normal_least_squares", "solver_chapters"]

FRAME_PX = (1944, 2592)
"""Rows and columns of a common sensor of five megapixels."""

METHODS: tuple[Method, ...] = ("ps4", "ps4_robust", "least_squares")
_FLOOR_MAPS = 3
_MOST_OF_FLOOR = 2.0
_LEAST_OF_LSTSQ = 100.0

Array = npt.NDArray[Any]


def solver_chapters(quick: bool) -> list[Chapter]:
    """Both pixel depths, at five megapixels."""
    return [_chapter(bits, quick) for bits in (8, 16)]


def _chapter(bits: int, quick: bool) -> Chapter:
    shot = mosaic(FRAME_PX, bits)
    megapixels = shot.images[0].size / 1e6
    solved = {method: partial(shot.solve, method) for method in METHODS}
    floats, small = _maps(shot.solve())
    three = np.empty((_FLOOR_MAPS, *FRAME_PX), np.float32)
    every, marks = (
        np.empty((count, *FRAME_PX), kind)
        for count, kind in ((floats, np.float32), (small, np.uint8))
    )
    nothing = marks[:0]
    floors: dict[str, Callable[[], object]] = {
        "floor": partial(bandwidth_floor, shot.images, three, nothing),
        "floor of all maps": partial(bandwidth_floor, shot.images, every, marks),
    }
    times = least_ms(floors | solved, 5 if quick else 15)
    plain = least_ms(
        {
            "numpy lstsq": partial(normal_least_squares, shot.images, shot.lighting),
            "numpy drop-darkest": partial(drop_darkest, shot.images, shot.lighting),
        },
        1 if quick else 3,
    )
    floor, all_maps = times["floor"], times["floor of all maps"]
    figures = [
        Figure("floor: read 4 planes, write 3 float32", 1.0, "x floor", floor),
        Figure(f"the same, write all {floats + small} maps", all_maps / floor, "x floor", all_maps),
    ]
    for method in METHODS:
        ms = times[method]
        figures += [
            Figure(method, ms / floor, "x floor", ms, target=_MOST_OF_FLOOR),
            Figure(method, ms / all_maps, "x floor of all maps", ms),
            Figure(
                f"{method} against numpy lstsq", plain["numpy lstsq"] / ms, "x faster",
                plain["numpy lstsq"], _LEAST_OF_LSTSQ, "at least",
            ),
            Figure(
                f"{method} against numpy drop-darkest", plain["numpy drop-darkest"] / ms,
                "x faster", plain["numpy drop-darkest"],
            ),
        ]  # fmt: skip
    return Chapter(
        f"Solvers, {bits} bit, {megapixels:.2f} megapixels",
        figures,
        [
            "The shortest of several calls, taken in turn. The floor writes into the same buffers "
            "each time, a solver into new maps. Times beside a factor are those of numpy. "
            "lstsq: one call of np.linalg.lstsq for the (4, 3) lights with all pixels as "
            "right-hand sides, without slopes or albedo."
        ],
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
def bandwidth_floor(images: Array, floats: Array, marks: Array) -> None:
    """Read four planes once and write float32 and byte maps once, with next to no arithmetic."""
    _, rows, columns = images.shape
    for r in prange(rows):
        a, b, c, d = images[0, r], images[1, r], images[2, r], images[3, r]
        for k in range(len(floats)):
            line = floats[k, r]
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
