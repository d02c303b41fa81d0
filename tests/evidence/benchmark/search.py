"""Time of a match against the size of the library, and recall of the sieve."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from capture.base.console import progress
from capture.chapter.results import time_ms
from classify import TextureLibrary
from classify.classifiers import classifier_named
from classify.surface.estimate import FloatMap

from .measurements import Measurement, Section
from .mixtures import SETS_OF_A_CLASS, Mixtures
from .settings import Settings

# Targets of the project for 100,000 references on two cores.
_MAX_MATCH_MS, _MAX_OPENING_MS, _MIN_RECALL_PCT = 50.0, 1000.0, 99.9
# References compared in one call: 20 MB of signatures.
_CHUNK = 1024

Indices = npt.NDArray[np.intp]


def search_section(mixtures: Mixtures, largest: Path | None, settings: Settings) -> Section:
    """Match times for all sizes, recall for the largest two, opening time of `largest`."""
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
    """Shortest time of each query in milliseconds, by size of the library."""
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
    """Share of queries whose nearest reference passes the sieve, and number of those that pass."""
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
