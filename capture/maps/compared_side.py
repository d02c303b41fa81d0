"""One side of a comparison: the maps of a set or of a folder, and where they come from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from capture.base.names import SET_SUFFIX
from capture.sets.captured_set import CapturedSet, LoadedSet, named
from classify import SurfaceEstimate
from classify.base.errors import InputError

from .map_kinds import MAP_KINDS
from .map_tiff import read_description, read_map
from .surface_maps import SurfaceMaps
from .views import MapKind, unit_text

_Maps = dict[str, tuple[npt.NDArray[np.float32], str]]  # with the unit of each
# Fields of a setting that say which rig it is; the others are settings.
_OF_THE_RIG = ("rig_name", "camera", "light_directions", "led_levels_percent")


@dataclass(frozen=True, eq=False)
class Side:
    """One of two sets or folders."""

    path: Path
    surface: SurfaceEstimate
    texture: SurfaceEstimate  # solved as for a texture; for a folder, `surface` itself
    maps: _Maps  # (H, W), NaN where not valid
    deviations: Mapping[str, npt.NDArray[np.float32]]  # standard deviations of maps that have one
    facts: Mapping[str, Mapping[str, Any]]  # values by field, by group
    simulated: bool
    orientation_deg: float | None


def side_of(path: Path, calibration: Path | None = None, *, raw: bool = False) -> Side:
    """Read and solve a set as `LoadedSet.of`, or read a folder of maps of ``ps4rig solve``."""
    if path.is_dir():
        return _folder(path)
    if not path.name.endswith(SET_SUFFIX):
        raise InputError(f"{path}: give a captured set ({SET_SUFFIX}) or a folder of maps")
    loaded = LoadedSet.of(path, calibration, raw=raw)
    with named(path):
        return _set(path, loaded)


def _set(path: Path, loaded: LoadedSet) -> Side:
    captured = loaded.captured
    surface = loaded.solve(uncertainty=True)
    solved = SurfaceMaps(surface, mm_per_px=loaded.mm_per_px)
    maps: _Maps = {}
    for name, kind in _compared().items():
        described = kind.description(solved)
        maps[name] = (
            solved.values(kind),
            unit_text(described["unit"], relative=described.get("relative", False)),
        )
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
    return Side(
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
    rig = {name: setting.pop(name) for name in _OF_THE_RIG}
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


def _folder(folder: Path) -> Side:
    if not (folder / "p.tif").is_file():
        raise InputError(f"{folder}: holds no maps; ps4rig solve SET --out {folder} writes them")
    description = read_description(folder / "p.tif")
    maps: _Maps = {}
    valid = read_map(folder / "valid.tif")[0] > 0
    for name in _compared():
        path = folder / f"{name}.tif"
        values, described = read_map(path)
        if values.shape != valid.shape or valid.ndim != 2:
            raise InputError(
                f"{folder / 'valid.tif'}: has shape {valid.shape}, but {name}.tif "
                f"{values.shape}; solve again"
            )
        if not np.isfinite(values[valid]).all():
            raise InputError(f"{path}: not finite where valid.tif is not 0; solve again")
        unit = unit_text(str(described.get("unit", "")), relative=bool(described.get("relative")))
        nan = np.float32(np.nan)
        maps[name] = np.where(valid, values, nan).astype(np.float32, copy=False), unit
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
    columns, rows = surface.shape[1], surface.shape[0]
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
    return Side(folder, surface, surface, maps, deviations, facts, simulated, None)


def _compared() -> dict[str, MapKind]:
    return {name: kind for name, kind in MAP_KINDS.items() if kind.is_compared}
