"""The whole benchmark, one chapter after the other."""

from __future__ import annotations

import os
import platform
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numba
import numpy as np

from . import search, solvers
from .figures import Chapter
from .memory import (
    Step,
    classify_step,
    match_step,
    memory_chapter,
    numpy_step,
    solve_step,
)
from .pipeline import pipeline_chapter
from .references import SETS_OF_A_CLASS, Mixtures, Textures, observed_textures
from .scenes import mosaic, turned_patch
from .search import needed_room, save_large_library, search_chapter
from .solvers import solver_chapters

__all__ = ["chapters", "machine"]

FRAMES_PX = (512, 1024)


def machine() -> dict[str, str | int]:
    """What was measured on."""
    return {
        "ps4rig": version("ps4rig"),
        "processor": _processor(),
        "cores": os.cpu_count() or 1,
        "threads": numba.get_num_threads(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
    }


def chapters(quick: bool) -> Iterator[Chapter]:
    """Measure and say, one chapter at a time. Files lie in a folder that is removed at the end."""
    yield from solver_chapters(quick)
    textures = observed_textures()
    for size_px in FRAMES_PX:
        yield pipeline_chapter(textures.library, size_px, quick)
    with tempfile.TemporaryDirectory(prefix="ps4rig-bench-") as name:
        folder = Path(name)
        large, classes = None, search.SMALLER[-1] // SETS_OF_A_CLASS
        room = needed_room(textures, folder)
        if quick:
            print(f"ps4rig: left out by --quick: {search.LARGE:,} references", file=sys.stderr)
        elif not room.enough:
            print(f"ps4rig: left out: {room}", file=sys.stderr)
        else:
            print(f"ps4rig: {room}, in {folder}", file=sys.stderr)
            large, classes = folder / "large.ps4lib", search.LARGE // SETS_OF_A_CLASS
        mixtures = Mixtures(textures, classes)
        if large is not None:
            save_large_library(mixtures, large)
        yield search_chapter(mixtures, large, quick)
        yield memory_chapter(_steps(textures, mixtures, folder, large, quick))


def _steps(
    textures: Textures, mixtures: Mixtures, folder: Path, large: Path | None, quick: bool
) -> dict[str, Step]:
    thirty = folder / "thirty.ps4lib"
    textures.library.save(thirty)
    query = mixtures.sets(np.array([0]))[0]
    frame = f"{solvers.FRAME_PX[1]} x {solvers.FRAME_PX[0]}"
    sixteen = mosaic(solvers.FRAME_PX, 16)
    steps: dict[str, Step] = {
        f"ps4_robust, {frame}, 16 bit": partial(solve_step, sixteen, "ps4_robust"),
    }
    if not quick:
        eight = mosaic(solvers.FRAME_PX, 8)
        steps |= {
            f"ps4_robust, {frame}, 8 bit": partial(solve_step, eight, "ps4_robust"),
            f"ps4, {frame}, 16 bit": partial(solve_step, sixteen, "ps4"),
            f"numpy lstsq, {frame}, 16 bit": partial(numpy_step, sixteen, "lstsq"),
            f"numpy drop-darkest, {frame}, 16 bit": partial(numpy_step, sixteen, "drop"),
        }
    for size_px in FRAMES_PX:
        shot = turned_patch("sand", 1, size_px, 33.0)
        steps[f"classification, {size_px} x {size_px}"] = partial(classify_step, thirty, shot)
    middle = folder / "middle.ps4lib"
    mixtures.library(search.SMALLER[-1]).save(middle)
    libraries = {search.SMALLER[-1]: middle} | ({} if large is None else {search.LARGE: large})
    for size, path in libraries.items():
        steps[f"opening and match, {size:,} references"] = partial(match_step, path, thirty, query)
    return steps


def _processor() -> str:
    """Its name, as the system knows it."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":")[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
