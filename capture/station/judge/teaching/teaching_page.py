"""The page ``teaching.html``: taught sets, limits, overlaps, expected error rates."""

from collections.abc import Iterable, Iterator
from html import escape

from capture.base.page import page_html, simulated_notice, table_html
from capture.maps import pictures
from capture.maps.pictures import tile_html
from capture.station.domain.limits import RANGES
from capture.station.domain.recipe import Recipe
from classify.base.durable_file import durable_file

from .taught_part import solved
from .taught_sets import KeptSet
from .teaching_result import Overlap, Teaching

# Sets of an overlap with pictures; the table of all sets names the others.
_MOST_PICTURES = 4


def write_teaching_page(teaching: Teaching) -> None:
    """Write the page into the folder of the version; InputError if it cannot be written."""
    with durable_file(teaching.files.report) as temporary:
        temporary.write_text(teaching_page(teaching), encoding="utf-8")


def teaching_page(teaching: Teaching) -> str:
    """Return the page as HTML; all text of sets and recipe is escaped."""
    recipe = teaching.recipe
    sections = {
        "To look at": _lines(teaching.remarks) or "<p>Nothing stands out.</p>",
        "What these parts show": _lines(teaching.promises()),
        "What is found on them": _lines(teaching.least_found()),
        "Textures that overlap": "".join(
            _overlap(overlap, teaching) for overlap in teaching.overlaps
        ),
        "Limits": _limits(recipe),
        "Textures": "".join(
            f"<h3>{escape(name)}</h3>{_pictures(_sets_of(teaching, name)[:1], teaching)}"
            for name in teaching.taught.textures
        ),
        "Sets": _sets(teaching),
    }
    return page_html(
        f"{recipe.name}, version {recipe.version}",
        "teaching",
        sections,
        facts=_facts(teaching),
        notices=[simulated_notice("part") * teaching.taught.setting.simulated],
        note="Distances are to a library that was taught all sets but this one.",
    )


def _facts(teaching: Teaching) -> Iterator[tuple[str, str]]:
    recipe, setting = teaching.recipe, teaching.taught.setting
    yield "pass", ", ".join(recipe.passes)
    yield "fail", ", ".join(recipe.fails) or "-"
    yield "sets", str(len(teaching.parts))
    yield "frame", f"{setting.width_px} x {setting.height_px} px of {setting.bit_depth} bit"
    yield "region", str(recipe.region or "whole frame")
    yield "calibration", "yes" if teaching.taught.has_calibration else "none"


def _lines(texts: Iterable[str]) -> str:
    items = "".join(f"<li>{escape(text)}</li>" for text in texts)
    return f"<ul>{items}</ul>" if items else ""


def _overlap(overlap: Overlap, teaching: Teaching) -> str:
    shown = [*overlap.sets[:_MOST_PICTURES], *_sets_of(teaching, overlap.other)[:1]]
    return f"<p>{escape(str(overlap))}</p>{_pictures(shown, teaching)}"


def _sets_of(teaching: Teaching, texture: str) -> list[KeptSet]:
    return [part.kept for part in teaching.parts if part.kept.texture == texture]


def _pictures(sets: Iterable[KeptSet], teaching: Teaching) -> str:
    tiles = []
    for kept in sets:
        surface = solved(kept, teaching.recipe.region)[1].surface
        relief = pictures.reduced(pictures.shaded(surface.normals))
        albedo = pictures.reduced(pictures.grey(surface.albedo))
        name = f"{kept.texture} {kept.path.name}"
        tiles += [tile_html(f"{name}: relief", relief), tile_html(f"{name}: albedo", albedo)]
    return f'<div class="tiles">{"".join(tiles)}</div>'


def _limits(recipe: Recipe) -> str:
    rows = []
    for name in recipe.passes:
        for key, value in recipe.limits_for(name).model_dump(exclude_none=True).items():
            text = (
                " to ".join(f"{bound:.4g}" for bound in value) if key in RANGES else f"{value:.4g}"
            )
            rows.append(f"<tr><td>{escape(name)}</td><td>{key}</td><td>{text}</td></tr>")
    return table_html(("texture", "limit", "value"), rows)


def _sets(teaching: Teaching) -> str:
    rows = []
    for part, match, inspection in zip(
        teaching.parts, teaching.matches, teaching.inspections, strict=True
    ):
        cells = (
            part.kept.path.name,
            part.kept.texture,
            "-" if match is None else match.label or "unknown",
            "-" if match is None else f"{match.distance:.2f}",
            f"{part.sdq:.3f}",
            f"{part.shadow_fraction:.1%}",
            inspection.verdict.decision,
            inspection.verdict.reason,
        )
        rows.append(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>")
    head = ("set", "texture", "found", "distance", "Sdq", "shadow", "verdict", "reason")
    return table_html(head, rows)
