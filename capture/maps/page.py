"""The page of maps: one self-contained HTML file."""

from collections.abc import Iterator

import numpy as np

from capture.base.page import rendered
from capture.calibration.lookup import FoundCalibration
from capture.sets.captured_set import CapturedSet
from classify import SurfaceEstimate
from classify.base.arrays import Floats
from classify.lights.flat_field import FlatField

from .roughness_table import roughness_note, roughness_parameters
from .surface_maps import SurfaceMaps
from .views import MapView

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
        roughness=roughness_parameters(maps.roughness, maps.mm_per_px),
        roughness_note=roughness_note(maps.mm_per_px),
        units=_UNITS,
    )


def _facts(captured: CapturedSet, maps: SurfaceMaps) -> Iterator[tuple[str, str]]:
    surface, metadata = maps.surface, captured.metadata
    lighting = surface.lighting or captured.lighting
    rows, columns = surface.shape
    yield "solver", surface.method
    if surface.planar:
        yield "planar part", _divided(surface.fall_off)
    yield "image", f"{columns} x {rows} px, {metadata.bit_depth} bit"
    if maps.mm_per_px is not None:
        yield "scale", f"{maps.mm_per_px:.4g} mm/px"
    yield "lights", f"{len(lighting)}, slant {_span(lighting.slants_deg)}°"
    if lighting.positions_px is not None:
        distances_px = np.linalg.norm(lighting.positions_px, axis=1)
        yield "distance of the lights", f"{_span(distances_px)} px"
    if surface.divided_by is not None:
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


def _divided(fall_off: FlatField | None) -> str:
    if fall_off is None:
        return "too little of it is lit: no fall-off divided out"
    return f"fall-off of {fall_off.share:.0%} divided out, with any tilt or bow"


def _levels(levels: Floats) -> str:
    return ", ".join(f"{level:.3f}" for level in levels)


def _span(values: Floats) -> str:
    low, high = f"{values.min():.1f}", f"{values.max():.1f}"
    return low if low == high else f"{low} to {high}"
