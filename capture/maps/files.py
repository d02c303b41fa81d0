"""The maps of a solved set as files: float32 TIFF, PNG, JSON and one self-contained HTML page."""

import json
from collections.abc import Collection, Iterator
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from capture.base.outputs import is_input
from capture.base.page import rendered
from capture.calibration.lookup import FoundCalibration
from capture.maps import pictures
from capture.sets.captured_set import CapturedSet
from classify import InputError, Lighting, SurfaceEstimate
from classify.base.arrays import Floats
from classify.base.durable_file import durable_folder
from classify.lights.flat_field import FlatField
from classify.relief.roughness import common_error

from .map_kinds import kinds_of, map_views
from .map_tiff import write_channels, write_values
from .pictures import Picture
from .views import RELIT_LIGHT, MapKind, MapView, SurfaceMaps, mask_picture

_UM_PER_MM = 1e3


def _roughness_note(maps: SurfaceMaps) -> str:
    """Return the meaning of the parameters, with or without a scale."""
    scale = "ISO 25178-2 over the valid pixels, at the scale of a pixel"
    noise = "noise raises all of them"
    if maps.roughness_uncertainty is not None:
        noise = (
            "noise is subtracted from Sdq and Sq; expanded uncertainties with k = 2, without "
            "errors of the calibration"
        )
    if maps.mm_per_px is None:
        return (
            f"{scale}; {noise}. Sa and Sq come from relative height without its mean plane and are "
            "not lengths: compare them only between images of one size and magnification."
        )
    return (
        f"{scale}, {maps.mm_per_px:.3g} mm; {noise}. Sa and Sq come from height without its mean "
        "plane. Errors of slopes add up over the frame: compare them only between images of one "
        "size."
    )


def _uncertainty(maps: SurfaceMaps, calibration: FoundCalibration | None) -> dict[str, Any] | None:
    """Return the uncertainty of normals and heights, and that from errors of the calibration."""
    uncertainty = maps.roughness_uncertainty
    if uncertainty is None:
        return None
    surface, length = maps.surface, float(maps.length_per_px)
    assert surface.angle_sd is not None  # it comes with the deviations of the slopes
    parts = None if calibration is None else calibration.file.calibration
    errors_of_calibration = None
    if parts is not None and parts.lights is not None and surface.lighting is not None:
        response_error = 0.0 if parts.response is None else parts.response.error
        errors_of_calibration = asdict(common_error(surface, parts.lights, response_error))
    return {
        "median_angle_sd_deg": float(np.median(surface.angle_sd[surface.valid])),
        "height_difference_sd": [
            {"distance": length * px, "sd": length * sd, "unit": maps.length_unit}
            for px, sd in uncertainty.height_sd_px.items()
        ],
        "calibration": errors_of_calibration,
    }


def _roughness_parameters(maps: SurfaceMaps) -> dict[str, dict[str, Any]]:
    """Return name, value, unit and whether it is relative, for each symbol.

    A value is None without valid pixels. Sa and Sq are in um, or in relative px. Noise is
    subtracted if deviations are known.
    """
    uncertainty, mm_per_px = maps.roughness_uncertainty, maps.mm_per_px
    roughness = maps.roughness if uncertainty is None else uncertainty.corrected
    is_relative = mm_per_px is None
    length, per_px = ("px", 1.0) if mm_per_px is None else ("um", _UM_PER_MM * mm_per_px)
    parameters: dict[str, dict[str, Any]] = {}
    for symbol, name, field, unit, factor, relative in (
        ("Sdq", "root mean square gradient", "sdq", "1", 1.0, False),
        ("Sdr", "developed interfacial area ratio", "sdr_percent", "%", 1.0, False),
        ("Sa", "arithmetical mean height", "sa_px", length, per_px, is_relative),
        ("Sq", "root mean square height", "sq_px", length, per_px, is_relative),
    ):
        value = None if roughness is None else factor * getattr(roughness, field)
        parameters[symbol] = {"name": name, "value": value, "unit": unit, "relative": relative}
        if uncertainty is not None:
            expanded = factor * getattr(uncertainty.expanded, field)
            parameters[symbol]["expanded_uncertainty"] = expanded
    return parameters


# Units on the page that differ from those in files.
_UNITS = {"1": "", "um": " \N{MICRO SIGN}m"}


def map_page(
    captured: CapturedSet,
    maps: SurfaceMaps,
    views: dict[str, list[MapView]],
    calibration: FoundCalibration | None = None,
    raw_residual: float | None = None,
) -> str:
    """Return the page as HTML; `raw_residual` is the residual without the calibration."""
    metadata = captured.metadata
    return rendered(
        "maps/page.html",
        title=metadata.label or "Captured set without a label",
        metadata=metadata,
        facts=(*_facts(captured, maps), *_calibration(maps.surface, calibration, raw_residual)),
        views=views,
        roughness=_roughness_parameters(maps),
        roughness_note=_roughness_note(maps),
        units=_UNITS,
    )


