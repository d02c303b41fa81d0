"""Libraries from captured sets, and again from the sets that a library remembers."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from classify import TextureLibrary
from classify.errors import InputError, LibraryError
from classify.methods import DEFAULT_CLASSIFIER

from .batch.runner import Batch
from .batch.tasks import library_of, observe_set, read_header
from .console import progress

__all__ = ["Trained", "train_again", "train_library"]


class Trained(NamedTuple):
    """A library and the number of sets that each class was learned from."""

    library: TextureLibrary
    sets: dict[str, int]


def train_library(
    paths: Sequence[Path],
    folder: Path,
    classifier: str = DEFAULT_CLASSIFIER,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Trained:
    """Learn from labelled sets; the library remembers where they are from `folder`, its place.

    Raises
    ------
    InputError
        If a set cannot be read, solved, or has no label.
    """
    absolute = [path.absolute() for path in paths]
    with Batch(workers, scheduler) as batch:
        headers = list(progress(batch.map(read_header, absolute), len(paths), "look"))
        segment_px = min(header.segment_px for header in headers)
        task = partial(observe_set, segment_px=segment_px, classifier=classifier)
        observations = list(progress(batch.map(task, absolute), len(paths), "train"))
    sources = [os.path.relpath(path, folder.absolute()) for path in absolute]
    trained = library_of(headers, observations, segment_px, classifier, sources)
    labels = [header.label for header in headers]
    return Trained(trained, {label: labels.count(label) for label in trained.classes})


def train_again(
    library: TextureLibrary,
    path: Path,
    classifier: str,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
) -> TextureLibrary:
    """Learn for another classifier from the very sets that a library was learned from.

    Raises
    ------
    LibraryError
        If it does not say from which, or one of them is gone or has changed.
    """
    if not library.sources:
        raise LibraryError(
            f"{path}: does not say what it was trained from; train one with "
            f"--classifier {classifier}"
        )
    places = [path.absolute().parent / name for name, _ in library.sources]
    for place, (_, pixels_sha256) in zip(places, library.sources, strict=True):
        try:
            found = read_header(place).pixels_sha256
        except InputError as error:
            raise LibraryError(
                f"{path}: one of its training sets cannot be read ({error}); train one with "
                f"--classifier {classifier}"
            ) from error
        if found != pixels_sha256:
            raise LibraryError(
                f"{path}: its training set {place} has changed since; train one with "
                f"--classifier {classifier}"
            )
    again = train_library(places, path.parent, classifier, workers=workers, scheduler=scheduler)
    return again.library
