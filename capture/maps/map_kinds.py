"""The maps of a surface: one row for each. Files, page, preview, compare and napari read it.

A new map is a function that computes it, and a row.
"""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from capture.sets.captured_set import CapturedSet
from classify import SurfaceEstimate, local_relief, relight
from classify.base.arrays import BoolArray, FloatMap
from classify.relief.curvature import CURVATURE_SCALE_PX

from . import pictures, views
from .views import LENGTH, SHOWN_LIGHTS, MapKind, MapView, SurfaceMaps


def _as_levels(mask: BoolArray) -> npt.NDArray[np.uint8]:
    """A mask as pixel values, 255 where it is true."""
    return mask * np.uint8(255)


def _deviation(name: str) -> Callable[[SurfaceMaps], FloatMap]:
    def compute(maps: SurfaceMaps) -> FloatMap:
        deviations: FloatMap = getattr(maps.surface, f"{name}_sd")
        return deviations

    return compute


_ROWS = (
    MapKind(
        "albedo", "Surface", "albedo",
        "Share of the light that the surface reflects, without shading.",
        lambda maps: maps.surface.albedo, views.grey, "full scale", is_compared=True,
    ),
    MapKind(
        "relief", "Surface", "relief", "The shape alone, lit from the upper left.",
        lambda maps: maps.surface.normals, views.relief, is_written=False,
    ),
    MapKind(
        "normals", "Surface", "normals",
        "Unit normals: red to the right, green up, blue to the camera.",
        lambda maps: maps.surface.normals, views.normals,
    ),
    MapKind(
        "relit", "Surface", "relit: tilt {tilt_deg:.0f}, slant {slant_deg:.0f}",
        "Albedo and shape under a light at tilt {tilt_deg:.0f}°, slant {slant_deg:.0f}°, "
        "without cast shadows or gloss.",
        lambda maps: relight(maps.surface, maps.light)[0], views.grey, "full scale",
        details=lambda maps: {
            "light": {"tilt_deg": maps.light.tilts_deg[0], "slant_deg": maps.light.slants_deg[0]}
        },
    ),
    MapKind(
        "p", "Slopes and height", "p = dz/dx", "Slope to the right: red rises to the right.",
        lambda maps: maps.surface.p, views.signed, is_compared=True,
    ),
    MapKind(
        "q", "Slopes and height", "q = dz/dy", "Slope upwards: red rises upwards.",
        lambda maps: maps.surface.q, views.signed, is_compared=True,
    ),
    MapKind(
        "height", "Slopes and height", "height{relative}",
        "Integrated from p and q, zero mean over the frame{unmeasured}. "
        "Errors grow with distance.",
        lambda maps: maps.height, views.signed, LENGTH, is_compared=True,
    ),
    MapKind(
        "raised", "Slopes and height", "raised / indented",
        "{Height} above its surroundings: red raised, blue indented. "
        "Gaussian filter, cut-off {cutoff_px:.0f} px.",
        lambda maps: local_relief(maps.height, maps.surface.valid), views.signed, LENGTH,
    ),
    MapKind(
        "mean_curvature", "Curvature", "mean curvature",
        "Red: convex towards the camera (bumps, ridges); blue: concave. "
        f"Derivatives within a Gaussian of {CURVATURE_SCALE_PX:g} px.",
        lambda maps: maps.curvature.mean / maps.length_per_px, views.signed, "1/{length}",
    ),
    MapKind(
        "gaussian_curvature", "Curvature", "Gaussian curvature",
        "Red: domes and bowls; blue: saddles; white: flat, or curved in one direction only.",
        lambda maps: maps.curvature.gaussian / maps.length_per_px**2, views.signed,
        "1/{length}^2",
    ),
    MapKind(
        "angle_sd", "Quality", "standard deviation of the normal",
        "95 % of the errors of the normal are below 1.96 times this angle. They come from noise, "
        "gloss and completed shadows; errors of the calibration are left out.",
        _deviation("angle"), views.grey, "deg", is_deviation=True,
    ),
    *(
        MapKind(
            f"{name}_sd", "Quality", f"standard deviation of {name}", "",
            _deviation(name), views.grey, unit,
            is_shown=False, is_deviation=True,
        )
        for name, unit in (("p", "1"), ("q", "1"), ("albedo", "full scale"))
    ),
    MapKind(
        "shadow", "Quality", "lights in shadow",
        "Number of lights that give at most half of the predicted brightness: cast and "
        "attached shadow. 0 where no slope is known, as on a black backdrop.",
        lambda maps: maps.surface.shadow_count, views.labelled, labels=views.SHADOWED_LIGHTS,
    ),
    MapKind(
        "residual", "Quality", "residual",
        "rms difference of the light images from a matt surface: shadow, gloss, noise.",
        lambda maps: maps.surface.residual, views.grey, "full scale", is_compared=True,
    ),
    MapKind(
        "dropped", "Quality", "dropped light", "The light that the solution leaves out.",
        lambda maps: maps.surface.dropped, views.labelled, labels=views.DROPPED_LIGHT,
    ),
    MapKind(
        "specular", "Quality", "gloss",
        "Brighter by half under one light than a matt surface would be.",
        lambda maps: _as_levels(maps.surface.specular), views.labelled, labels=views.YES_NO,
    ),
    MapKind(
        "valid", "Quality", "valid", "The slope is determined.",
        lambda maps: _as_levels(maps.surface.valid), views.labelled, labels=views.YES_NO,
    ),
)  # fmt: skip
MAP_KINDS: dict[str, MapKind] = {kind.name: kind for kind in _ROWS}


def kinds_of(surface: SurfaceEstimate) -> list[MapKind]:
    """Return the maps that a surface has: deviations only if it was solved with them."""
    return [
        kind for kind in MAP_KINDS.values() if not kind.is_deviation or surface.angle_sd is not None
    ]


def map_views(captured: CapturedSet, maps: SurfaceMaps) -> dict[str, list[MapView]]:
    """Return the views of a set and its surface by section, in the order of the page."""
    lights = len(captured.images)
    selection = f" (the first {SHOWN_LIGHTS} of {lights})" if lights > SHOWN_LIGHTS else ""
    sections = {
        f"Light images{selection}": [
            MapView(None, name, "", picture)
            for name, picture in pictures.light_images(captured, SHOWN_LIGHTS).items()
        ]
    }
    for kind in kinds_of(maps.surface):
        if kind.is_shown:
            sections.setdefault(kind.section, []).append(kind.show(kind, maps))
    return sections