def _facts(captured: CapturedSet, maps: SurfaceMaps) -> Iterator[tuple[str, str]]:
    surface, metadata = maps.surface, captured.metadata
    lighting = surface.lighting or captured.lighting
    rows, columns = surface.shape
    yield "solver", surface.method
    if surface.planar:
        yield "planar part", _fall_off_text(surface.fall_off)
    yield "image", f"{columns} x {rows} px, {metadata.bit_depth} bit"
    if maps.mm_per_px is not None:
        yield "scale", f"{maps.mm_per_px:.4g} mm/px"
    if surface.angle_sd is not None:
        yield "noise", _noise_source(surface)
    yield "lights", f"{len(lighting)}, slant {_span(lighting.slants_deg)}°"
    if lighting.positions_px is not None:
        distances_px = np.linalg.norm(lighting.positions_px, axis=1)
        yield "distance of the lights", f"{_span(distances_px)} px"
    if surface.divided_by is not None and not surface.planar:
        yield "LED levels", "in the flat field of the calibration"
    elif captured.lighting.intensities_given:
        yield "LED levels", f"{_levels(captured.lighting.intensities)}, as given"
    elif surface.led_levels is not None:
        yield "LED levels", f"{_levels(surface.led_levels)}, found in the images"
    yield from metadata.facts
    if metadata.orientation_deg is not None:
        yield "orientation", f"{metadata.orientation_deg:g}°"
    if captured.mask is not None:
        yield "mask", f"{metadata.mask_file}, {captured.mask.mean():.1%} of the image"
    if metadata.crop is not None:
        yield "crop", f"from column {metadata.crop[0]}, row {metadata.crop[1]}"
    yield "valid", f"{surface.valid.mean():.1%}"
    yield "saturated", f"{surface.saturated.mean():.1%}"
    yield "in shadow of a light", f"{surface.shadow_mask.mean():.1%}"
    yield "SHA-256 of pixels", f"{metadata.pixels_sha256[:12]}…"


def _noise_source(surface: SurfaceEstimate) -> str:
    return "of the sensor" if surface.noise_given else "estimated from the images"


def _calibration(
    surface: SurfaceEstimate, calibration: FoundCalibration | None, raw_residual: float | None
) -> Iterator[tuple[str, str]]:
    yield "calibration", "none" if calibration is None else calibration.path.name
    if calibration is not None:
        yield "SHA-256 of calibration", f"{calibration.file.hash[:12]}…"
    residual = surface.residual_share
    if residual is not None:
        without = "" if raw_residual is None else f", {raw_residual:.2%} without calibration"
        yield "median residual", f"{residual:.2%} of the signal{without}"


def _fall_off_text(fall_off: FlatField | None) -> str:
    if fall_off is None:
        return "too little of it is lit: no fall-off divided out"
    return f"fall-off of {fall_off.largest_fall_off:.0%} divided out, with any tilt or bow"


def _levels(levels: Floats) -> str:
    return ", ".join(f"{level:.3f}" for level in levels)


def _span(values: Floats) -> str:
    low, high = f"{values.min():.1f}", f"{values.max():.1f}"
    return low if low == high else f"{low} to {high}"


# preview.png shows the first maps of each section of the page, in rows of four.
_PREVIEW_ROW = 4
_PREVIEW_TILES = 16
_PAGE, _PREVIEW = "index.html", "preview.png"


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
    """Write all maps and their `index.html`; they replace maps in `folder`, but none of `inputs`.

    `raw_residual` is the residual without the calibration.
    """
    maps = SurfaceMaps(surface, light, mm_per_px)
    origin = {
        "method": surface.method,
        "planar": surface.planar,
        "noise": _noise_source(surface),
        "mm_per_px": mm_per_px,
        "calibration": None if calibration is None else calibration.path.name,
        "calibration_sha256": None if calibration is None else calibration.file.hash,
        "simulated": captured.metadata.simulated,
        "label": captured.label,
        "pixels_sha256": captured.metadata.pixels_sha256,
        "software_version": version("ps4rig"),
    }
    views = map_views(captured, maps)
    roughness = {
        "valid_pixels": int(np.count_nonzero(surface.valid)),
        "note": _roughness_note(maps),
        "parameters": _roughness_parameters(maps),
        "uncertainty": _uncertainty(maps, calibration),
    }
    texts = {
        "roughness.json": json.dumps(origin | roughness, indent=2, allow_nan=False),
        _PAGE: map_page(captured, maps, views, calibration, raw_residual),
    }
    tiffs = [kind for kind in kinds_of(surface) if kind.is_written]
    masks = [kind for kind in tiffs if kind.is_mask]
    names = [f"{kind.name}.tif" for kind in tiffs] + [f"{kind.name}.png" for kind in masks]
    names += [_PREVIEW, *texts]
    for path in (folder / name for name in names):
        if is_input(path, inputs):
            raise InputError(f"{path}: is an input of this command; choose another folder")
    with durable_folder(folder, names, marker=_PAGE) as temporary:
        for kind in tiffs:
            _write_map(temporary / f"{kind.name}.tif", kind, maps, origin)
        for kind in masks:
            png = pictures.png_bytes(mask_picture(kind, maps))
            (temporary / f"{kind.name}.png").write_bytes(png)
        (temporary / _PREVIEW).write_bytes(pictures.png_bytes(_preview(views)))
        for name, text in texts.items():
            (temporary / name).write_text(text, encoding="utf-8")
    return [folder / name for name in names]


def _preview(views: dict[str, list[MapView]]) -> Picture:
    tiles = [view for section in views.values() for view in section[:_PREVIEW_ROW]]
    return pictures.contact_sheet({view.title: view.picture for view in tiles[:_PREVIEW_TILES]})


def _write_map(path: Path, kind: MapKind, maps: SurfaceMaps, origin: dict[str, Any]) -> None:
    values, description = maps.values(kind), origin | kind.description(maps)
    if kind.labels is not None:
        top = max(kind.labels.names(maps.tilts_deg))
        write_channels(path, values, (kind.name,), (0, top), description, maps.mm_per_px)
    elif values.ndim == 3:
        axes = np.moveaxis(values, 2, 0)
        write_channels(path, axes, ("x", "y", "z"), (-1.0, 1.0), description, maps.mm_per_px)
    else:
        write_values(path, values, description, maps.mm_per_px)
