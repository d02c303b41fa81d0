"""Many captured sets: finding them, and naming a folder for the results of each."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from classify.errors import InputError

from .ome_tiff import SUFFIX

__all__ = ["find_sets", "output_folders"]


def find_sets(places: Sequence[Path]) -> list[Path]:
    """Return the files among `places`, and all captured sets below each folder, sorted.

    Raises
    ------
    InputError
        If a place does not exist, or a folder holds no set.
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
    """Return a folder for the results of each captured set of `places`.

    For one set, given as a file, this is `output`. Of several sets each has a folder of its own
    name. It lies below `output` as the set lies below the common folder of all `places`, so that
    two sets of one name have different folders.

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
    # Without ".." in the path. Links are not followed: they may lead out of the common folder.
    return Path(os.path.normpath(path.absolute()))
