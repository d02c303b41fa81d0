"""Captured sets by the hundred: where they lie, and where what is made of each goes."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from classify.errors import InputError

from .ome_tiff import SUFFIX

__all__ = ["find_sets", "output_folders"]


def find_sets(places: Sequence[Path]) -> list[Path]:
    """The files among `places`, and for a folder all captured sets below it, sorted.

    Raises
    ------
    InputError
        If there is no such place, or a folder holds none.
    """
    found: list[Path] = []
    for place in places:
        if place.is_dir():
            below = sorted(path for path in place.rglob(f"*{SUFFIX}") if path.is_file())
            if not below:
                raise InputError(f"{place}: holds no captured sets (*{SUFFIX})")
            found += below
        elif place.exists():
            found.append(place)
        else:
            raise InputError(f"{place}: no such file or folder")
    return found


def output_folders(places: Sequence[Path], output: Path) -> dict[Path, Path]:
    """For each captured set of `places` the folder for what is made of it.

    For one set, given as a file, that is `output`. Several have each a folder of their own name
    below it, and above that the folders in which they lie, counted from the one that holds all
    `places`: sets of one name in two folders do not meet.

    Raises
    ------
    InputError
        As `find_sets`.
    """
    sets = find_sets(places)
    if len(sets) == 1 and sets == list(places):
        return {sets[0]: output}
    top = os.path.commonpath(
        [_absolute(place if place.is_dir() else place.parent) for place in places]
    )
    return {
        path: output / _absolute(path).relative_to(top).with_name(path.name.removesuffix(SUFFIX))
        for path in sets
    }


def _absolute(path: Path) -> Path:
    # Without the .. of a path, and without following links, which may lead anywhere.
    return Path(os.path.normpath(path.absolute()))
