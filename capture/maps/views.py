"""The maps of a surface on the page: picture, colours and caption of each."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from capture.sets.captured_set import CapturedSet
from classify.relief.curvature import CURVATURE_SCALE_PX
from classify.relief.local_height import default_cutoff_px
from classify.shadow_rule import NO_DROPPED_LIGHT
from classify.surface.estimate import FloatMap

from . import pictures
from .figures import data_uri
from .pictures import ColourScale, Picture
from .surface_maps import SurfaceMaps

# Light images on the page; a dome may have hundreds.
SHOWN_LIGHTS = 8
_SMALL_PX = 256  # the width of a map on the page
# A legend lists this many of the most frequent values.
_LEGEND_ENTRIES = 8


@dataclass(frozen=True, eq=False)
class MapView:
    """One map as the page shows it."""

    file: str | None  # name of the file with the values, None if there is only a picture
    title: str
    caption: str
    picture: Picture  # reduced to the size at which it is shown
    scale: ColourScale | None = None
    unit: str = ""
    legend: tuple[tuple[Sequence[int], str], ...] = ()

    @property
    def uri(self) -> str:
        """Address of the picture."""
        return data_uri(self.picture)

    @property
    def is_small(self) -> bool:
        """Whether the page enlarges the picture, with square pixels instead of interpolation."""
        return bool(max(self.picture.shape[:2]) < _SMALL_PX)


def map_views(captured: CapturedSet, maps: SurfaceMaps) -> dict[str, list[MapView]]:
    """Return the views of a set and its surface by section, in the order of the page."""
    lights = len(captured.images)
    part = f" (the first {SHOWN_LIGHTS} of {lights})" if lights > SHOWN_LIGHTS else ""
    return {
        f"Light images{part}": [
            MapView(None, name, "", picture)
            for name, picture in pictures.light_images(captured, SHOWN_LIGHTS).items()
        ],
        "Surface": _surface(maps),
        "Slopes and height": _relief(maps),
        "Curvature": _curvature(maps),
        "Quality": _quality(maps, captured.lighting.tilts_deg),
    }


def _surface(maps: SurfaceMaps) -> list[MapView]:
    tilt, slant = maps.light.tilts_deg[0], maps.light.slants_deg[0]
    normals = pictures.reduced(maps.known(maps.normals))
    return [
        _grey(
            "albedo.tif", "albedo", maps.known(maps.surface.albedo), "of full scale",
            "Share of the light that the surface reflects, without shading.",
        ),
        MapView(
            None, "relief", "The shape alone, lit from the upper left.", pictures.shaded(normals)
        ),
        MapView(
            "normals.tif", "normals",
            "Unit normals: red to the right, green up, blue to the camera.",
            pictures.normal_map(normals),
        ),
        _grey(
            "relit.tif", f"relit: tilt {tilt:.0f}, slant {slant:.0f}", maps.known(maps.relit),
            "of full scale",
            f"Albedo and shape under a light at tilt {tilt:.0f}°, slant {slant:.0f}°, "
            "without cast shadows or gloss.",
        ),
    ]  # fmt: skip


def _relief(maps: SurfaceMaps) -> list[MapView]:
    surface, unit = maps.surface, maps.length_unit
    relative = maps.mm_per_px is None
    cutoff_px = default_cutoff_px(surface.shape)
    return [
        _signed(
            "p.tif", "p = dz/dx", maps.known(surface.p), "",
            "Slope to the right: red rises to the right.",
        ),
        _signed(
            "q.tif", "q = dz/dy", maps.known(surface.q), "", "Slope upwards: red rises upwards."
        ),
        _signed(
            "height.tif", "height" + " (relative)" * relative, maps.known(maps.height), unit,
            "Integrated from p and q, zero mean over the frame" + ", not measured" * relative
            + ". Errors grow with distance.",
        ),
        _signed(
            "raised.tif", "raised / indented", maps.known(maps.raised), unit,
            ("Relative height" if relative else "Height")
            + " above its surroundings: red raised, blue indented. "
            f"Gaussian filter, cut-off {cutoff_px:.0f} px.",
        ),
    ]  # fmt: skip


def _curvature(maps: SurfaceMaps) -> list[MapView]:
    unit = maps.length_unit
    return [
        _signed(
            "mean_curvature.tif", "mean curvature", maps.known(maps.mean_curvature), f"1/{unit}",
            "Red: convex towards the camera (bumps, ridges); blue: concave. "
            f"Derivatives within a Gaussian of {CURVATURE_SCALE_PX:g} px.",
        ),
        _signed(
            "gaussian_curvature.tif", "Gaussian curvature", maps.known(maps.gaussian_curvature),
            f"1/{unit}²",
            "Red: domes and bowls; blue: saddles; white: flat, or curved in one direction only.",
        ),
    ]  # fmt: skip


def _quality(maps: SurfaceMaps, tilts_deg: npt.NDArray[np.float64]) -> list[MapView]:
    surface, lights = maps.surface, len(tilts_deg)
    shadow_names = {count: f"{count} lights" for count in range(lights + 1)} | {1: "1 light"}
    light_names = {light: f"light {light}, tilt {tilts_deg[light]:.0f}°" for light in range(lights)}
    light_names[NO_DROPPED_LIGHT] = "none"
    return [
        MapView(
            "shadow.png", "lights in shadow",
            "Number of lights that give at most half of the predicted brightness: cast and "
            "attached shadow. 0 where no slope is known, as on a black backdrop.",
            pictures.reduced(pictures.shadow_map(surface)),
            legend=_legend(surface.shadow_count, pictures.shadow_colours(), shadow_names),
        ),
        _grey(
            "residual.tif", "residual", maps.known(surface.residual), "of full scale",
            "rms difference of the light images from a matt surface: shadow, gloss, noise.",
        ),
        MapView(
            "dropped.png", "dropped light", "The light that the solution leaves out.",
            pictures.reduced(pictures.dropped_map(surface, lights), cv2.INTER_NEAREST),
            legend=_legend(surface.dropped, pictures.dropped_colours(lights), light_names),
        ),
        _mask(
            "specular.png", "gloss", surface.specular,
            "Brighter by half under one light than a matt surface would be.",
        ),
        _mask("valid.png", "valid", surface.valid, "The slope is determined."),
    ]  # fmt: skip


def _grey(file: str, title: str, values: FloatMap, unit: str, caption: str) -> MapView:
    values = pictures.reduced(values)
    scale = ColourScale.grey(values)
    return MapView(file, title, caption, scale.paint(values), scale, unit)


def _signed(file: str, title: str, values: FloatMap, unit: str, caption: str) -> MapView:
    values = pictures.reduced(values)
    scale = ColourScale.signed(values)
    return MapView(file, title, caption, scale.paint(values), scale, unit)


def _mask(file: str, title: str, mask: npt.NDArray[np.bool_], caption: str) -> MapView:
    picture = pictures.grey(pictures.reduced(mask * np.uint8(255)), top=255.0)
    share = float(mask.mean())
    legend = (((255,) * 3, f"yes {share:.1%}"), ((0,) * 3, f"no {1.0 - share:.1%}"))
    return MapView(file, title, caption, picture, legend=legend)


def _legend(
    values: npt.NDArray[np.uint8], colours: Picture, names: dict[int, Any]
) -> tuple[tuple[Sequence[int], str], ...]:
    """Return the most frequent values in ascending order, with their shares of the pixels."""
    shares = np.bincount(values.ravel(), minlength=256) / values.size
    shown = sorted(sorted(names, key=lambda value: -shares[value])[:_LEGEND_ENTRIES])
    return tuple(
        (colours[value].tolist(), f"{names[value]} {shares[value]:.1%}")
        for value in shown
        if shares[value] > 0
    )
