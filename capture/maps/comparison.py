"""Compare two sets or folders of maps: textures, maps pixel by pixel, fields; and their page."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from capture.base.names import SET_SUFFIX
from capture.base.page import number_text, rendered
from capture.sets.captured_set import CapturedSet, LoadedSet, naming_file
from classify import InputError, SurfaceEstimate
from classify.base.arrays import BoolArray, FloatMap, Floats
from classify.library.dissimilarity import TexturePair, compare_textures
from classify.lighting import angles_between_deg, orientation_near
from classify.texture.orientation import MIN_SHARPNESS

from . import pictures
from .map_kinds import MAP_KINDS
from .map_tiff import read_description, read_map
from .pictures import ColourScale
from .views import MapKind, MapView, SurfaceMaps, signed, unit_text

_Maps = dict[str, tuple[FloatMap, str]]  # with the unit of each
# Fields of a setting that identify the rig; the others are settings.
_RIG_FIELDS = ("rig_name", "camera", "light_directions", "led_levels_percent")


@dataclass(frozen=True, eq=False)
class _Side:
    """One of two sets or folders."""

    path: Path
    surface: SurfaceEstimate
    texture: SurfaceEstimate  # solved as for a texture; for a folder, `surface` itself
    maps: _Maps  # (H, W), NaN where not valid
    deviations: Mapping[str, FloatMap]  # standard deviations of maps that have one
    facts: Mapping[str, Mapping[str, Any]]  # values by field, by group
    simulated: bool
    orientation_deg: float | None


def side_of(path: Path, calibration: Path | None = None, *, raw: bool = False) -> _Side:
    """Read a folder of maps of ``ps4rig solve``, or read and solve a set; see `LoadedSet.of`."""
    if path.is_dir():
        return _side_of_folder(path)
    if not path.name.endswith(SET_SUFFIX):
        raise InputError(f"{path}: give a captured set ({SET_SUFFIX}) or a folder of maps")
    loaded = LoadedSet.of(path, calibration, raw=raw)
    with naming_file(path):
        return _side_of_set(path, loaded)


def _side_of_set(path: Path, loaded: LoadedSet) -> _Side:
    captured = loaded.captured
    surface = loaded.solve(uncertainty=True)
    solved = SurfaceMaps(surface, mm_per_px=loaded.mm_per_px)
    maps: _Maps = {}
    for name, kind in _compared_kinds().items():
        description = kind.description(solved)
        unit = unit_text(description["unit"], relative=description.get("relative", False))
        maps[name] = solved.values(kind), unit
    deviations = {
        name: solved.values(MAP_KINDS[f"{name}_sd"]) for name in maps if f"{name}_sd" in MAP_KINDS
    }
    facts = _facts_of_set(captured)
    if loaded.found_calibration is not None:
        records = loaded.found_calibration.file.records
        facts["calibration"] |= {
            name: {"date": str(record.date), "quality": record.quality}
            for name, record in records.items()
        }
    texture = loaded.solve_texture(None, planar=True)
    metadata = captured.metadata
    return _Side(
        path,
        surface,
        texture,
        maps,
        deviations,
        facts,
        metadata.simulated,
        metadata.orientation_deg,
    )


def _facts_of_set(captured: CapturedSet) -> dict[str, dict[str, Any]]:
    metadata = captured.metadata
    setting = captured.setting.model_dump(mode="json")
    rig = {name: setting.pop(name) for name in _RIG_FIELDS}
    rig["led_intensities"] = np.round(captured.lighting.intensities, 4).tolist()
    if metadata.controller is not None:
        rig["controller"] = asdict(metadata.controller)
    frames = max((len(image.frames) for image in metadata.images), default=0)
    settings = setting | {
        "frames_averaged": frames,
        "settle_ms": metadata.settle_ms,
        "synchronisation": metadata.synchronisation,
    }
    if metadata.camera is not None:
        settings |= {
            "frame_rate_hz": metadata.camera.frame_rate_hz,
            "controls": dict(metadata.camera.controls),
        }
    fields = ("label", "specimen", "operator", "note", "orientation_deg", "created_utc")
    placement = None if metadata.placement is None else metadata.placement.model_dump(mode="json")
    return {
        "set": {name: getattr(metadata, name) for name in fields} | {"placement": placement},
        "rig": rig,
        "settings": settings,
        "calibration": {"sha256": list(metadata.calibration_ids)},
        "software": {"version": metadata.software_version, "schema": metadata.schema_version},
    }


def _side_of_folder(folder: Path) -> _Side:
    if not (folder / "p.tif").is_file():
        raise InputError(f"{folder}: holds no maps; ps4rig solve SET --out {folder} writes them")
    description = read_description(folder / "p.tif")
    maps: _Maps = {}
    valid = read_map(folder / "valid.tif")[0] > 0
    for name in _compared_kinds():
        path = folder / f"{name}.tif"
        values, map_description = read_map(path)
        if values.shape != valid.shape or valid.ndim != 2:
            raise InputError(
                f"{folder / 'valid.tif'}: has shape {valid.shape}, but {name}.tif "
                f"{values.shape}; solve again"
            )
        if not np.isfinite(values[valid]).all():
            raise InputError(f"{path}: not finite where valid.tif is not 0; solve again")
        unit = unit_text(
            str(map_description.get("unit", "")), relative=bool(map_description.get("relative"))
        )
        valid_values = np.where(valid, values, np.float32(np.nan))
        maps[name] = valid_values.astype(np.float32, copy=False), unit
    p, q, albedo = (
        np.where(valid, maps[name][0], np.float32(0.0)) for name in ("p", "q", "albedo")
    )
    surface = SurfaceEstimate(
        p=p, q=q, albedo=albedo, valid=valid,
        method=str(description.get("method", "")), planar=bool(description.get("planar")),
    )  # fmt: skip
    deviations = {
        name: read_map(path)[0] for name in maps if (path := folder / f"{name}_sd.tif").is_file()
    }
    rows, columns = surface.shape
    facts = {
        "set": {name: description.get(name) for name in ("label", "pixels_sha256")},
        "rig": {},
        "settings": {
            "width_px": columns, "height_px": rows, "mm_per_px": description.get("mm_per_px"),
            "method": description.get("method"), "planar": description.get("planar"),
        },
        "calibration": {
            "file": description.get("calibration"), "sha256": description.get("calibration_sha256"),
        },
        "software": {"version": description.get("software_version")},
    }  # fmt: skip
    simulated = bool(description.get("simulated"))
    return _Side(folder, surface, surface, maps, deviations, facts, simulated, None)


def _compared_kinds() -> dict[str, MapKind]:
    return {name: kind for name, kind in MAP_KINDS.items() if kind.is_compared}


def field_differences(
    first: Mapping[str, Any], second: Mapping[str, Any], name: str = ""
) -> Iterator[tuple[str, Any, Any]]:
    """Yield the path with dots and both values of each field that differs.

    A value is None on a side without the field. Lists are compared as a whole.
    """
    for key in dict.fromkeys([*first, *second]):
        one, other = first.get(key), second.get(key)
        path = f"{name}.{key}" if name else key
        if isinstance(one, Mapping) and isinstance(other, Mapping):
            yield from field_differences(one, other, path)
        elif one != other:
            yield path, one, other


@dataclass(frozen=True)
class _MapDifference:
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
    valid: BoolArray,
    unit: str,
    deviation: npt.NDArray[np.floating[Any]] | None = None,
) -> _MapDifference | None:
    """Compare two (H, W) maps; None if no pixel is finite in both.

    `deviation` is the standard deviation of their difference, if it is known.
    """
    used = valid & np.isfinite(first) & np.isfinite(second)
    if not used.any():
        return None
    one, other = first[used].astype(np.float64), second[used].astype(np.float64)
    differences = other - one
    magnitudes = np.abs(differences)
    return _MapDifference(
        unit=unit,
        mean=float(differences.mean()),
        rms=float(np.sqrt(np.mean(differences**2))),
        p95=float(np.percentile(magnitudes, 95)),
        largest=float(magnitudes.max()),
        correlation=_correlation(one, other),
        rms_in_deviations=None
        if deviation is None
        else float(np.sqrt(np.mean((differences / deviation[used]) ** 2))),
    )


def _correlation(one: Floats, other: Floats) -> float:
    one, other = one - one.mean(), other - other.mean()
    energy = float(np.sqrt((one**2).sum() * (other**2).sum()))
    return float((one * other).sum() / energy) if energy > 0.0 else 0.0


# Slopes of a part that did not move correlate by 0.9 and more, in spite of noise. After a shift of
# 3 px the four textures of the thesis correlate by less than 0.6 (test_comparison.py).
_MIN_CORRELATION = 0.7


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two sides and their differences."""

    first: _Side
    second: _Side
    texture: TexturePair | None  # None where a side is too small, or has no valid pixel
    angle_deg: float | None  # from the first texture to the second, anticlockwise, [-90, 90)
    maps: Mapping[str, _MapDifference]  # those of equal size and unit
    normals_deg: tuple[float, float] | None  # median and 95th percentile of the angle between them
    fields: tuple[tuple[str, Any, Any], ...]  # those that differ: path and both values

    @property
    def angle_text(self) -> str | None:
        """The angle with one decimal: 89.97 rounds to -90.0, and -0.04 to 0.0."""
        if self.angle_deg is None:
            return None
        return f"{orientation_near(round(self.angle_deg, 1), 0.0):.1f}"

    @property
    def is_aligned(self) -> bool:
        """Whether the slopes correlate, as for a part that was not moved."""
        slopes = [self.maps[name].correlation for name in ("p", "q") if name in self.maps]
        return bool(slopes) and min(slopes) >= _MIN_CORRELATION

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
                {"field": field, "a": first, "b": second} for field, first, second in self.fields
            ],
        }


