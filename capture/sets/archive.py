"""Find captured sets below folders, and name a folder for the results of each."""

import os
from collections.abc import Sequence
from pathlib import Path

from capture.base.names import SET_SUFFIX
from classify.base.errors import InputError

# Of a session: its journal, and the folder for files that it has set aside.
JOURNAL, REPLACED = "journal.json", "replaced"


def is_set_aside(path: Path) -> bool:
    """Whether a session has replaced this file, or found it damaged."""
    return path.parent.name == REPLACED and (path.parent.parent / JOURNAL).is_file()


def find_sets(places: Sequence[Path]) -> list[Path]:
    """The files among `places`, and all captured sets below each folder, sorted, each once."""
    sets: dict[Path, Path] = {}  # by their true paths

    def add(path: Path) -> None:
        sets.setdefault(path.resolve(), path)

    for place in places:
        if place.is_dir():
            below = sorted(
                path
                for path in place.rglob(f"*{SET_SUFFIX}")
                if path.is_file() and (not is_set_aside(path) or place == path.parent)
            )
            if not below:
                raise InputError(f"{place}: holds no captured sets (*{SET_SUFFIX})")
            for path in below:
                add(path)
        elif place.exists():
            add(place)
        else:
            raise InputError(f"{place}: no such file or folder")
    return [*sets.values()]


def output_folders(places: Sequence[Path], output: Path) -> dict[Path, Path]:
    """Return a folder for the results of each captured set.

    For a single file, it is `output`. For others, it is a path below `output` like that of the set
    below the common folder.
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
        path: output
        / _absolute(path).relative_to(top).with_name(path.name.removesuffix(SET_SUFFIX))
        for path in sets
    }


def _absolute(path: Path) -> Path:
    # Remove "..", but follow no links: they may lead out of the common folder.
    return Path(os.path.normpath(path.absolute()))
