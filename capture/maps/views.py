"""A solved surface as maps, and how each map is shown: picture, colours and caption."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from classify import (
    Lighting,
    Roughness,
    SurfaceEstimate,
    integrate_gradients,
    surface_curvature,
    surface_roughness,
)
from classify.base.arrays import Array, FloatMap
from classify.base.errors import InputError
from classify.relief.height import default_cutoff_px
from classify.relief.roughness import RoughnessUncertainty, roughness_uncertainty
from classify.shadow_rule import NO_DROPPED_LIGHT
from rig.config.lights import led_names

from . import pictures
from .pictures import ColourScale, Picture, data_uri

if TYPE_CHECKING:
    from classify import Curvature

# From the upper left, as viewers expect, and between two lights of the ring.
RELIT_LIGHT = Lighting.from_angles([135.0], 45.0)


@dataclass(frozen=True, eq=False)
class SurfaceMaps:
    """A surface whose maps `ps4rig solve` writes and shows; lengths are in `length_unit`."""

    surface: SurfaceEstimate
    light: Lighting = RELIT_LIGHT  # of the relit map
    mm_per_px: float | None = None
    _computed: dict[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.light) != 1:
            raise InputError(f"relit under {len(self.light)} lights; give one")

    def values(self, kind: MapKind) -> Array:
        """(H, W) or (H, W, 3) values of a map; float32 values are NaN where invalid."""
        if kind.name not in self._computed:
            self._computed[kind.name] = kind.compute(self)
        values = self._computed[kind.name]
        if kind.is_mask:
            return values
        valid = self.surface.valid.reshape(self.surface.shape + (1,) * (values.ndim - 2))
        return np.where(valid, values, np.float32(np.nan)).astype(np.float32, copy=False)

    @cached_property
    def height(self) -> FloatMap:
        """Height from the gradients alone, zero mean."""
        height = integrate_gradients(self.surface.p, self.surface.q, self.surface.valid)
        height *= self.length_per_px
        return height

    @cached_property
    def curvature(self) -> Curvature:
        """Mean and Gaussian curvature per pixel."""
        return surface_curvature(self.surface)

    @cached_property
    def roughness(self) -> Roughness | None:
        """Roughness of the height; None if no pixel is valid."""
        if not self.surface.valid.any():
            return None
        return surface_roughness(self.surface, self.height / self.length_per_px)

    @cached_property
    def roughness_uncertainty(self) -> RoughnessUncertainty | None:
        """Uncertainty of the roughness; None for a surface without deviations."""
        if self.roughness is None or self.surface.p_sd is None:
            return None
        across_px = float(self.surface.shape[1] - 1)
        distances_px = [across_px]
        if self.mm_per_px is not None and 1.0 / self.mm_per_px < across_px:
            distances_px.insert(0, 1.0 / self.mm_per_px)
        return roughness_uncertainty(self.surface, self.roughness, tuple(distances_px))

    @property
    def tilts_deg(self) -> list[float]:
        lighting = self.surface.lighting
        return [] if lighting is None else lighting.tilts_deg.tolist()

    @property
    def length_unit(self) -> str:
        """Unit of height and, inverted, of curvature: mm if the scale is known, else px."""
        return "px" if self.mm_per_px is None else "mm"

    @property
    def length_per_px(self) -> np.float32:
        """Length units in a pixel."""
        return np.float32(1.0 if self.mm_per_px is None else self.mm_per_px)

    @property
    def words(self) -> dict[str, Any]:
        """Words of titles, captions and units."""
        relative = self.mm_per_px is None
        return {
            "length": self.length_unit,
            "relative": " (relative)" if relative else "",
            "unmeasured": ", not measured" if relative else "",
            "Height": "Relative height" if relative else "Height",
            "cutoff_px": default_cutoff_px(self.surface.shape),
            "tilt_deg": self.light.tilts_deg[0],
            "slant_deg": self.light.slants_deg[0],
        }


# Largest number of light images on the page; a dome may have hundreds.
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
        return data_uri(self.picture)

    @property
    def is_small(self) -> bool:
        """Whether the page enlarges the picture, with square pixels instead of interpolation."""
        return bool(max(self.picture.shape[:2]) < _SMALL_PX)


_Section = Literal["Surface", "Slopes and height", "Curvature", "Quality"]


@dataclass(frozen=True)
class _Labels:
    """The values of a mask: their names, and their colours on pictures."""

    names: Callable[[list[float]], dict[int, str]]  # from the tilts of the lights in degrees
    colours: Callable[[int], Picture] | None = None  # (256, 3) by the number of lights; or grey


@dataclass(frozen=True)
class MapKind:
    """One map of ``ps4rig solve``; title, caption and unit may use `SurfaceMaps.words`."""

    name: str
    section: _Section
    title: str
    caption: str
    # (H, W) or (H, W, 3) float32 values; of a mask, (H, W) uint8
    compute: Callable[[SurfaceMaps], Array]
    show: Callable[[MapKind, SurfaceMaps], MapView]
    unit: str = "1"
    labels: _Labels | None = None  # of a mask
    details: Callable[[SurfaceMaps], dict[str, Any]] | None = None  # further text of the file
    is_compared: bool = False  # whether `ps4rig compare` compares it
    is_written: bool = True  # to a file; else there is only a picture
    is_shown: bool = True  # on the page; else there is only a file
    is_deviation: bool = False  # only of a surface that was solved with its uncertainty

    @property
    def is_mask(self) -> bool:
        """Whether it has labels instead of measured values."""
        return self.labels is not None

    def unit_of(self, maps: SurfaceMaps) -> str:
        """The unit as in the files."""
        return self.unit.format_map(maps.words)

    def description(self, maps: SurfaceMaps) -> dict[str, Any]:
        """Unit and details, for the file."""
        if self.is_mask:
            return {}
        relative = {"relative": maps.mm_per_px is None} if self.unit == LENGTH else {}
        details = {} if self.details is None else self.details(maps)
        return {"unit": self.unit_of(maps)} | relative | details


LENGTH = "{length}"


def unit_text(unit: str, *, relative: bool = False) -> str:
    """A unit as pages show it."""
    texts = {"1": "", "full scale": "of full scale"}
    length = unit.replace("^2", "\N{SUPERSCRIPT TWO}")
    return texts.get(unit, f"{length}, relative" if relative else length)


def grey(kind: MapKind, maps: SurfaceMaps) -> MapView:
    """Show values on a scale from black at 0 to white."""
    return _scaled(kind, maps, ColourScale.grey)


def signed(kind: MapKind, maps: SurfaceMaps) -> MapView:
    """Show values on a scale of blue, white at 0, and red."""
    return _scaled(kind, maps, ColourScale.signed)


def normals(kind: MapKind, maps: SurfaceMaps) -> MapView:
    """Show unit normals as colours."""
    return _view(kind, maps, pictures.normal_map(pictures.reduced(maps.values(kind))))


def relief(kind: MapKind, maps: SurfaceMaps) -> MapView:
    """Show unit normals as shading."""
    return _view(kind, maps, pictures.shaded(pictures.reduced(maps.values(kind))))


def labelled(kind: MapKind, maps: SurfaceMaps) -> MapView:
    """Show a mask with a legend of its most frequent values."""
    labels = kind.labels or YES_NO
    # The mean of two colours would stand for another value.
    interpolation = cv2.INTER_AREA if labels.colours is None else cv2.INTER_NEAREST
    picture = pictures.reduced(mask_picture(kind, maps), interpolation)
    if picture.ndim == 2:
        picture = pictures.grey(picture, top=255.0)
    return _view(kind, maps, picture, legend=_legend(maps.values(kind), labels, maps.tilts_deg))


def mask_picture(kind: MapKind, maps: SurfaceMaps) -> Picture:
    """(H, W) values of a mask, or (H, W, 3) if its labels have colours."""
    values = maps.values(kind)
    if kind.labels is None or kind.labels.colours is None:
        return values
    return pictures.coloured(values, kind.labels.colours(len(maps.tilts_deg)))


def _scaled(kind: MapKind, maps: SurfaceMaps, scale_of: Callable[[Array], ColourScale]) -> MapView:
    values = pictures.reduced(maps.values(kind))
    scale = scale_of(values)
    return _view(kind, maps, scale.paint(values), scale=scale)


def _view(
    kind: MapKind,
    maps: SurfaceMaps,
    picture: Picture,
    scale: ColourScale | None = None,
    legend: tuple[tuple[Sequence[int], str], ...] = (),
) -> MapView:
    file = f"{kind.name}.{'png' if kind.is_mask else 'tif'}" if kind.is_written else None
    title, caption = (text.format_map(maps.words) for text in (kind.title, kind.caption))
    unit = "" if scale is None else unit_text(kind.unit_of(maps))
    return MapView(file, title, caption, picture, scale, unit, legend)


def _legend(
    values: npt.NDArray[np.uint8], labels: _Labels, tilts_deg: list[float]
) -> tuple[tuple[Sequence[int], str], ...]:
    """Return the most frequent values in ascending order, with their shares of the pixels."""
    names = labels.names(tilts_deg)
    colours = pictures.GREYS if labels.colours is None else labels.colours(len(tilts_deg))
    shares = np.bincount(values.ravel(), minlength=256) / values.size
    listed_values = sorted(sorted(names, key=lambda value: -shares[value])[:_LEGEND_ENTRIES])
    return tuple(
        (colours[value].tolist(), f"{names[value]} {shares[value]:.1%}")
        for value in listed_values
        if shares[value] > 0
    )


YES_NO = _Labels(lambda _: {0: "no", 255: "yes"})
SHADOWED_LIGHTS = _Labels(
    lambda tilts_deg: (
        {0: "0 lights", 1: "1 light"}
        | {count: f"{count} lights" for count in range(2, len(tilts_deg) + 1)}
    ),
    pictures.shadow_colours,
)
DROPPED_LIGHT = _Labels(
    lambda tilts_deg: dict(enumerate(led_names(tilts_deg))) | {NO_DROPPED_LIGHT: "none"},
    pictures.dropped_colours,
)
