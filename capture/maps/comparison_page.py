"""The page of a comparison: maps side by side, numbers, and differences."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from capture.base.page import number_text, rendered

from . import pictures
from .comparison import Comparison
from .map_kinds import MAP_KINDS
from .pictures import ColourScale
from .views import MapView, signed


def comparison_page(comparison: Comparison) -> str:
    """Return the page as HTML."""
    first, second = comparison.first, comparison.second
    return rendered(
        "maps/comparison.html",
        title=f"{first.path.name} and {second.path.name}",
        comparison=comparison,
        simulated_side=first.simulated or second.simulated,
        facts=_facts(comparison),
        views=_views(comparison),
        fields=[
            (field.field, _text(field.first), _text(field.second)) for field in comparison.fields
        ],
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


def _views(comparison: Comparison) -> Iterator[MapView | None]:
    """Yield three for each map: A, B, and their difference, or None if it has none."""
    for name in comparison.first.maps:
        sides = (("A", comparison.first), ("B", comparison.second))
        values_of_sides = [pictures.reduced(side.maps[name][0]) for _, side in sides]
        scale_of = ColourScale.signed if MAP_KINDS[name].show is signed else ColourScale.grey
        one_scale = scale_of(np.concatenate([values.ravel() for values in values_of_sides]))
        have_one_unit = len({side.maps[name][1] for _, side in sides}) == 1
        for (letter, side), values in zip(sides, values_of_sides, strict=True):
            scale = one_scale if have_one_unit else scale_of(values)
            unit, title = side.maps[name][1], f"{letter}: {name}"
            yield MapView(None, title, side.path.name, scale.paint(values), scale, unit)
        if name not in comparison.maps:
            yield None
            continue
        (first, unit), (second, _) = comparison.first.maps[name], comparison.second.maps[name]
        difference = pictures.reduced(second - first)
        scale = ColourScale.signed(difference)
        yield MapView(None, f"B - A: {name}", "", scale.paint(difference), scale, unit)


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
