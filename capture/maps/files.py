"""The maps of a solved set as files: float32 TIFF, PNG, JSON and a page."""

import json
from collections.abc import Collection
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from capture.base.outputs import is_input
from capture.calibration.lookup import FoundCalibration
from capture.sets.captured_set import CapturedSet
from classify import Lighting, SurfaceEstimate
from classify.base.durable_folder import durable_folder
from classify.base.errors import InputError
from classify.shadow_rule import NO_DROPPED_LIGHT
from classify.surface.estimate import FloatMap

from . import pictures
from .map_tiff import write_channels, write_values
from .page import map_page
from .roughness_table import roughness_note, roughness_parameters
from .surface_maps import RELIT_LIGHT, SurfaceMaps
from .views import map_views

# preview.png shows the first maps of each section of the page, in rows of four.
_PREVIEW_ROW = 4
_PREVIEW_TILES = 16
_PAGE = "index.html"
_INSIDE = np.uint8(255)  # of a mask


def write_maps(
    captured: CapturedSet,
    surface: SurfaceEstimate,
    folder: Path,
    *,
    light: Lighting = RELIT_LIGHT,
    mm_per_px: float | None = None,
    calibration: FoundCalibration | None = None,
    raw_residual: float | None = None,
    inputs: Collection[Path] = (),
) -> list[Path]:
    """Write all maps of a surface, and an `index.html` that shows them.

    Maps in `folder` are replaced as a whole, but none of `inputs` is; `raw_residual` is the
    `residual_share` without the calibration.
    """
    maps, lights = SurfaceMaps.of(surface, light, mm_per_px), len(captured.lighting)
    origin = {
        "method": surface.method,
        "planar": surface.planar,
        "mm_per_px": mm_per_px,
        "calibration": None if calibration is None else calibration.path.name,
        "calibration_sha256": None if calibration is None else calibration.file.hash,
        "simulated": captured.metadata.simulated,
        "label": captured.label,
        "pixels_sha256": captured.metadata.pixels_sha256,
        "software_version": version("ps4rig"),
    }
    tiffs, masks = _measured_maps(maps), _masks(surface, lights)
    views = map_views(captured, maps)
    tiles = [view for section in views.values() for view in section[:_PREVIEW_ROW]]
    preview = {view.title: view.picture for view in tiles[:_PREVIEW_TILES]}
    pngs = {
        "shadow": pictures.shadow_map(surface),
        "dropped": pictures.dropped_map(surface, lights),
        "specular": masks["specular"][0],
        "valid": masks["valid"][0],
        "preview": pictures.contact_sheet(preview),
    }
    roughness = {
        "valid_pixels": int(np.count_nonzero(surface.valid)),
        "note": roughness_note(mm_per_px),
        "parameters": roughness_parameters(maps.roughness, mm_per_px),
    }
    texts = {
        "roughness.json": json.dumps(origin | roughness, indent=2, allow_nan=False),
        _PAGE: map_page(captured, maps, views, calibration, raw_residual),
    }
    tiff_names = [f"{name}.tif" for name in (*tiffs, "normals", *masks)]
    names = [*tiff_names, *(f"{name}.png" for name in pngs), *texts]
    for path in (folder / name for name in names):
        if is_input(path, inputs):
            raise InputError(f"{path}: is an input of this command; choose another folder")
    with durable_folder(folder, names, first=_PAGE) as temporary:
        for name, (values, description) in tiffs.items():
            path = temporary / f"{name}.tif"
            write_values(path, maps.known(values), origin | description, mm_per_px)
        write_channels(
            temporary / "normals.tif",
            np.moveaxis(maps.known(maps.normals), 2, 0),
            ("x", "y", "z"),
            (-1.0, 1.0),
            origin | {"unit": "1"},
            mm_per_px,
        )
        for name, (levels, top) in masks.items():
            write_channels(temporary / f"{name}.tif", levels, (name,), (0, top), origin, mm_per_px)
        for name, picture in pngs.items():
            (temporary / f"{name}.png").write_bytes(pictures.png_bytes(picture))
        for name, text in texts.items():
            (temporary / name).write_text(text, encoding="utf-8")
    return [folder / name for name in names]


def _measured_maps(maps: SurfaceMaps) -> dict[str, tuple[FloatMap, dict[str, Any]]]:
    """The maps of one float32 value a pixel, each with its unit."""
    surface, unit, light = maps.surface, maps.length_unit, maps.light
    length = {"unit": unit, "relative": maps.mm_per_px is None}
    relit_by = {"tilt_deg": light.tilts_deg[0], "slant_deg": light.slants_deg[0]}
    return {
        "p": (surface.p, {"unit": "1"}),
        "q": (surface.q, {"unit": "1"}),
        "albedo": (surface.albedo, {"unit": "full scale"}),
        "height": (maps.height, length),
        "raised": (maps.raised, length),
        "mean_curvature": (maps.mean_curvature, {"unit": f"1/{unit}"}),
        "gaussian_curvature": (maps.gaussian_curvature, {"unit": f"1/{unit}^2"}),
        "relit": (maps.relit, {"unit": "full scale", "light": relit_by}),
        "residual": (surface.residual, {"unit": "full scale"}),
    }


def _masks(surface: SurfaceEstimate, lights: int) -> dict[str, tuple[npt.NDArray[np.uint8], int]]:
    """The maps of 8 bits, each with its largest value."""
    return {
        "shadow": (surface.shadow_count, lights),
        "dropped": (surface.dropped, NO_DROPPED_LIGHT),
        "specular": (surface.specular * _INSIDE, int(_INSIDE)),
        "valid": (surface.valid * _INSIDE, int(_INSIDE)),
    }
