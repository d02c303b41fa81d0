"""The taught sets of a recipe: copies of captured sets in its folder."""

import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from capture.base.names import SET_SUFFIX
from capture.calibration.lookup import keep_beside
from capture.sets.captured_set import LoadedSet
from capture.station.domain.recipe import Recipe
from capture.station.domain.recipe_folder import RecipeFolder
from capture.station.domain.taught import read_taught
from classify.base.durable_file import durable_file, make_folder
from classify.base.errors import InputError
from classify.methods import checked_label

_DIGITS = 16  # of the hash of the pixels in a file name


@dataclass(frozen=True)
class KeptSet:
    """A captured set in the folder of a recipe: its texture, file, and hash of its pixels."""

    texture: str
    path: Path
    pixels_sha256: str
    has_label: bool = True  # given now or earlier; False if it has the name of the recipe
    source: Path | None = None  # the file that was copied; None for a set that was taught before

    def __str__(self) -> str:
        return (
            self.path.name if self.source is None else f"{self.source} (kept as {self.path.name})"
        )


def known_sets(files: RecipeFolder, recipe: Recipe) -> Iterator[KeptSet]:
    """Yield the sets that a recipe was taught, except those whose file was removed."""
    if recipe.taught is None:
        return
    for texture, taught in read_taught(files.version(recipe.version).taught).textures.items():
        for taught_set in taught.sets:
            path = files.sets / taught_set.file
            if path.is_file():
                yield KeptSet(texture, path, taught_set.pixels_sha256)


def keep_sets(
    paths: Sequence[Path], folder: Path, texture: str | None, default: str
) -> list[KeptSet]:
    """Copy sets with their calibrations, unless they were copied before.

    Their texture is `texture`, or else the label of each set, or else `default`.
    """
    make_folder(folder)
    kept_sets = []
    for path in paths:
        loaded = LoadedSet.of(path)
        metadata = loaded.captured.metadata
        copy = folder / f"{metadata.pixels_sha256[:_DIGITS]}{SET_SUFFIX}"
        if not copy.exists():
            with durable_file(copy) as temporary:
                shutil.copyfile(path, temporary)
        if loaded.found_calibration is not None:
            keep_beside(loaded.found_calibration.file, copy)
        try:
            name = checked_label(texture or metadata.label or default)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        has_label = bool(texture or metadata.label)
        kept_sets.append(KeptSet(name, copy, metadata.pixels_sha256, has_label, path))
    return kept_sets
