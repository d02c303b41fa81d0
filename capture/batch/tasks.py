"""What a batch does with one captured set.

Each task reads its set from the file, wherever it runs, and gives back what is small: no pixels.
The paths must be absolute, because a worker of a cluster has a working folder of its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from capture.maps.files import write_maps
from capture.maps.surface_maps import RELIT_LIGHT
from capture.sets import ome_tiff
from capture.sets.captured_set import CapturedSet
from classify import Lighting, Match, Method, TextureLibrary
from classify.classifiers import Observation
from classify.errors import InputError
from classify.library.training import TrainingRow, common_lighting, observe
from classify.methods import DEFAULT_CLASSIFIER
from classify.texture.spectra import segment_for

__all__ = [
    "ClassifiedSet",
    "SetHeader",
    "SolveTask",
    "SolvedSet",
    "classify_set",
    "library_of",
    "observe_set",
    "read_header",
    "solve_set",
]


@dataclass(frozen=True)
class SetHeader:
    """What training asks of a set before its pixels; `segment_px` is what its size allows."""

    label: str
    orientation_deg: float | None
    simulated: bool
    segment_px: int
    lighting: Lighting
    pixels_sha256: str


def read_header(path: Path) -> SetHeader:
    """Look at a labelled set without reading its pixels.

    Raises
    ------
    InputError
        If it cannot be read, has no label, or is too small for a texture.
    """
    metadata, shape = ome_tiff.read_header(path)
    label = _required(metadata.label, path)
    with _naming(path):
        segment_px = segment_for(shape)
    return SetHeader(
        label,
        metadata.orientation_deg,
        metadata.simulated,
        segment_px,
        metadata.lighting.to_lighting(),
        metadata.pixels_sha256,
    )


def observe_set(path: Path, segment_px: int, classifier: str = DEFAULT_CLASSIFIER) -> Observation:
    """What training keeps of a set.

    Raises
    ------
    InputError
        If the set cannot be read or solved.
    """
    captured = CapturedSet.load(path)
    with _naming(path):
        return observe(captured.solve(), segment_px, classifier)


def library_of(
    headers: Sequence[SetHeader],
    observations: Sequence[Observation],
    segment_px: int,
    classifier: str = DEFAULT_CLASSIFIER,
    sources: Sequence[str] = (),
) -> TextureLibrary:
    """The library of sets that were observed with one size of segments.

    `sources` are the places of the sets as the library is to remember them.
    """
    rows = [
        TrainingRow(header.label, observed, header.orientation_deg)
        for header, observed in zip(headers, observations, strict=True)
    ]
    hashes = [header.pixels_sha256 for header in headers]
    return TextureLibrary.from_observations(
        rows,
        segment_px,
        classifier,
        lighting=common_lighting([header.lighting for header in headers]),
        simulated=any(header.simulated for header in headers),
        sources=list(zip(sources, hashes, strict=False)),
    )


@dataclass(frozen=True)
class ClassifiedSet:
    """What a library says of a set, and what was known of it."""

    match: Match
    label: str | None
    orientation_deg: float | None
    simulated: bool


def classify_set(path: Path, library: Path, label_required: bool = False) -> ClassifiedSet:
    """Solve a set and look its surface up in a library file.

    Raises
    ------
    InputError
        If the set or the library cannot be read, or the one does not fit the other.
    """
    captured = CapturedSet.load(path)
    metadata = captured.metadata
    if label_required:
        _required(metadata.label, path)
    trained = _library(library)
    with _naming(path):
        match = trained.classify(captured.solve())
    return ClassifiedSet(match, metadata.label, metadata.orientation_deg, metadata.simulated)


@dataclass(frozen=True)
class SolveTask:
    """A set and the folder for its maps."""

    path: Path
    folder: Path

    def __str__(self) -> str:
        return str(self.path)


@dataclass(frozen=True)
class SolvedSet:
    """The names of the maps that were written, and shares of the pixels."""

    files: tuple[str, ...]
    valid: float
    saturated: float
    shadowed: float
    simulated: bool


def solve_set(task: SolveTask, method: Method | None, light: Lighting = RELIT_LIGHT) -> SolvedSet:
    """Write the maps of a set, `relit.tif` under `light`.

    Raises
    ------
    InputError
        If the set cannot be read or solved, or the maps cannot be written.
    """
    captured = CapturedSet.load(task.path)
    with _naming(task.path):
        surface = captured.solve(method)
    written = write_maps(captured, surface, task.folder, light=light)
    return SolvedSet(
        files=tuple(path.name for path in written),
        valid=float(surface.valid.mean()),
        saturated=float(surface.saturated.mean()),
        shadowed=float(surface.shadow_mask.mean()),
        simulated=captured.metadata.simulated,
    )


def _required(label: str | None, path: Path) -> str:
    if not label:
        raise InputError(f"{path}: has no label; capture or import it with --label")
    return label


def _library(path: Path) -> TextureLibrary:
    about = path.stat()
    return _loaded(path, about.st_mtime_ns, about.st_size)


@lru_cache(maxsize=1)
def _loaded(path: Path, _mtime_ns: int, _size: int) -> TextureLibrary:
    return TextureLibrary.load(path)


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Put the file in front of what is wrong with its content."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
