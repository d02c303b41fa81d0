"""Peak memory of steps, each in a process of its own: beyond the program and its input."""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from capture.console import progress
from classify import Method, TextureLibrary
from classify.surface.estimate import FloatMap

from .figures import Chapter, Figure
from .scenes import Shot
from .solvers import drop_darkest, normal_least_squares

__all__ = ["Step", "classify_step", "match_step", "memory_chapter", "numpy_step", "solve_step"]

Step = Callable[[], Callable[[], object]]
"""Reads its input, calls everything once on little of it, and returns what is to be measured."""

_STATUS, _CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")
_RESET_PEAK = "5"
_WARM_PX = 256


def memory_chapter(steps: Mapping[str, Step]) -> Chapter:
    """Run each step in a fresh process."""
    figures = []
    if _CLEAR.exists():
        for name, step in progress(steps.items(), len(steps), "memory"):
            context = get_context("spawn")
            with ProcessPoolExecutor(1, mp_context=context) as process:
                before, peak = process.submit(_peak_mb, step).result()
            figures += [Figure(name, peak - before, f"MB beyond {before:.0f} MB")]
    return Chapter(
        "Peak memory",
        figures,
        (
            "Beyond what the process had with the program loaded and the input read; pages of a "
            "mapped file count, although the system can take them back."
            if figures
            else "Not measured: this system has no /proc.",
        ),
    )


def solve_step(shot: Shot, method: Method) -> Callable[[], object]:
    """The solver on a shot."""
    _corner(shot).solve(method)
    return partial(shot.solve, method)


def numpy_step(shot: Shot, which: str) -> Callable[[], object]:
    """What one would write in numpy instead."""
    function: Callable[..., object] = {"lstsq": normal_least_squares, "drop": drop_darkest}[which]
    function(_corner(shot).images, shot.lighting)
    return partial(function, shot.images, shot.lighting)


def classify_step(library: Path, shot: Shot) -> Callable[[], object]:
    """From images to a match."""
    trained = TextureLibrary.load(library)
    trained.classify(_corner(shot).solve())
    return lambda: trained.classify(shot.solve())


def match_step(library: Path, little: Path, query: FloatMap) -> Callable[[], object]:
    """Open a library and look for one signature."""
    TextureLibrary.load(little).match(query)
    return lambda: TextureLibrary.load(library).match(query)


def _corner(shot: Shot) -> Shot:
    corner = (..., slice(_WARM_PX), slice(_WARM_PX))
    ambient = None if shot.ambient is None else shot.ambient[corner]
    return replace(shot, images=shot.images[corner], ambient=ambient)


def _peak_mb(step: Step) -> tuple[float, float]:
    """Resident memory before a step, and the most during it."""
    measured = step()
    gc.collect()
    # What was freed and kept would be used again unseen.
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
    _CLEAR.write_text(_RESET_PEAK, encoding="ascii")
    before = _resident_mb("VmRSS")
    kept = measured()
    peak = _resident_mb("VmHWM")
    del kept
    return before, peak


def _resident_mb(what: str) -> float:
    for line in _STATUS.read_text(encoding="ascii").splitlines():
        name, value = line.split(":")
        if name == what:
            return int(value.split()[0]) / 1000.0
    return 0.0
