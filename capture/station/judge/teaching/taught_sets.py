"""The taught sets of a recipe: copies of captured sets in its folder."""

import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from capture.base.names import SET_SUFFIX
from capture.calibration.lookup import keep_beside
from capture.sets.captured_set import LoadedSet
from capture.station.domain.errors import RecipeError
from capture.station.domain.recipe import Recipe
from capture.station.domain.recipe_file import RecipeFolder
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
    has_label: bool = True  # False if its texture is only the default, the name of the recipe
    source: Path | None = None  # the file that was copied; None for a set that was taught before

    def __str__(self) -> str:
        return (
            self.path.name if self.source is None else f"{self.source} (kept as {self.path.name})"
        )


def known_sets(files: RecipeFolder, recipe: Recipe) -> Iterator[KeptSet]:
    """Yield the sets that a recipe was taught, except those whose file was removed."""
    if recipe.taught is None:
        return
    remedy = (
        f"restore it from a backup, or remove {files.file} and teach the sets in {files.sets} "
        "again, with --label TEXTURE"
    )
    measurements = read_taught(files.version(recipe.version).taught, remedy)
    for texture, taught in measurements.textures.items():
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


def sets_by_texture(
    known: Sequence[KeptSet],
    added: Sequence[KeptSet],
    removed: Sequence[str],
    *,
    is_relabelling: bool,
) -> list[KeptSet]:
    """Return all different sets, ordered by texture."""
    names = {kept_set.path.name for kept_set in known}
    for name in removed:
        if name not in names:
            raise RecipeError(f"--remove {name[:100]}: no set of this name was taught")
    by_pixels = {
        kept_set.pixels_sha256: kept_set for kept_set in known if kept_set.path.name not in removed
    }
    for kept_set in added:
        earlier = by_pixels.get(kept_set.pixels_sha256, kept_set)
        if earlier.texture != kept_set.texture and (earlier in added or not is_relabelling):
            raise RecipeError(
                f"{kept_set.path}: was taught as {earlier.texture!r} and cannot be "
                f"{kept_set.texture!r} too; give --relabel to change its texture, or --remove with "
                "its name to take it out"
            )
        by_pixels[kept_set.pixels_sha256] = kept_set
    return sorted(by_pixels.values(), key=lambda kept_set: kept_set.texture)
