"""The numbers of a report: sets against the textures of all specimens."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from statistics import NormalDist

import numpy as np

from capture.sets.captured_set import LoadedSet
from classify import InputError, Spectra, SurfaceEstimate, TextureLibrary, surface_spectra
from classify.base.arrays import Floats
from classify.images import SIGMA_PER_MAD
from classify.library.dissimilarity import (
    Dendrogram,
    class_dissimilarities,
    dendrogram,
    embedding,
    own_scatter_limits,
)

from .folder import SessionFolder
from .journal import SetEntry

# Distances of patches of one texture are log-normal with this deviation (joint_learning.py). In
# one of a hundred sessions the largest distance is beyond the limit by chance.
_LOG_DISTANCE_SPREAD = 0.43
_FALSE_ALARM_RATE = 0.01


@dataclass(frozen=True, eq=False)
class SpecimenResult:
    """The first set of a specimen, its surface and its spectra; None if it is too small."""

    loaded: LoadedSet
    surface: SurfaceEstimate
    spectra: Spectra | None


@dataclass(frozen=True, eq=False)
class Separation:
    """The separation of the specimens by their textures."""

    specimens: list[str]  # the C specimens that have a texture
    entries: list[SetEntry]  # the n sets of these specimens
    # (n, C) of each set to the first set of each specimen; NaN for the first sets.
    distances: Floats
    limits: Floats  # (C,) distance beyond which a part is not the texture of a specimen
    dissimilarities: Floats  # (C, C) of the specimens
    tree: Dendrogram
    map_positions: Floats  # (n, 2) of the sets, by landmark multidimensional scaling


@dataclass(frozen=True, eq=False)
class SessionAnalysis:
    """Everything that the page of a report shows."""

    entries: list[SetEntry]  # captured sets, in the order of their capture
    specimens: dict[str, SpecimenResult]  # by their ids
    separation: Separation | None  # None with fewer than two specimens that have a texture
    damaged: dict[str, str]  # errors of the sets that cannot be read or solved, by their files
    remarks: list[tuple[str, str]]  # (file, remark) for a person to look at
    repeatability: list[_Repeatability]  # of placements with repeated sets


def analyse(
    folder: SessionFolder, on_progress: Callable[[float], None] | None = None
) -> SessionAnalysis:
    """Analyse the captured sets of a session; damaged ones are named and left out."""
    damaged: dict[str, str] = {}
    entries = sorted(folder.captured(), key=lambda entry: entry.captured_utc or "")
    entries = [entry for entry in entries if _loaded(folder.path, entry, damaged) is not None]
    specimens: dict[str, SpecimenResult] = {}
    for specimen in dict.fromkeys(
        entry.entered_specimen for entry in entries if entry.entered_specimen
    ):
        for entry in folder.sets_of(specimen):
            loaded = _loaded(folder.path, entry, damaged)
            surface = _surface(loaded, entry, damaged)
            if loaded is not None and surface is not None:
                specimens[specimen] = _specimen(loaded, surface)
                break
    separation = _separation(folder.path, entries, specimens, damaged, on_progress)
    entries = [entry for entry in entries if entry.file not in damaged]
    remarks = [*_remarks(entries, separation)]
    repeatability = [*_repeatability(folder.path, entries, damaged)]
    return SessionAnalysis(entries, specimens, separation, damaged, remarks, repeatability)


def _repeatability(
    folder: Path, entries: list[SetEntry], damaged: dict[str, str]
) -> Iterator[_Repeatability]:
    for pair in _first_repeats(entries):
        loaded = [_loaded(folder, entry, damaged) for entry in pair]
        surfaces = [captured.solve(uncertainty=True) for captured in loaded if captured is not None]
        if len(surfaces) == len(pair) and (repeatability := _repeatability_of(pair[0], *surfaces)):
            yield repeatability


def _loaded(folder: Path, entry: SetEntry, damaged: dict[str, str]) -> LoadedSet | None:
    """Load a set; a damaged one is entered into `damaged`."""
    file = entry.file or ""
    if file in damaged:
        return None
    path = folder / file
    try:
        loaded = LoadedSet.of(path)
    except InputError as error:
        damaged[file] = str(error).removeprefix(f"{path}: ")
        return None
    if loaded.captured.metadata.pixels_sha256 != entry.pixels_sha256:
        damaged[file] = "its pixels are not those that the journal names"
        return None
    return loaded


def _specimen(loaded: LoadedSet, surface: SurfaceEstimate) -> SpecimenResult:
    try:
        spectra = surface_spectra(surface)
    except InputError:
        spectra = None
    return SpecimenResult(loaded, surface, spectra)


def _surface(
    loaded: LoadedSet | None, entry: SetEntry, damaged: dict[str, str]
) -> SurfaceEstimate | None:
    """Solve a set; one that cannot be solved is entered into `damaged`."""
    if loaded is None:
        return None
    try:
        return loaded.solve_texture(None, planar=True)
    except InputError as error:
        damaged[entry.file or ""] = str(error)
        return None


def _separation(
    folder: Path,
    entries: list[SetEntry],
    specimens: dict[str, SpecimenResult],
    damaged: dict[str, str],
    on_progress: Callable[[float], None] | None,
) -> Separation | None:
    usable = {
        name: specimen for name, specimen in specimens.items() if specimen.spectra is not None
    }
    if len(usable) < 2:
        return None
    names = list(usable)
    library = TextureLibrary.train(
        [(name, specimen.surface, 0.0) for name, specimen in usable.items()]
    )
    first_hashes = {
        specimen.loaded.captured.metadata.pixels_sha256: name for name, specimen in usable.items()
    }
    usable_entries = [entry for entry in entries if entry.entered_specimen in usable]
    compared, rows = [], []
    for number, entry in enumerate(usable_entries):
        self_distance = {}
        if entry.pixels_sha256 in first_hashes:
            surface: SurfaceEstimate | None = usable[entry.entered_specimen].surface
            # The distance of the first set to itself is not that of a repeated capture.
            self_distance = {entry.entered_specimen: math.nan}
        else:
            surface = _surface(_loaded(folder, entry, damaged), entry, damaged)
        if surface is not None:
            try:
                rows.append([(library.distances(surface) | self_distance)[name] for name in names])
                compared.append(entry)
            except InputError as error:
                damaged[entry.file or ""] = str(error)
        if on_progress is not None:
            on_progress((number + 1) / len(usable_entries))
    distances = np.array(rows)
    filled = np.nan_to_num(distances, nan=0.0)
    matrix = class_dissimilarities(
        filled, [names.index(entry.entered_specimen) for entry in compared]
    )
    single_limits = own_scatter_limits(library)
    limits = np.array([single_limits[name] for name in names])
    return Separation(
        names, compared, distances, limits, matrix, dendrogram(matrix), embedding(filled, matrix)
    )


def _remarks(entries: list[SetEntry], separation: Separation | None) -> Iterator[tuple[str, str]]:
    """Warnings of the captures, duplicates, and sets that do not look like their specimen."""
    first_files: dict[str | None, str | None] = {}
    for entry in entries:
        for warning in entry.measures.warnings if entry.measures else ():
            yield str(entry.file), warning
        if entry.pixels_sha256 in first_files:
            yield str(entry.file), f"has the pixels of {first_files[entry.pixels_sha256]}"
        first_files.setdefault(entry.pixels_sha256, entry.file)
    if separation is None:
        return
    yield from outliers(separation)


def outliers(separation: Separation) -> Iterator[tuple[str, str]]:
    """Yield sets that look like another class, or like none.

    A set looks like none if it is beyond the limit of its specimen, and beyond what the median of
    the session and log-normal scatter explain.
    """
    names, entries = separation.specimens, separation.entries
    classes = np.array([names.index(entry.entered_specimen) for entry in entries])
    shares = separation.distances[range(len(classes)), classes] / separation.limits[classes]
    is_first = np.isnan(shares)
    labels = {
        entry.entered_specimen: entry.description and entry.description.label
        for entry, is_first_set in zip(entries, is_first, strict=True)
        if is_first_set
    }
    repeated_shares = shares[~is_first]
    if not len(repeated_shares):
        return
    deviations = NormalDist().inv_cdf(1.0 - _FALSE_ALARM_RATE / len(repeated_shares))
    median = float(np.median(repeated_shares))
    limit = max(1.0, median * math.exp(_LOG_DISTANCE_SPREAD * deviations))
    for entry, row, share in zip(entries, separation.distances, shares, strict=True):
        nearest = names[int(np.nanargmin(row))]
        if math.isnan(share):
            continue
        if labels[nearest] != labels[entry.entered_specimen]:
            remark = (
                f"looks more like {nearest} than like {entry.entered_specimen}; if that specimen "
                f"lay below the camera, correct the set with ps4rig info --set specimen={nearest}"
            )
        elif share > limit:
            remark = (
                f"its distance from the first set of {entry.entered_specimen} is "
                f"{share / limit:.1f} times the limit; compare both with ps4rig compare; if this "
                "one is wrong, delete its file, and ps4rig session resume captures it again"
            )
        else:
            continue
        yield str(entry.file), remark


@dataclass(frozen=True)
class _Repeatability:
    """Deviation of a slope between two repeats of a placement."""

    specimen: str
    orientation_deg: float
    measured: float  # robust deviation of the difference of p, q over the square root of two
    stated: float  # median standard deviation of p, q


def _first_repeats(entries: Iterable[SetEntry]) -> list[tuple[SetEntry, SetEntry]]:
    """The first two sets of each placement that has two."""

    def place(entry: SetEntry) -> tuple[str, float]:
        return entry.specimen, entry.orientation_deg

    groups = [list(sets) for _, sets in groupby(sorted(entries, key=place), key=place)]
    return [(sets[0], sets[1]) for sets in groups if len(sets) > 1]


def _repeatability_of(
    entry: SetEntry, first: SurfaceEstimate, second: SurfaceEstimate
) -> _Repeatability | None:
    """Compare two surfaces with deviations; None without a pixel that is valid in both."""
    valid = first.valid & second.valid
    if first.shape != second.shape or not valid.any():
        return None
    planes = ((first.p, second.p, first.p_sd), (first.q, second.q, first.q_sd))
    differences, deviations = [], []
    for one, other, deviation in planes:
        assert deviation is not None
        differences.append(np.abs(one - other)[valid])
        deviations.append(deviation[valid])
    spread = SIGMA_PER_MAD * float(np.median(np.concatenate(differences))) / np.sqrt(2.0)
    stated = float(np.median(np.concatenate(deviations)))
    return _Repeatability(entry.specimen, entry.orientation_deg, float(spread), stated)
