"""Train texture libraries from captured sets."""

import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from capture.base.console import progress
from capture.sets.captured_set import PLANAR
from classify import InputError, LibraryError, Method, TextureLibrary
from classify.library.training import TrainingRow, common_lighting
from classify.methods import DEFAULT_CLASSIFIER

from .runner import Batch
from .tasks import SetHeader, observe_set, read_header, warn_of_sets


def train_library(
    paths: Sequence[Path],
    folder: Path,
    batch: Batch,
    classifier: str = DEFAULT_CLASSIFIER,
    method: Method | None = None,
    calibration: Path | None = None,
) -> tuple[TextureLibrary, dict[str, int]]:
    """Train a library from labelled sets; return it and the number of sets of each class."""
    # The library stores paths relative to `folder`. A `calibration` replaces that of the sets.
    absolute = [path.absolute() for path in paths]
    calibration = None if calibration is None else calibration.absolute()
    for path in absolute:
        if str(path).encode(errors="replace").decode() != str(path):
            raise InputError(f"{path}: not valid UTF-8, and the library stores the path; rename it")
    read = batch.map(partial(read_header, method=method, calibration=calibration), absolute)
    headers = list(progress(read, len(paths), "read labels"))
    warn_of_sets((path, header.warnings) for path, header in zip(paths, headers, strict=True))
    method = _one_solver(paths, headers)
    segment_px = min(header.segment_px for header in headers)
    task = partial(
        observe_set,
        segment_px=segment_px,
        classifier=classifier,
        method=method,
        calibration=calibration,
    )
    observations = list(progress(batch.map(task, absolute), len(paths), "train"))
    library = TextureLibrary.from_observations(
        [
            TrainingRow(header.label, observation, header.orientation_deg)
            for header, observation in zip(headers, observations, strict=True)
        ],
        segment_px,
        classifier,
        lighting=common_lighting([header.lighting for header in headers]),
        method=method,
        planar=PLANAR,
        simulated=any(header.simulated for header in headers),
        sources=[
            (os.path.relpath(path, folder.absolute()), header.pixels_sha256)
            for path, header in zip(absolute, headers, strict=True)
        ],
    )
    labels = [header.label for header in headers]
    return library, {label: labels.count(label) for label in library.classes}


def _one_solver(paths: Sequence[Path], headers: Sequence[SetHeader]) -> Method:
    """The solver of all sets; InputError if it differs, because textures differ with it."""
    example = {header.method: path for path, header in zip(paths, headers, strict=True)}
    if len(example) > 1:
        solvers = ", ".join(f"{path} by {method}" for method, path in example.items())
        raise InputError(
            f"the training sets would be solved by different solvers ({solvers}); give --method "
            "least_squares, which suits all, or leave some out"
        )
    return headers[0].method


def retrain_library(
    library: TextureLibrary,
    path: Path,
    batch: Batch,
    classifier: str,
    method: Method | None = None,
    calibration: Path | None = None,
) -> TextureLibrary:
    """Train another classifier from the sets that the library at `path` was trained from."""
    method = method or library.method
    remedy = f"train a library with --classifier {classifier}"
    if not library.sources:
        raise LibraryError(f"{path}: does not name its training sets; {remedy}")
    set_paths = [path.absolute().parent / name for name, _ in library.sources]
    for set_path, (_, pixels_sha256) in zip(set_paths, library.sources, strict=True):
        try:
            present_sha256 = read_header(set_path, method, calibration).pixels_sha256
        except InputError as error:
            raise LibraryError(
                f"{path}: one of its training sets cannot be read ({error}); {remedy}"
            ) from error
        if present_sha256 != pixels_sha256:
            raise LibraryError(f"{path}: its training set {set_path} has changed since; {remedy}")
    return train_library(set_paths, path.parent, batch, classifier, method, calibration)[0]
