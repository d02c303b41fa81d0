"""The comparison of two sides: textures, maps pixel by pixel, and fields."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from capture.maps.differences import FieldDifference, field_differences
from classify.base.errors import InputError
from classify.library.dissimilarity import TexturePair, compare_textures
from classify.texture.orientation import LEAST_SHARPNESS

from .compared_side import Side
from .differences import MapDifference, map_difference, normal_angles_deg

# Slopes of a part that did not move correlate by 0.9 and more in noise; a shift of 3 px across the
# relief leaves less than 0.6 on the four textures of the thesis (tests/capture/comparison).
_ALIGNED = 0.7


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two sides and what differs."""

    first: Side
    second: Side
    texture: TexturePair | None  # None where a side is too small, or has no valid pixel
    angle_deg: float | None  # from the first texture to the second, anticlockwise, [-90, 90)
    maps: Mapping[str, MapDifference]  # those of equal size and unit
    normals_deg: tuple[float, float] | None  # median and 95th percentile of the angle between them
    fields: tuple[FieldDifference, ...]

    @property
    def is_aligned(self) -> bool:
        """Whether the slopes correlate, as those of a part that was not moved."""
        slopes = [self.maps[name].correlation for name in ("p", "q") if name in self.maps]
        return bool(slopes) and min(slopes) >= _ALIGNED

    def as_json(self) -> dict[str, Any]:
        return {
            "a": str(self.first.path),
            "b": str(self.second.path),
            "distance": None if self.texture is None else self.texture.distance,
            "angle_deg": self.angle_deg,
            "sharpness": None if self.texture is None else self.texture.sharpness,
            "blur_px": None if self.texture is None else self.texture.blur_px,
            "aligned": self.is_aligned,
            "normals_median_deg": None if self.normals_deg is None else self.normals_deg[0],
            "normals_p95_deg": None if self.normals_deg is None else self.normals_deg[1],
            "maps": {name: asdict(difference) for name, difference in self.maps.items()},
            "differences": [
                {"field": field.field, "a": field.first, "b": field.second} for field in self.fields
            ],
        }


def compare(first: Side, second: Side) -> Comparison:
    try:
        texture = compare_textures(first.texture, second.texture)
    except InputError:
        texture = None
    is_clear = texture is not None and texture.sharpness >= LEAST_SHARPNESS
    maps, normals_deg = {}, None
    if first.surface.shape == second.surface.shape:
        valid = first.surface.valid & second.surface.valid
        for name, (values, unit) in first.maps.items():
            others, other_unit = second.maps[name]
            difference = map_difference(values, others, valid, unit)
            if unit == other_unit and difference is not None:
                maps[name] = difference
        if valid.any():
            angles = normal_angles_deg(
                (first.surface.p, first.surface.q), (second.surface.p, second.surface.q)
            )
            median, p95 = np.percentile(angles[valid], (50, 95))
            normals_deg = float(median), float(p95)
    return Comparison(
        first,
        second,
        texture,
        texture.angle_deg if texture is not None and is_clear else None,
        maps,
        normals_deg,
        tuple(field_differences(first.facts, second.facts)),
    )
