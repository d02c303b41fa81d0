"""The taught sets of a recipe, copied to its folder, and `TaughtPart`: the measurements of one."""

import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from capture.acquisition.light_checks import known_levels
from capture.base.names import SET_SUFFIX
from capture.calibration.lookup import keep_beside
from capture.calibration.setting import Setting
from capture.sets.captured_set import LoadedSet
from capture.station.domain.errors import RecipeError
from capture.station.domain.recipe import Recipe, Region
from capture.station.domain.recipe_file import RecipeFolder
from capture.station.domain.taught import read_taught
from capture.station.judge.measured_surface import MeasuredSurface, fits
from classify import Lighting
from classify.base.durable_file import durable_file, make_folder
from classify.base.errors import InputError
from classify.classifiers import Observation, classifier_named
from classify.library.dissimilarity import texture_groups
from classify.library.training import TrainingRow, observe
from classify.methods import DEFAULT_CLASSIFIER, checked_label
from classify.pieces.features import band_moments
from classify.pieces.learning import SCALE_STEP, scaled_surface
from classify.surface.estimate import FloatMap
from classify.surface.tilt_error import tilt_error_deg
from classify.texture.spectra import segment_for

# Distance from which two groups of sets, by average linkage, are two textures; that of two quarters
# of one frame is 1. Groups of 4 to 16 sets have up to 1.07 within rock, sand, malv or ogil, and 3.8
# to 46 between two of them (`tests/capture/station/judge/test_unlabelled.py`).
_GROUP_DISTANCE = 2.0
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


@dataclass(frozen=True, eq=False)
class TaughtPart:
    """A taught set and its measurements; for its maps, the set is solved again."""

    kept_set: KeptSet
    setting: Setting
    has_calibration: bool
    # A classifier may have different observations for training and for matching.
    training_row: TrainingRow
    matching_observation: Observation
    # Observations of the texture scaled by 1 - SCALE_STEP and 1 + SCALE_STEP.
    scaled: tuple[Observation, ...]
    moments: FloatMap  # result of `band_moments`
    segment_px: int
    lighting: Lighting | None  # from the calibration, if any
    sdq: float
    shadow_fraction: float
    unmeasured_fraction: float
    albedo: float
    light_signals: tuple[float, ...]  # see `MeasuredSurface.light_signals`
    has_known_levels: bool  # whether the redundancy of the images shows the levels of the LEDs
    tilt_error_deg: float
    mm_per_px: float | None


def solved(kept_set: KeptSet, region: Region | None) -> tuple[LoadedSet, MeasuredSurface]:
    """Load a set and solve it with the default solver for its lights."""
    loaded = LoadedSet.of(kept_set.path)
    rows, columns = loaded.captured.images.shape[1:]
    if not fits(region, (rows, columns)):
        raise RecipeError(f"{kept_set.path}: {columns} x {rows} px; the region is {region}")
    return loaded, MeasuredSurface.of(loaded.captured, region, loaded.found_calibration, None)


def taught_part(kept_set: KeptSet, region: Region | None) -> TaughtPart:
    """Measure a set; InputError if its region shows no texture."""
    loaded, measured = solved(kept_set, region)
    surface, metadata = measured.surface, loaded.captured.metadata
    try:
        segment_px = segment_for(surface.shape)
        observation = observe(surface, segment_px)
        classifier = classifier_named(DEFAULT_CLASSIFIER)
        matching_observation = classifier.observe(surface, segment_px)
        scaled = tuple(
            classifier.observe(scaled_surface(surface, 1.0 + step), segment_px)
            for step in (-SCALE_STEP, SCALE_STEP)
        )
        moments = band_moments(surface)
    except InputError as error:
        raise InputError(f"{kept_set.path}: {error}") from error
    return TaughtPart(
        kept_set=kept_set,
        setting=loaded.captured.setting,
        has_calibration=loaded.found_calibration is not None,
        training_row=TrainingRow(kept_set.texture, observation, metadata.orientation_deg),
        matching_observation=matching_observation,
        scaled=scaled,
        moments=moments,
        segment_px=segment_px,
        lighting=surface.lighting,
        sdq=measured.sdq,
        shadow_fraction=measured.share(measured.shadowed),
        unmeasured_fraction=measured.unmeasured_fraction,
        albedo=measured.albedo,
        light_signals=measured.light_signals,
        has_known_levels=known_levels(metadata.checks) is not None,
        tilt_error_deg=tilt_error_deg(surface),
        mm_per_px=loaded.mm_per_px,
    )


def check_same_setting(parts: Sequence[TaughtPart]) -> None:
    """Check that all sets have the same setting, and all or none a calibration."""
    first = parts[0]
    for part in parts[1:]:
        differences = first.setting.all_differences(part.setting)
        if part.has_calibration != first.has_calibration:
            differences.append("one has a calibration and the other has none")
        if differences:
            raise RecipeError(
                f"{part.kept_set.path} and {first.kept_set.path} differ: {'; '.join(differences)}; "
                "teach sets of one setting, or remove one of the files"
            )


def unlabelled_remarks(parts: Sequence[TaughtPart]) -> Iterator[str]:
    """Yield a remark if there are sets without a label."""
    if parts:
        kept_set, count = parts[0].kept_set, len(parts)
        yield (
            f"{count} set{'s' * (count != 1)} without a label, as {kept_set}: taught as "
            f"{kept_set.texture}; --label TEXTURE names another one"
        )


def require_one_texture(parts: Sequence[TaughtPart]) -> None:
    """Check that sets without a label look alike."""
    if len(parts) < 2:
        return
    rows, tests = (
        [part.training_row for part in parts],
        [part.matching_observation for part in parts],
    )
    groups = texture_groups(rows, tests, parts[0].segment_px, _GROUP_DISTANCE)
    firsts = [groups.index(group) for group in sorted(set(groups))]
    if len(firsts) > 1:
        named = ", ".join(
            f"{groups.count(groups[first])} like {parts[first].kept_set}" for first in firsts
        )
        raise RecipeError(
            f"{len(parts)} sets have no label, and look like {len(firsts)} textures: {named}; "
            "teach each with --label TEXTURE"
        )
