"""Find captured sets below folders, and name a folder for the results of each."""

import os
from collections.abc import Sequence
from pathlib import Path

from classify.errors import InputError

from .ome_tiff import SUFFIX

# Of a session: its journal, and the folder for files that it has set aside.
JOURNAL, REPLACED = "journal.json", "replaced"


def is_set_aside(path: Path) -> bool:
    """Whether a session has replaced this file, or found it damaged."""
    return path.parent.name == REPLACED and (path.parent.parent / JOURNAL).is_file()


def find_sets(places: Sequence[Path]) -> list[Path]:
    """Return the files among `places`, and all captured sets below each folder, sorted.

    A file that is named twice, or is below a folder that is named too, is returned once.
    """
    found: dict[Path, Path] = {}  # by their true paths

    def add(path: Path) -> None:
        found.setdefault(path.resolve(), path)

    for place in places:
        if place.is_dir():
            below = sorted(
                path
                for path in place.rglob(f"*{SUFFIX}")
                if path.is_file() and (not is_set_aside(path) or place == path.parent)
            )
            if not below:
                raise InputError(f"{place}: holds no captured sets (*{SUFFIX})")
            for path in below:
                add(path)
        elif place.exists():
            add(place)
        else:
            raise InputError(f"{place}: no such file or folder")
    return [*found.values()]


def output_folders(places: Sequence[Path], output: Path) -> dict[Path, Path]:
    """Return a folder for the results of each captured set of `places`.

    A single set given as a file has `output` itself. Otherwise each set has a folder named after
    it, whose path below `output` is that of the set below the common folder of all `places`. So
    sets with equal names have different folders.
    """
    sets = find_sets(places)
    if len(sets) == 1 and sets == list(places):
        return {sets[0]: output}
    try:
        top = os.path.commonpath(
            [_absolute(place if place.is_dir() else place.parent) for place in places]
        )
    except ValueError as error:  # on Windows, for different drives
        raise InputError(
            f"{', '.join(map(str, places))}: on different drives; run the command for each drive"
        ) from error
    return {
        path: output / _absolute(path).relative_to(top).with_name(path.name.removesuffix(SUFFIX))
        for path in sets
    }


def _absolute(path: Path) -> Path:
    # Remove "..", but follow no links: they may lead out of the common folder.
    return Path(os.path.normpath(path.absolute()))
