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


def comparison_page(comparison: Comparison) -> str:
    """Return the page as HTML; all text from files is escaped."""
    first, second = comparison.first, comparison.second
    return page_html(
        f"{first.path.name} and {second.path.name}",
        "comparison",
        {
            "What differs": _fields(comparison),
            "Maps": f'<div class="maps">{"".join(_maps(comparison))}</div>',
            "Pixel by pixel, B less A": _differences(comparison),
        },
        facts=_facts(comparison),
        notices=(
            simulated_notice("part of a simulated side") * (first.simulated or second.simulated),
            notice("The part was moved, or another one: pixels do not belong together.")
            * (bool(comparison.maps) and not comparison.is_aligned),
        ),
        note=_NOTE,
        style=_STYLE,
    )


def _facts(comparison: Comparison) -> Iterator[tuple[str, str]]:
    yield "A", str(comparison.first.path)
    yield "B", str(comparison.second.path)
    if comparison.texture is None:
        yield "texture", "not compared: a side is too small, or has no valid pixel"
        return
    yield "texture distance", number_text(comparison.texture.distance)
    angle = comparison.angle_deg
    yield "angle", "the textures show none" if angle is None else f"{angle:.1f}°"
    yield "focus of B", f"{number_text(-comparison.texture.blur_px)} px"
    if comparison.normals_deg is not None and comparison.is_aligned:
        yield "normals, median", f"{number_text(comparison.normals_deg[0])}°"


def _maps(comparison: Comparison) -> Iterator[str]:
    """Yield figures in rows of three: A, B, and their difference or an empty place."""
    for name in comparison.first.maps:
        sides = (("A", comparison.first), ("B", comparison.second))
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
        if name in comparison.maps:
            (one, unit), (other, _) = comparison.first.maps[name], comparison.second.maps[name]
            off = pictures.reduced(other - one)
            scale = ColourScale.signed(off)
            yield figure_html(MapView(None, f"B - A: {name}", "", scale.paint(off), scale, unit))
        else:
            yield "<p>Not comparable: another size or unit, or no pixel is valid in both.</p>"


def _differences(comparison: Comparison) -> str:
    if not comparison.maps:
        return "<p>The sides have unlike sizes, or no pixel is valid in both.</p>"
    rows = [
        _row(
            name,
            difference.unit,
            number_text(difference.mean),
            number_text(difference.rms),
            number_text(difference.p95),
            number_text(difference.largest),
            number_text(difference.correlation),
        )
        for name, difference in comparison.maps.items()
    ]
    if comparison.normals_deg is not None:
        median, p95 = map(number_text, comparison.normals_deg)
        rows.append(_row("normals", "degrees", f"median {median}", "", p95, "", ""))
    columns = ("map", "unit", "mean", "rms", "95 %", "largest", "correlation")
    return table_html(columns, rows)


def _fields(comparison: Comparison) -> str:
    if not comparison.fields:
        return "<p>Nothing.</p>"
    rows = [
        _row(difference.field, _text(difference.first), _text(difference.second))
        for difference in comparison.fields
    ]
    return table_html(("field", "A", "B"), rows)


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _row(*cells: str) -> str:
    return f"<tr>{''.join(f'<td>{escape(each)}</td>' for each in cells)}</tr>"
