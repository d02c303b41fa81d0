"""Time of a match against the size of the library, and recall of the sieve."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from capture.console import progress
from capture.studies.stopwatch import time_ms
from classify import TextureLibrary
from classify.classifiers import classifier_named
from classify.surface.estimate import FloatMap

from .measurements import Measurement, Section
from .mixtures import SETS_OF_A_CLASS, Mixtures, Textures
from .settings import Settings

__all__ = ["Space", "available_memory", "required_space", "search_section"]

# Targets for the largest library: match and opening on two cores, and recall of the sieve.
_MAX_MATCH_MS, _MAX_OPENING_MS, _MIN_RECALL_PCT = 50.0, 1000.0, 99.9
# References compared in one call: 20 MB of signatures.
_CHUNK = 1024

Indices = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Space:
    """Disk and memory that a library needs, and that are free; bytes."""

    references: int
    disk: int
    memory: int
    free_disk: int
    free_memory: int

    @property
    def is_enough(self) -> bool:
        """Whether the library fits."""
        return self.disk < self.free_disk and self.memory < self.free_memory

    def __str__(self) -> str:
        return (
            f"{self.references:,} references need {self.disk / 1e9:.1f} GB of disk "
            f"({self.free_disk / 1e9:.1f} GB free) and {self.memory / 1e9:.1f} GB of memory "
            f"({self.free_memory / 1e9:.1f} GB free)"
        )


def required_space(
    references: int, textures: Textures, folder: Path, free_memory: int | None = None
) -> Space:
    """Space for a library in that folder; `free_memory` is measured if not given."""
    size = references * textures.signatures.shape[-1] * textures.signatures.itemsize
    return Space(
        references,
        # The invariants of the sieve add a tenth. Writing needs the signatures twice in memory.
        disk=int(1.15 * size),
        memory=int(2.5 * size),
        free_disk=shutil.disk_usage(folder).free,
        free_memory=available_memory() if free_memory is None else free_memory,
    )


def search_section(mixtures: Mixtures, largest: Path | None, settings: Settings) -> Section:
    """Match times of all sizes, recall of the largest two, opening of the one in a file."""
    sizes = settings.library_sizes
    libraries = {size: mixtures.library(size) for size in sizes}
    found = []
    recall_queries = {sizes[-1]: settings.recall_queries}
    if largest is not None:
        opening_ms = min(time_ms(partial(TextureLibrary.load, largest)) for _ in range(3))
        library = TextureLibrary.load(largest)
        size = len(library.labels)
        step = f"opening {size:,} references"
        found.append(Measurement(step, opening_ms, "ms", target=_MAX_OPENING_MS))
        libraries[size] = library
        recall_queries[size] = settings.largest_recall_queries
    times = _match_times(mixtures, libraries, settings)
    smallest_ms = float(np.median(times[sizes[0]]))
    for size, each in times.items():
        ms = float(np.median(each))
        step = f"match, {size:,} references"
        found.append(Measurement(step, ms / smallest_ms, f"x that of {sizes[0]}", ms))
        if size not in sizes:
            slowest_ms = float(each.max())
            found += [
                Measurement(f"{step}, median", ms, "ms", target=_MAX_MATCH_MS),
                Measurement(f"{step}, slowest", slowest_ms, "ms", target=_MAX_MATCH_MS),
            ]
    for size, count in recall_queries.items():
        found += _recall(libraries[size], mixtures.sets(_classes(size, count, seed=2)))
    queries, rounds = settings.match_queries, settings.match_rounds
    return Section(
        "Match against library size",
        found,
        (
            f"{SETS_OF_A_CLASS} sets a class; each query is another set at another orientation.",
            f"Times: medians of {queries} queries, the shortest of {rounds} each.",
            "Recall: the nearest of all references is among those that the sieve compares.",
        ),
    )


def _match_times(
    mixtures: Mixtures, libraries: dict[int, TextureLibrary], settings: Settings
) -> dict[int, npt.NDArray[np.float64]]:
    """Shortest time of each query by size of the library, in milliseconds."""
    count = settings.match_queries
    queries = {size: mixtures.sets(_classes(size, count, seed=1)) for size in libraries}
    times = {size: np.full(count, np.inf) for size in libraries}
    for _ in range(settings.match_rounds):
        for index in range(count):
            for size, library in libraries.items():
                ms = time_ms(partial(library.match, queries[size][index]))
                times[size][index] = min(times[size][index], ms)
    return times


def _classes(size: int, count: int, seed: int) -> Indices:
    return np.random.default_rng(seed).integers(-(-size // SETS_OF_A_CLASS), size=count)


def _recall(library: TextureLibrary, queries: FloatMap) -> Iterator[Measurement]:
    """Compare the sieve with a search through all references."""
    size = len(library.labels)
    compare = classifier_named(library.classifier).compare
    kept, compared = 0, []
    for query in progress(queries, len(queries), f"recall, {size:,}"):
        nearest = min(
            compare(query, references, library.parameters).distances.min()
            for start in range(0, size, _CHUNK)
            for references in [np.asarray(library.signatures[start : start + _CHUNK])]
        )
        indices, found = library.candidates(query)
        kept += bool(found.distances.min() <= nearest)
        compared.append(len(indices))
    step = f"sieve, {size:,} references"
    recall_pct = 100.0 * kept / len(queries)
    recall_step = f"{step}, recall of {len(queries):,} queries"
    yield Measurement(recall_step, recall_pct, "%", target=_MIN_RECALL_PCT, bound="at least")
    yield Measurement(f"{step}, compared in the median", float(np.median(compared)), "references")
    yield Measurement(f"{step}, compared at most", max(compared), "references")


def available_memory() -> int:
    """Bytes of memory that are available without swapping."""
    for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
        name, value = line.split(":")
        if name == "MemAvailable":
            return 1024 * int(value.split()[0])
    return 0