def compare(first: _Side, second: _Side) -> Comparison:
    """Compare textures, and maps and fields where both sides have them."""
    try:
        texture = compare_textures(first.texture, second.texture)
    except InputError:
        texture = None
    is_clear = texture is not None and texture.sharpness >= MIN_SHARPNESS
    maps, normals_deg = {}, None
    if first.surface.shape == second.surface.shape:
        valid = first.surface.valid & second.surface.valid
        for name, (values, unit) in first.maps.items():
            others, other_unit = second.maps[name]
            if unit != other_unit:
                continue
            deviation = None
            if name in first.deviations and name in second.deviations:
                deviation = np.hypot(first.deviations[name], second.deviations[name])
            difference = map_difference(values, others, valid, unit, deviation)
            if difference is not None:
                maps[name] = difference
        if valid.any():
            normals = (side.surface.normals[valid] for side in (first, second))
            median, p95 = np.percentile(angles_between_deg(*normals), (50, 95))
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
            (field, _value_text(one), _value_text(other)) for field, one, other in comparison.fields
        ],
    )


def _facts(comparison: Comparison) -> Iterator[tuple[str, str]]:
    yield "A", str(comparison.first.path)
    yield "B", str(comparison.second.path)
    if comparison.texture is None:
        yield "texture", "not compared: a side is too small, or has no valid pixel"
        return
    yield "texture distance", number_text(comparison.texture.distance)
    angle = comparison.angle_text
    yield "angle", "the textures show none" if angle is None else f"{angle}°"
    yield "focus of B", f"{number_text(-comparison.texture.blur_px)} px"
    if comparison.normals_deg is not None and comparison.is_aligned:
        yield "normals, median", f"{number_text(comparison.normals_deg[0])}°"


def _views(comparison: Comparison) -> Iterator[MapView | None]:
    """Yield three views of each map: A, B, and their difference; None for no difference."""
    for name in comparison.first.maps:
        sides = (("A", comparison.first), ("B", comparison.second))
        reduced = [pictures.reduced(side.maps[name][0]) for _, side in sides]
        scale_of = ColourScale.signed if MAP_KINDS[name].show is signed else ColourScale.grey
        shared_scale = scale_of(np.concatenate([values.ravel() for values in reduced]))
        have_one_unit = len({side.maps[name][1] for _, side in sides}) == 1
        for (letter, side), values in zip(sides, reduced, strict=True):
            scale = shared_scale if have_one_unit else scale_of(values)
            unit, title = side.maps[name][1], f"{letter}: {name}"
            yield MapView(None, title, side.path.name, scale.paint(values), scale, unit)
        if name not in comparison.maps:
            yield None
            continue
        (first, unit), (second, _) = comparison.first.maps[name], comparison.second.maps[name]
        difference = pictures.reduced(second - first)
        scale = ColourScale.signed(difference)
        yield MapView(None, f"B - A: {name}", "", scale.paint(difference), scale, unit)


def _value_text(value: Any) -> str:
    if value is None:
        return "-"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
