"""Teach a recipe: make a new version from captured sets of good and bad parts."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from capture.base.console import ShowProgress, progress
from capture.sets.captured_set import PLANAR, LoadedSet
from capture.station.domain.errors import RecipeError
from capture.station.domain.limits import GeneralLimits, Limits
from capture.station.domain.recipe import Recipe
from capture.station.domain.recipe_file import (
    RecipeFolder,
    TaughtFiles,
    file_sha256,
    read_recipe,
    write_recipe,
)
from capture.station.domain.taught import Taught, TaughtSet, TaughtTexture, TextureModels
from capture.station.judge.inspector import Inspection, Inspector
from classify import Match, TextureLibrary
from classify.base.durable_file import make_folder
from classify.classifiers import Observation, classifier_named
from classify.classifiers.joint import ring_means
from classify.defects.learning import MAX_PARTS, MIN_PARTS
from classify.library.evaluation import leave_one_out
from classify.library.training import common_lighting
from classify.methods import default_method
from classify.pieces.learning import SCALE_STEP, GoodPart, learn_pieces
from classify.pieces.piece_model import PieceModel

from .taught_defects import TaughtDefects, mark_remark, teach_defects
from .taught_parts import (
    KeptSet,
    TaughtPart,
    check_same_setting,
    keep_sets,
    known_sets,
    require_one_texture,
    sets_by_texture,
    taught_part,
    unlabelled_remarks,
)
from .teaching_limits import (
    LimitsOf,
    general_limits,
    kept_remarks,
    least_led_level,
    level_remarks,
    limits_measured_before,
    limits_of_texture,
    manual_limits,
    replaced_remarks,
    with_manual_limits,
    with_unjudged,
)
from .teaching_page import write_teaching_page
from .teaching_result import Teaching


def teach(
    files: RecipeFolder,
    paths: Sequence[Path],
    bad_texture: str | None = None,
    *,
    good_texture: str | None = None,
    is_relabelling: bool = False,
    removed: Sequence[str] = (),
    show: ShowProgress = progress,
) -> Teaching:
    """Teach sets in addition to the known ones, without those `removed`, or relabel known ones.

    The new version of the recipe is written last.
    """
    with files.changing():
        before = read_recipe(files.file) if files.file.exists() else None
        known = [] if before is None else list(known_sets(files, before))
        added = keep_sets(paths, files.sets, bad_texture or good_texture, files.name)
        sets = sets_by_texture(known, added, removed, is_relabelling=is_relabelling)
        added_textures = list(dict.fromkeys(kept_set.texture for kept_set in added))
        emptied = {kept_set.texture for kept_set in known} - {kept_set.texture for kept_set in sets}
        recipe = _next_version(files, before, added_textures, emptied, bad=bad_texture is not None)
        _check_good_parts(recipe, sets)
        known_limits = {} if before is None else limits_measured_before(files, before)
        teaching = _teaching_of(files, recipe, sets, known_limits, show)
        teaching.taught.write(teaching.files.taught)
        measured = teaching.recipe.model_copy(update={"limits_of": teaching.measured})
        write_recipe(teaching.files.measured, measured)
        for result in show((teaching,), 1, "pictures"):
            write_teaching_page(result)
        write_recipe(files.file, teaching.recipe)
        return teaching


def _next_version(
    files: RecipeFolder,
    before: Recipe | None,
    textures: Sequence[str],
    emptied: Collection[str],
    *,
    bad: bool,
) -> Recipe:
    """The next version of a recipe, with further `textures` and without the `emptied` ones."""
    name = files.name
    before = before or Recipe(name=name, passes=())
    passes, fails = (
        tuple(texture for texture in names if texture not in emptied)
        for names in (before.passes, before.fails)
    )
    for texture in textures:
        if texture in (passes if bad else fails):
            raise RecipeError(
                f"{texture!r} is a {'good' if bad else 'bad'} texture of recipe {name}; give "
                f"another name, or move it between pass and fail in {name}.toml"
            )
    if bad:
        fails = tuple(dict.fromkeys([*fails, *textures]))
    else:
        passes = tuple(dict.fromkeys([*passes, *textures]))
    if not passes:
        raise RecipeError(f"recipe {name} has no good parts yet; teach these first")
    changes: dict[str, Any] = {"passes": passes, "fails": fails, "approval": None}
    changes["limits_of"] = {
        name: limits for name, limits in before.limits_of.items() if name not in emptied
    }
    # After a roll-back, or without the recipe's own file, the files of later versions stay; their
    # numbers are not used again.
    taught = [*files.taught_versions()[:1], *([before.version] if before.taught else [])]
    version = max([before.version, *(number + 1 for number in taught)])
    return Recipe.model_validate({**dict(before), **changes, "version": version})


def _check_good_parts(recipe: Recipe, sets: Sequence[KeptSet]) -> None:
    for texture in recipe.passes:
        count = sum(kept_set.texture == texture for kept_set in sets)
        if count < MIN_PARTS:
            raise RecipeError(
                f"{count} good parts of {texture!r}; give {MIN_PARTS} or more, 30 are better"
            )
        if count > MAX_PARTS:
            raise RecipeError(
                f"{count} good parts of {texture!r}, known and given ones; at most {MAX_PARTS} "
                f"can be taught: give fewer, or remove files from recipes/{recipe.name}/sets"
            )


def _teaching_of(
    files: RecipeFolder,
    recipe: Recipe,
    sets: Sequence[KeptSet],
    known_limits: LimitsOf | None,
    show: ShowProgress,
) -> Teaching:
    solving = (taught_part(kept_set, recipe.region) for kept_set in sets)
    parts = list(show(solving, len(sets), "solve"))
    check_same_setting(parts)
    unlabelled = [part for part in parts if not part.kept_set.has_label]
    require_one_texture(unlabelled)
    version = files.version(recipe.version)
    make_folder(version.folder)
    library = _library(parts)
    library.save(version.library)
    matches = leave_one_out(
        [part.training_row for part in parts],
        [part.matching_observation for part in parts],
        library.segment_px,
    )
    good = {
        name: [part for part in parts if part.kept_set.texture == name] for name in recipe.passes
    }
    defects = {
        name: teach_defects(good_parts, library, recipe, show) for name, good_parts in good.items()
    }
    models = {
        name: TextureModels(learned.model, _piece_model(good[name], library))
        for name, learned in defects.items()
    }
    textures = {
        name: _taught_texture(name, parts, matches, version, models, defects)
        for name in library.classes
    }
    taught = Taught(
        setting=parts[0].setting,
        region=recipe.region,
        has_calibration=parts[0].has_calibration,
        library_sha256=file_sha256(version.library),
        textures=textures,
    )
    limits_before, manual = recipe.limits_of, manual_limits(recipe.limits_of, known_limits)
    measured = _measured_limits(recipe, parts, matches, models)
    recipe = _with_limits(recipe, with_manual_limits(measured, manual), taught)
    inspections = _inspections(recipe, taught, library, models, parts, show)
    measured = _with_unjudged_areas(measured, recipe.limits, parts, inspections)
    limits_of = with_manual_limits(measured, manual)
    if limits_of != recipe.limits_of:
        recipe = recipe.model_copy(update={"limits_of": limits_of})
        inspections = _inspections(recipe, taught, library, models, parts, show)
    remarks = [
        *unlabelled_remarks(unlabelled),
        *kept_remarks(measured, manual),
        *_blind_spots(models),
        *_mark_remarks(defects, good),
        *level_remarks(taught),
    ]
    if known_limits is None:
        remarks += replaced_remarks(limits_before, limits_of)
    return Teaching(
        recipe=recipe,
        taught=taught,
        files=version,
        parts=tuple(parts),
        matches=tuple(matches),
        inspections=tuple(inspections),
        false_alarm_bounds={
            name: model.defects.false_alarm_bound for name, model in models.items()
        },
        measured=measured,
        teaching_remarks=tuple(remarks),
        uniformity=library.uniformity,
    )


def _with_unjudged_areas(
    measured: LimitsOf,
    general: GeneralLimits,
    parts: Sequence[TaughtPart],
    inspections: Sequence[Inspection],
) -> dict[str, Limits]:
    """Return measured limits that accept the largest unscored area of each part."""
    areas_px: dict[str, list[int]] = {}
    for part, inspection in zip(parts, inspections, strict=True):
        area_px = inspection.measures.unjudged_px or 0
        areas_px.setdefault(part.kept_set.texture, []).append(area_px)
    return {
        name: with_unjudged(limits, general, areas_px[name]) for name, limits in measured.items()
    }


def _mark_remarks(
    defects: Mapping[str, TaughtDefects], good: Mapping[str, Sequence[TaughtPart]]
) -> Iterator[str]:
    for name, learned in defects.items():
        if learned.mark is not None:
            yield mark_remark(name, len(good[name]), learned.mark)


def _blind_spots(models: Mapping[str, TextureModels]) -> Iterator[str]:
    """Yield remarks on faults that the models of a texture cannot find."""
    for name, model in models.items():
        if model.pieces.handedness is None:
            yield f"{name} looks like its mirror image: a mirrored part is not found"
        if not model.pieces.has_direction:
            yield f"{name} looks alike at 90 degrees: a piece that lies otherwise may not be found"


def _library(parts: Sequence[TaughtPart]) -> TextureLibrary:
    return TextureLibrary.from_observations(
        [part.training_row for part in parts],
        parts[0].segment_px,
        lighting=common_lighting([part.lighting for part in parts]),
        method=default_method(len(parts[0].light_signals)),
        planar=PLANAR,
        simulated=parts[0].setting.simulated,
        sources=[
            (f"../sets/{part.kept_set.path.name}", part.kept_set.pixels_sha256) for part in parts
        ],
    )


def _piece_model(parts: Sequence[TaughtPart], library: TextureLibrary) -> PieceModel:
    classifier = classifier_named(library.classifier)

    def rings(observation: Observation) -> npt.NDArray[np.float64]:
        return ring_means(classifier.signature(observation, library.parameters))

    good, changes = [], []
    for part in parts:
        signature = classifier.signature(part.matching_observation, library.parameters)
        levels = ring_means(signature)
        good.append(GoodPart(part.moments, library.match(signature).orientation_deg, levels))
        changes += [
            (rings(scaled) - levels) / math.log(1.0 + step)
            for scaled, step in zip(part.scaled, (-SCALE_STEP, SCALE_STEP), strict=True)
        ]
    return learn_pieces(good, np.mean(changes, axis=0))


def _taught_texture(
    texture: str,
    parts: Sequence[TaughtPart],
    matches: Sequence[Match | None],
    files: TaughtFiles,
    models: Mapping[str, TextureModels],
    learned: Mapping[str, TaughtDefects],
) -> TaughtTexture:
    of_texture = [
        (part, match)
        for part, match in zip(parts, matches, strict=True)
        if part.kept_set.texture == texture
    ]
    signals = [part.light_signals for part, _ in of_texture]
    means = tuple(sum(levels) / len(of_texture) for levels in zip(*signals, strict=True))
    undetermined = [part.light_signals for part, _ in of_texture if not part.has_known_levels]
    errors_deg = [part.tilt_error_deg for part, _ in of_texture]
    taught = TaughtTexture(
        sets=tuple(_taught_set(part.kept_set, match) for part, match in of_texture),
        light_signals=means,
        least_led_level=least_led_level(undetermined, means),
        tilt_errors_deg=(min(errors_deg), max(errors_deg)),
    )
    if texture not in models:
        return taught
    number, model = list(models).index(texture) + 1, models[texture]
    defects, pieces = files.defects(number), files.pieces(number)
    model.defects.save(defects)
    model.pieces.save(pieces)
    changes = {
        "defects_file": defects.name,
        "defects_sha256": model.defects.sha256,
        "pieces_file": pieces.name,
        "pieces_sha256": model.pieces.sha256,
        "least_found": learned[texture].least_found,
    }
    return taught.model_copy(update=changes)


def _taught_set(kept_set: KeptSet, match: Match | None) -> TaughtSet:
    if match is None:
        return TaughtSet(file=kept_set.path.name, pixels_sha256=kept_set.pixels_sha256)
    return TaughtSet(
        file=kept_set.path.name,
        pixels_sha256=kept_set.pixels_sha256,
        found=match.label,
        nearest=match.nearest,
        distance=match.distance,
    )


def _measured_limits(
    recipe: Recipe,
    parts: Sequence[TaughtPart],
    matches: Sequence[Match | None],
    models: Mapping[str, TextureModels],
) -> dict[str, Limits]:
    limits_of: dict[str, Limits] = {}
    for texture in recipe.passes:
        indices = [n for n, part in enumerate(parts) if part.kept_set.texture == texture]
        limits_of[texture] = limits_of_texture(
            [
                match.distance
                for match in (matches[n] for n in indices)
                if match is not None and match.nearest == texture
            ],
            [parts[n].sdq for n in indices],
            [parts[n].shadow_fraction for n in indices],
            [parts[n].unmeasured_fraction for n in indices],
            [parts[n].albedo for n in indices],
            models[texture].pieces.scale_deviation,
            has_handedness=models[texture].pieces.handedness is not None,
        )
    return limits_of


def _with_limits(recipe: Recipe, limits_of: LimitsOf, taught: Taught) -> Recipe:
    """The recipe with the taught limits, exposure and need of a calibration."""
    exposure_ms = taught.setting.exposure_ms
    required = recipe.calibration.required or taught.has_calibration
    return recipe.model_copy(
        update={
            "limits": general_limits(recipe.limits, limits_of),
            "limits_of": limits_of,
            "light": recipe.light.model_copy(update={"exposure_ms": exposure_ms}),
            "calibration": recipe.calibration.model_copy(update={"required": required}),
            "taught": taught.sha256,
        }
    )


def _inspections(
    recipe: Recipe,
    taught: Taught,
    library: TextureLibrary,
    models: Mapping[str, TextureModels],
    parts: Sequence[TaughtPart],
    show: ShowProgress,
) -> list[Inspection]:
    """Verdicts of the recipe on its own sets, each with its own calibration."""
    inspector = Inspector(recipe, taught, library, models)

    def inspections() -> Iterator[Inspection]:
        for part in parts:
            loaded = LoadedSet.of(part.kept_set.path)
            yield inspector.with_calibration(loaded.found_calibration).inspect(loaded.captured)

    return list(show(inspections(), len(parts), "inspect"))
