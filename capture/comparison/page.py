"""The page of a comparison: maps side by side, numbers, and what differs."""

from __future__ import annotations

import json
from collections.abc import Iterator
from html import escape
from typing import Any

import numpy as np

from capture.maps import pictures
from capture.maps.figures import figure_html, number_text
from capture.maps.pictures import ColourScale
from capture.maps.views import MapView
from capture.page.skeleton import notice, page_html, simulated_notice, table_html

from .comparison import Comparison

_SIGNED = ("p", "q", "height")
_NOTE = (
    "A distance of 1 is typical of two quarters of one frame. Angles are anticlockwise from A to "
    "B. Pixels that are not valid in both are left out of all figures."
)
_STYLE = ".maps { grid-template-columns: repeat(3, minmax(0, 1fr)); }"


def comparison_page(found: Comparison) -> str:
    """Return the page as HTML; all text from files is escaped."""
    first, second = found.first, found.second
    return page_html(
        f"{first.path.name} and {second.path.name}",
        "comparison",
        {
            "What differs": _fields(found),
            "Maps": f'<div class="maps">{"".join(_maps(found))}</div>',
            "Pixel by pixel, B less A": _differences(found),
        },
        facts=_facts(found),
        notices=(
            simulated_notice("part of a simulated side") * (first.simulated or second.simulated),
            notice("The part was moved, or another one: pixels do not belong together.")
            * (bool(found.maps) and not found.is_aligned),
        ),
        note=_NOTE,
        style=_STYLE,
    )


def _facts(found: Comparison) -> Iterator[tuple[str, str]]:
    yield "A", str(found.first.path)
    yield "B", str(found.second.path)
    if found.texture is None:
        yield "texture", "not compared: a side is too small, or has no valid pixel"
        return
    yield "texture distance", number_text(found.texture.distance)
    angle = found.angle_deg
    yield "angle", "the textures show none" if angle is None else f"{angle:.1f}°"
    yield "focus of B", f"{number_text(-found.texture.blur_px)} px"
    if found.normals_deg is not None and found.is_aligned:
        yield "normals, median", f"{number_text(found.normals_deg[0])}°"


def _maps(found: Comparison) -> Iterator[str]:
    """Yield figures in rows of three: A, B, and their difference or an empty place."""
    for name in found.first.maps:
        sides = (("A", found.first), ("B", found.second))
        shown = [pictures.reduced(side.maps[name][0]) for _, side in sides]
        scale_of = ColourScale.signed if name in _SIGNED else ColourScale.grey
        one_scale = scale_of(np.concatenate([each.ravel() for each in shown]))
        have_one_unit = len({side.maps[name][1] for _, side in sides}) == 1
        for (letter, side), values in zip(sides, shown, strict=True):
            scale = one_scale if have_one_unit else scale_of(values)
            unit = side.maps[name][1]
            title = f"{letter}: {name}"
            yield figure_html(
                MapView(None, title, side.path.name, scale.paint(values), scale, unit)
            )
        if name in found.maps:
            (one, unit), (other, _) = found.first.maps[name], found.second.maps[name]
            off = pictures.reduced(other - one)
            scale = ColourScale.signed(off)
            yield figure_html(MapView(None, f"B - A: {name}", "", scale.paint(off), scale, unit))
        else:
            yield "<p>Not comparable: another size or unit, or no pixel is valid in both.</p>"


def _differences(found: Comparison) -> str:
    if not found.maps:
        return "<p>The sides have unlike sizes, or no pixel is valid in both.</p>"
    rows = [
        _row(
            name,
            each.unit,
            *(number_text(v) for v in (each.mean, each.rms, each.p95, each.largest)),
            number_text(each.correlation),
        )
        for name, each in found.maps.items()
    ]
    if found.normals_deg is not None:
        median, p95 = (number_text(each) for each in found.normals_deg)
        rows.append(_row("normals", "degrees", f"median {median}", "", p95, "", ""))
    columns = ("map", "unit", "mean", "rms", "95 %", "largest", "correlation")
    return table_html(columns, rows)


def _fields(found: Comparison) -> str:
    if not found.fields:
        return "<p>Nothing.</p>"
    rows = [_row(each.field, _text(each.first), _text(each.second)) for each in found.fields]
    return table_html(("field", "A", "B"), rows)


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _row(*cells: str) -> str:
    return f"<tr>{''.join(f'<td>{escape(each)}</td>' for each in cells)}</tr>"
