"""The page ``teaching.html``: taught sets, limits, overlaps, expected error rates."""

from collections.abc import Iterable, Iterator

from capture.base.page import rendered
from capture.maps import pictures
from capture.station.domain.limits import RANGES
from capture.station.domain.recipe import Recipe
from classify.base.durable_file import durable_file

from .taught_parts import KeptSet, solved
from .teaching_result import Teaching

# Sets of an overlap with pictures; the table of all sets names the others.
_MAX_PICTURES = 4


def write_teaching_page(teaching: Teaching) -> None:
    """Write the page into the folder of the version; InputError if it cannot be written."""
    recipe = teaching.recipe

    def first_sets(texture: str) -> list[KeptSet]:
        return [part.kept_set for part in teaching.parts if part.kept_set.texture == texture][:1]

    def tiles(sets: Iterable[KeptSet]) -> Iterator[tuple[str, str]]:
        for taught_set in sets:
            surface = solved(taught_set, recipe.region)[1].surface
            name = f"{taught_set.texture} {taught_set.path.name}"
            relief = pictures.reduced(pictures.shaded(surface.normals))
            albedo = pictures.reduced(pictures.grey(surface.albedo))
            yield f"{name}: relief", pictures.tile_uri(relief)
            yield f"{name}: albedo", pictures.tile_uri(albedo)

    page = rendered(
        "station/judge/teaching/teaching.html",
        title=f"{recipe.name}, version {recipe.version}",
        facts=_facts(teaching),
        is_simulated=teaching.taught.setting.simulated,
        remarks=teaching.remarks,
        promises=list(teaching.promises()),
        least_defects=list(teaching.least_found()),
        overlaps=[
            (overlap, [*overlap.sets[:_MAX_PICTURES], *first_sets(overlap.other)])
            for overlap in teaching.overlaps
        ],
        limits=_limits(recipe),
        textures=[(name, first_sets(name)) for name in teaching.taught.textures],
        sets=_sets(teaching),
        tiles=tiles,
    )
    with durable_file(teaching.files.report) as temporary:
        temporary.write_text(page, encoding="utf-8")


def _facts(teaching: Teaching) -> Iterator[tuple[str, str]]:
    recipe, setting = teaching.recipe, teaching.taught.setting
    yield "pass", ", ".join(recipe.passes)
    yield "fail", ", ".join(recipe.fails) or "-"
    yield "sets", str(len(teaching.parts))
    yield "frame", f"{setting.width_px} x {setting.height_px} px of {setting.bit_depth} bit"
    yield "region", str(recipe.region or "whole frame")
    yield "calibration", "yes" if teaching.taught.has_calibration else "none"


def _limits(recipe: Recipe) -> Iterator[tuple[str, str, str]]:
    for name in recipe.passes:
        for key, value in recipe.limits_for(name).model_dump(exclude_none=True).items():
            bounds = value if key in RANGES else (value,)
            yield name, key, " to ".join(f"{bound:.4g}" for bound in bounds)


def _sets(teaching: Teaching) -> Iterator[tuple[str, ...]]:
    for part, match, inspection in zip(
        teaching.parts, teaching.matches, teaching.inspections, strict=True
    ):
        yield (
            part.kept_set.path.name,
            part.kept_set.texture,
            "-" if match is None else match.label or "unknown",
            "-" if match is None else f"{match.distance:.2f}",
            f"{part.sdq:.3f}",
            f"{part.shadow_fraction:.1%}",
            inspection.verdict.decision,
            inspection.verdict.reason,
        )
