"""The benchmark, section by section."""

from __future__ import annotations

import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np

from capture.console import out, print_json
from classify.threads import thread_count

from .measurements import Section, as_json, print_section
from .memory import (
    Step,
    available_memory,
    classify_step,
    match_step,
    memory_section,
    numpy_step,
    solve_step,
)
from .mixtures import SETS_OF_A_CLASS, Mixtures, Textures, observed_textures
from .pipeline import pipeline_section
from .scenes import mosaic, rotated_patch
from .search import search_section
from .settings import FULL, Settings
from .solvers import drop_darkest, normal_least_squares, solver_sections

__all__ = ["Free", "fits", "print_benchmark"]

Free = tuple[int, int]
"""Free disk and memory in bytes."""


def print_benchmark(settings: Settings, json: bool, free: Free | None = None) -> None:
    """Measure, and print tables as they are ready or all as JSON.

    `free` decides on the largest library; it is measured if not given.
    """
    about = _machine()
    measured = _sections(settings, free)
    if json:
        quick = settings.largest_library is None
        print_json({"machine": about, "quick": quick, "chapters": [*map(as_json, measured)]})
        return
    out.print(
        f"{about['processor']}, {about['cores']} cores; ps4rig {about['ps4rig']}, "
        f"Python {about['python']}, numpy {about['numpy']}, numba {about['numba']}",
        soft_wrap=True,
    )
    for section in measured:
        print_section(section)


def _sections(settings: Settings, free: Free | None) -> Iterator[Section]:
    yield from solver_sections(settings)
    textures = observed_textures(settings.textures, settings.texture_frame_px)
    for size_px in settings.frames_px:
        yield pipeline_section(textures.library, size_px, settings.pipeline_rounds)
    with tempfile.TemporaryDirectory(prefix="ps4rig-bench-") as name:
        folder = Path(name)
        largest, references = None, settings.library_sizes[-1]
        if settings.largest_library is None:
            _say(f"left out by --quick: {FULL.largest_library:,} references")
        elif fits(settings.largest_library, textures, folder, free):
            largest, references = folder / "largest.ps4lib", settings.largest_library
        mixtures = Mixtures(textures, references // SETS_OF_A_CLASS)
        if largest is not None:
            mixtures.library(references).save(largest)
        yield search_section(mixtures, largest, settings)
        yield memory_section(_memory_steps(textures, mixtures, folder, largest, settings))


def fits(references: int, textures: Textures, folder: Path, free: Free | None = None) -> bool:
    """Whether disk and memory are large enough for a library; prints both."""
    size = references * textures.signatures.shape[-1] * textures.signatures.itemsize
    # Invariants add a tenth to the file. Writing needs the signatures twice in memory.
    disk, memory = int(1.15 * size), int(2.5 * size)
    free_disk, free_memory = free or (shutil.disk_usage(folder).free, available_memory())
    enough = disk < free_disk and memory < free_memory
    _say(
        f"{'' if enough else 'left out: '}{references:,} references need {disk / 1e9:.1f} GB of "
        f"disk ({free_disk / 1e9:.1f} GB free in {folder}) and {memory / 1e9:.1f} GB of memory "
        f"({free_memory / 1e9:.1f} GB free)"
    )
    return enough


def _memory_steps(
    textures: Textures, mixtures: Mixtures, folder: Path, largest: Path | None, settings: Settings
) -> dict[str, Step]:
    shape = settings.solver_frame_px
    frame = f"{shape[1]} x {shape[0]}"
    sixteen = mosaic(shape, 16)
    steps: dict[str, Step] = {
        f"ps4_robust, {frame}, 16 bit": partial(solve_step, sixteen, "ps4_robust"),
    }
    if settings.all_memory_steps:
        eight = mosaic(shape, 8)
        steps |= {
            f"ps4_robust, {frame}, 8 bit": partial(solve_step, eight, "ps4_robust"),
            f"ps4, {frame}, 16 bit": partial(solve_step, sixteen, "ps4"),
            f"numpy lstsq, {frame}, 16 bit": partial(numpy_step, sixteen, normal_least_squares),
            f"numpy drop-darkest, {frame}, 16 bit": partial(numpy_step, sixteen, drop_darkest),
        }
    small = folder / "small.ps4lib"
    textures.library.save(small)
    for size_px in settings.frames_px:
        image_set = rotated_patch("sand", 1, size_px, 33.0)
        steps[f"classification, {size_px} x {size_px}"] = partial(classify_step, small, image_set)
    middle = folder / "middle.ps4lib"
    mixtures.library(settings.library_sizes[-1]).save(middle)
    libraries = {settings.library_sizes[-1]: middle}
    if largest is not None and settings.largest_library is not None:
        libraries[settings.largest_library] = largest
    query = mixtures.sets(np.array([0]))[0]
    for size, path in libraries.items():
        steps[f"opening and match, {size:,} references"] = partial(match_step, path, small, query)
    return steps


def _say(message: str) -> None:
    print(f"ps4rig: {message}", file=sys.stderr)


def _machine() -> dict[str, str | int]:
    """Hardware and versions of this machine."""
    return {
        "ps4rig": version("ps4rig"),
        "processor": _processor(),
        "cores": os.cpu_count() or 1,
        "threads": thread_count(),
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "numba": version("numba"),
    }


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":")[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
