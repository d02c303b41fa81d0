"""The benchmark, section by section."""

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

from capture.base.console import out, print_json
from classify.base.threads import thread_count
from classify.defects.whitening import MIN_SIDE_PX

from . import memory
from .defects import defects_section
from .measurements import Section, as_json, print_section
from .mixtures import SETS_OF_A_CLASS, Mixtures, Textures, observed_textures
from .pipeline import pipeline_section
from .scenes import mosaic, rotated_patch
from .search import search_section
from .settings import FULL, Settings
from .solvers import solver_sections

Free = tuple[int, int]
"""Free disk and memory in bytes."""


def print_benchmark(settings: Settings, json: bool, free: Free | None = None) -> None:
    """Measure, and print each table when it is ready, or all results as JSON.

    The largest library is left out if `free` is too little; the default is measured.
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
        yield defects_section(max(size_px, MIN_SIDE_PX), settings.pipeline_rounds)
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
        yield memory.memory_section(_memory_steps(textures, mixtures, folder, largest, settings))


def fits(references: int, textures: Textures, folder: Path, free: Free | None = None) -> bool:
    """Whether disk and memory are large enough for a library; prints what it needs."""
    size = references * textures.signatures.shape[-1] * textures.signatures.itemsize
    # Invariants add a tenth to the file. Writing needs the signatures twice in memory.
    disk_bytes, memory_bytes = int(1.15 * size), int(2.5 * size)
    free_disk, free_memory = free or (
        shutil.disk_usage(folder).free,
        memory.bytes_of("/proc/meminfo", "MemAvailable"),
    )
    enough = disk_bytes < free_disk and memory_bytes < free_memory
    _say(
        f"{'' if enough else 'left out: '}{references:,} references need {disk_bytes / 1e9:.1f} GB "
        f"of disk ({free_disk / 1e9:.1f} GB free in {folder}) and {memory_bytes / 1e9:.1f} GB of "
        f"memory ({free_memory / 1e9:.1f} GB free)"
    )
    return enough


def _memory_steps(
    textures: Textures, mixtures: Mixtures, folder: Path, largest: Path | None, settings: Settings
) -> dict[str, memory.Step]:
    rows, cols = settings.solver_frame_px
    frame = mosaic((rows, cols), 16)
    steps: dict[str, memory.Step] = {
        f"ps4_robust, {cols} x {rows}, 16 bit": partial(memory.solve_step, frame, "ps4_robust")
    }
    small = folder / "small.ps4lib"
    textures.library.save(small)
    for size_px in settings.frames_px:
        image_set = rotated_patch("sand", 1, size_px, 33.0)
        steps[f"classification, {size_px} x {size_px}"] = partial(
            memory.classify_step, small, image_set
        )
    middle = folder / "middle.ps4lib"
    mixtures.library(settings.library_sizes[-1]).save(middle)
    libraries = {settings.library_sizes[-1]: middle}
    if largest is not None and settings.largest_library is not None:
        libraries[settings.largest_library] = largest
    query = mixtures.sets(np.array([0]))[0]
    for size, path in libraries.items():
        steps[f"opening and match, {size:,} references"] = partial(
            memory.match_step, path, small, query
        )
    return steps


def _say(message: str) -> None:
    print(f"ps4rig: {message}", file=sys.stderr)


def _machine() -> dict[str, str | int]:
    """Processor, threads and versions."""
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
