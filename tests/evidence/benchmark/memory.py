"""Peak memory of single steps, each in its own process."""

import ctypes
import gc
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from capture.base.console import progress
from capture.base.process_settings import resident_bytes
from classify import Method, TextureLibrary
from classify.surface.estimate import FloatMap
from rig.simulation.simulated_set import SimulatedSet

from .measurements import Measurement, Section

Step = Callable[[], Callable[[], object]]
"""Compiles a step with a call on little data, and returns the call to measure."""

_CLEAR = Path("/proc/self/clear_refs")
_WARM_UP_PX = 256


def bytes_of(path: str, field: str) -> int:
    """Value of a field of a file in ``/proc``; 0 on systems without it."""
    if not Path(path).exists():
        return 0
    lines = Path(path).read_text(errors="replace").splitlines()
    return 1024 * int(dict(line.split(":", 1) for line in lines)[field].split()[0])


def memory_section(steps: Mapping[str, Step]) -> Section:
    """Measure each step in a new process."""
    if not _CLEAR.exists():
        return Section("Peak memory", (), ("Not measured: this system has no /proc.",))
    found = []
    for name, step in progress(steps.items(), len(steps), "memory"):
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
            before, peak = process.submit(_memory_mb, step).result()
        found.append(Measurement(name, peak - before, f"MB beyond {before:.0f} MB"))
    note = (
        "In addition to the memory of the process after it has loaded the program and read the "
        "input. Pages of a mapped file count, although the system can take them back."
    )
    return Section("Peak memory", found, (note,))


def solve_step(image_set: SimulatedSet, method: Method) -> Callable[[], object]:
    """Step that solves a set."""
    _corner(image_set).solve(method)
    return partial(image_set.solve, method)


def classify_step(library: Path, image_set: SimulatedSet) -> Callable[[], object]:
    """Step that classifies a set, from its images to a match."""
    trained = TextureLibrary.load(library)
    trained.classify(_corner(image_set).solve(planar=trained.planar))
    return lambda: trained.classify(image_set.solve(planar=trained.planar))


def match_step(library: Path, small: Path, query: FloatMap) -> Callable[[], object]:
    """Step that opens a library and matches one signature; `small` is another library."""
    TextureLibrary.load(small).match(query)
    return lambda: TextureLibrary.load(library).match(query)


def _corner(image_set: SimulatedSet) -> SimulatedSet:
    corner = (..., slice(_WARM_UP_PX), slice(_WARM_UP_PX))
    ambient = None if image_set.ambient is None else image_set.ambient[corner]
    return replace(image_set, images=image_set.images[corner], ambient=ambient)


def _memory_mb(step: Step) -> tuple[float, float]:
    """Resident memory before a step, and the maximum during it."""
    measured = step()
    gc.collect()
    # The step could use freed memory that the allocator keeps, and the peak would not show it.
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
    _CLEAR.write_text("5", encoding="ascii")  # resets the peak, see proc(5)
    before = resident_bytes() or 0
    kept = measured()
    peak = bytes_of("/proc/self/status", "VmHWM")
    del kept
    return before / 1e6, peak / 1e6
