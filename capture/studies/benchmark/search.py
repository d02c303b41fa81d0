"""How long a match takes in a library of any size, and what its sieve passes over."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from capture.console import progress
from classify import TextureLibrary
from classify.classifiers import Comparison, classifier_named
from classify.library.candidates import Sieve
from classify.surface.estimate import FloatMap

from .figures import Chapter, Figure
from .references import SETS_OF_A_CLASS, Mixtures, Textures
from .stopwatch import once_ms

__all__ = ["LARGE", "SMALLER", "Room", "needed_room", "save_large_library", "search_chapter"]

SMALLER = (30, 1_000, 10_000)
LARGE = 100_000

_MOST_MATCH_MS, _MOST_OPENING_MS, _LEAST_RECALL = 50.0, 1000.0, 99.9
_TIMED_QUERIES, _TIMED_ROUNDS = 50, 5
_RECALL_QUERIES, _FEWER_QUERIES = 1000, 100
_AT_ONCE = 1024

Indices = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Room:
    """What the largest library needs, and what there is; bytes."""

    disk: int
    memory: int
    free_disk: int
    free_memory: int

    @property
    def enough(self) -> bool:
        """Whether it fits."""
        return self.disk < self.free_disk and self.memory < self.free_memory

    def __str__(self) -> str:
        return (
            f"{LARGE:,} references need {self.disk / 1e9:.1f} GB of disk, where "
            f"{self.free_disk / 1e9:.1f} are free, and {self.memory / 1e9:.1f} GB of memory, "
            f"where {self.free_memory / 1e9:.1f} are"
        )


@dataclass(frozen=True)
class _Recall:
    """How many queries kept their nearest reference, and how many references were compared."""

    queries: int
    kept: int
    median_compared: float
    most_compared: int


def needed_room(textures: Textures, folder: Path) -> Room:
    """For a library of 100,000 in that folder."""
    signatures = LARGE * textures.signatures.shape[-1] * textures.signatures.itemsize
    # A tenth more for its invariants; in memory also what they are made from, and file pages.
    return Room(
        disk=int(1.15 * signatures),
        memory=int(2.5 * signatures),
        free_disk=shutil.disk_usage(folder).free,
        free_memory=_available_bytes(),
    )


def save_large_library(mixtures: Mixtures, path: Path) -> None:
    """Make it and write it; nothing of it stays in memory."""
    mixtures.library(LARGE).save(path)


def search_chapter(mixtures: Mixtures, large: Path | None, quick: bool) -> Chapter:
    """Match times of all sizes in turn, recall of the largest two, opening of the largest."""
    libraries = {size: mixtures.library(size) for size in SMALLER}
    figures = []
    if large is not None:
        opening_ms = min(once_ms(partial(TextureLibrary.load, large)) for _ in range(3))
        figures.append(
            Figure(f"opening {LARGE:,} references", opening_ms, "ms", target=_MOST_OPENING_MS)
        )
        libraries[LARGE] = TextureLibrary.load(large)
    queries = {size: mixtures.sets(_classes(size, _TIMED_QUERIES, seed=1)) for size in libraries}
    times = {size: np.full(_TIMED_QUERIES, np.inf) for size in libraries}
    rounds = range(1 if quick else _TIMED_ROUNDS)
    for _ in rounds:
        for index in range(_TIMED_QUERIES):
            for size, library in libraries.items():
                ms = once_ms(partial(library.match, queries[size][index]))
                times[size][index] = min(times[size][index], ms)
    first = float(np.median(times[SMALLER[0]]))
    for size in libraries:
        ms = float(np.median(times[size]))
        step = f"match, {size:,} references"
        figures.append(Figure(step, ms / first, f"x that of {SMALLER[0]}", ms))
        if size == LARGE:
            slowest = float(times[size].max())
            figures += [
                Figure(f"{step}, median", ms, "ms", target=_MOST_MATCH_MS),
                Figure(f"{step}, slowest", slowest, "ms", target=_MOST_MATCH_MS),
            ]
    for size, count in (
        (SMALLER[-1], _FEWER_QUERIES if quick else _RECALL_QUERIES),
        (LARGE, _FEWER_QUERIES),
    ):
        if size in libraries:
            asked = mixtures.sets(_classes(size, count, seed=2))
            figures += _recall_figures(size, _recall(libraries[size], asked))
    return Chapter(
        "Match against library size",
        figures,
        (
            f"{SETS_OF_A_CLASS} sets a class, asked about by another set at another angle.",
            f"Times: medians of {_TIMED_QUERIES} queries, the shortest of {len(rounds)} each.",
            "Recall: the nearest of all references is among those that the sieve lets compare.",
        ),
    )


def _classes(size: int, count: int, seed: int) -> Indices:
    return np.random.default_rng(seed).integers(-(-size // SETS_OF_A_CLASS), size=count)


def _recall_figures(size: int, recall: _Recall) -> list[Figure]:
    share = 100.0 * recall.kept / recall.queries
    step = f"sieve, {size:,} references"
    return [
        Figure(
            f"{step}, recall of {recall.queries:,} queries", share, "%",
            target=_LEAST_RECALL, bound="at least",
        ),
        Figure(f"{step}, compared in the median", recall.median_compared, "references"),
        Figure(f"{step}, compared at most", recall.most_compared, "references"),
    ]  # fmt: skip


def _recall(library: TextureLibrary, queries: FloatMap) -> _Recall:
    how = classifier_named(library.classifier)
    chunks = [np.s_[start : start + _AT_ONCE] for start in range(0, len(library.labels), _AT_ONCE)]
    invariants = [how.invariants(np.asarray(library.signatures[chunk])) for chunk in chunks]
    sieve = Sieve(np.concatenate(invariants), library.class_indices)

    def compare(query: FloatMap, which: Indices | slice) -> Comparison:
        return how.compare(query, np.asarray(library.signatures[which]), library.parameters)

    kept, compared = 0, []
    for query in progress(queries, len(queries), f"recall, {len(library.labels):,}"):
        every = np.concatenate([compare(query, chunk).distances for chunk in chunks])
        indices, found = sieve.nearest(how.invariants(query[None])[0], partial(compare, query))
        kept += bool(found.distances.min() <= every.min())
        compared.append(len(indices))
    return _Recall(len(queries), kept, float(np.median(compared)), max(compared))


def _available_bytes() -> int:
    """Memory that can be had without swapping."""
    for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
        name, value = line.split(":")
        if name == "MemAvailable":
            return 1024 * int(value.split()[0])
    return 0
