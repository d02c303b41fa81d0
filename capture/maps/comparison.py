"""The comparison of two sides: textures, maps pixel by pixel, and fields."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from classify.base.errors import InputError
from classify.library.dissimilarity import TexturePair, compare_textures
from classify.texture.orientation import LEAST_SHARPNESS

from .compared_side import Side


@dataclass(frozen=True)
class FieldDifference:
    """A field and its value on either side; None where one does not have it."""

    field: str
    first: Any
    second: Any


def field_differences(
    first: Mapping[str, Any], second: Mapping[str, Any], name: str = ""
) -> Iterator[FieldDifference]:
    """Yield the fields that differ, as paths with dots; lists are compared as a whole."""
    for key in dict.fromkeys([*first, *second]):
        one, other = first.get(key), second.get(key)
        path = f"{name}.{key}" if name else key
        if isinstance(one, Mapping) and isinstance(other, Mapping):
            yield from field_differences(one, other, path)
        elif one != other:
            yield FieldDifference(path, one, other)


@dataclass(frozen=True)
class MapDifference:
    """The second map less the first, over the pixels that are valid in both."""

    unit: str  # of all figures but the correlation; empty for slopes
    mean: float
    rms: float
    p95: float  # 95th percentile of the magnitudes
    largest: float  # magnitude
    correlation: float  # of the two maps: near 1 for a part that lies as before; 0 if constant
    # rms of the differences over their standard deviations, near 1 for noise alone; if known
    rms_in_deviations: float | None = None


def map_difference(
    first: npt.NDArray[np.floating[Any]],
    second: npt.NDArray[np.floating[Any]],
    valid: npt.NDArray[np.bool_],
    unit: str,
    deviation: npt.NDArray[np.floating[Any]] | None = None,
) -> MapDifference | None:
    """Compare two (H, W) maps pixel by pixel; None if no pixel is valid or finite in both.

    `deviation` is the (H, W) standard deviation of the difference.
    """
    used = valid & np.isfinite(first) & np.isfinite(second)
    if not used.any():
        return None
    one, other = first[used].astype(np.float64), second[used].astype(np.float64)
    off = other - one
    magnitudes = np.abs(off)
    return MapDifference(
        unit=unit,
        mean=float(off.mean()),
        rms=float(np.sqrt(np.mean(off**2))),
        p95=float(np.percentile(magnitudes, 95)),
        largest=float(magnitudes.max()),
        correlation=_correlation(one, other),
        rms_in_deviations=None
        if deviation is None
        else float(np.sqrt(np.mean((off / deviation[used]) ** 2))),
    )


def normal_angles_deg(
    first: Sequence[npt.NDArray[np.floating[Any]]], second: Sequence[npt.NDArray[np.floating[Any]]]
) -> npt.NDArray[np.float64]:
    """(H, W) angle between the normals of two surfaces, each given by its slopes p and q."""
    (p1, q1), (p2, q2) = (
        [np.asarray(slope, np.float64) for slope in slopes] for slopes in (first, second)
    )
    # |n1 x n2| and n1 . n2 of (-p, -q, 1): exact also for small angles.
    cross = np.sqrt((p1 - p2) ** 2 + (q1 - q2) ** 2 + (p1 * q2 - p2 * q1) ** 2)
    angles: npt.NDArray[np.float64] = np.degrees(np.arctan2(cross, p1 * p2 + q1 * q2 + 1.0))
    return angles


def _correlation(one: npt.NDArray[np.float64], other: npt.NDArray[np.float64]) -> float:
    one, other = one - one.mean(), other - other.mean()
    energy = float(np.sqrt((one**2).sum() * (other**2).sum()))
    return float((one * other).sum() / energy) if energy > 0.0 else 0.0


# Slopes of a part that did not move correlate by 0.9 and more in noise; a shift of 3 px across the
# relief leaves less than 0.6 on the four textures of the thesis (tests/capture/comparison).
_ALIGNED = 0.7


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two sides and their differences."""

    first: Side
    second: Side
    texture: TexturePair | None  # None where a side is too small, or has no valid pixel
    angle_deg: float | None  # from the first texture to the second, anticlockwise, [-90, 90)
    maps: Mapping[str, MapDifference]  # those of equal size and unit
    normals_deg: tuple[float, float] | None  # median and 95th percentile of the angle between them
    fields: tuple[FieldDifference, ...]

    @property
    def is_aligned(self) -> bool:
        """Whether the slopes correlate, as for a part that was not moved."""
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
            deviation = None
            if name in first.deviations and name in second.deviations:
                deviation = np.hypot(first.deviations[name], second.deviations[name])
            difference = map_difference(values, others, valid, unit, deviation)
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
