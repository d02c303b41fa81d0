"""A surface with scratches, dents, bumps, stains, missing or foreign texture.

Shapes are formulas in the coordinates of the part, so height and gradients agree exactly, a defect
rotates without interpolation, and its height casts shadows as the relief does.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from classify.base.arrays import BoolArray
from classify.defects.shapes import Image, Shape, blot, bump, scratch
from rig.config.simulation import RELIEF_KINDS, Defect
from rig.scene.surfaces import Surface, SurfacePatch, View

_Number = TypeVar("_Number", float, Image)

_Window = tuple[slice, slice]

_MAPS = ("height", "p", "q", "albedo")
# Distance, in half widths, at which the height of a groove is below 1e-6 of its depth.
_GROOVE_REACH = 6.0


@dataclass(frozen=True, eq=False)
class DefectiveSurface:
    """A surface with defects, applied in this order; `foreign` has foreign textures by name."""

    surface: Surface
    defects: tuple[Defect, ...]
    foreign: Mapping[str, Surface]

    @property
    def relief_px(self) -> float:
        """Bound on the height of the highest point above the lowest, in pixels."""
        # A scratch is 1.5 depths from its ground to the top of its ridges.
        depths_px = [defect.depth_px for defect in self.defects if defect.kind in RELIEF_KINDS]
        foreign_px = sum(surface.relief_px for surface in self.foreign.values())
        return self.surface.relief_px + 1.5 * sum(depths_px) + foreign_px

    def patch(self, view: View) -> SurfacePatch:
        """A square piece of the surface with its defects; see `PeriodicSurface.patch`."""
        patch = self.surface.patch(view)
        patch = replace(patch, **{name: getattr(patch, name).copy() for name in _MAPS})
        x, y = view.part_coordinates()
        for defect in self.defects:
            # Only the window is computed: the frame may be a hundred times as large.
            window = _window(defect, x, y)
            piece = _cut(patch, window)
            changed = self._with_defect(defect, piece, x[window], y[window], window, view)
            for name in _MAPS:
                getattr(patch, name)[window] = getattr(changed, name)
        return patch

    def mask(
        self, size_px: int, rotate_deg: float = 0.0, shift_px: tuple[float, float] = (0.0, 0.0)
    ) -> BoolArray:
        """Pixels of a frame within the outline of a defect, (size_px, size_px)."""
        x, y = View(size_px, rotate_deg, shift_px).part_coordinates()
        inside = np.zeros(x.shape, np.bool_)
        for defect in self.defects:
            window = _window(defect, x, y)
            along, across = _from_defect(defect, x[window], y[window])
            if defect.kind == "scratch":
                # Beyond 2.5 half widths the ridges are below a quarter of the depth and fall.
                on_line = np.abs(along) < 0.5 * defect.size_px
                inside[window] |= on_line & (np.abs(across) < 1.25 * defect.width_px)
            elif defect.kind in RELIEF_KINDS:
                inside[window] |= np.hypot(along, across) < 0.5 * defect.size_px
            else:
                inside[window] |= blot(defect.size_px, along, across).value > 0.0
        return inside

    def _with_defect(
        self, defect: Defect, piece: SurfacePatch, x: Image, y: Image, window: _Window, view: View
    ) -> SurfacePatch:
        """Add a defect to the `window` of a patch; x and y are its coordinates on the part."""
        angle_deg, magnification = view.rotate_deg + defect.angle_deg, view.magnification
        along, across = _from_defect(defect, x, y)
        if defect.kind == "stain":
            faded = 1.0 - defect.contrast * blot(defect.size_px, along, across).value
            return replace(piece, albedo=np.float32(faded) * piece.albedo)
        if defect.kind not in RELIEF_KINDS:
            other = self._filling(defect, along, across, window, view)
            weight = blot(defect.size_px, along, across)
            return _blended(piece, other, weight, angle_deg, magnification)
        height_px = defect.depth_px if defect.kind == "bump" else -defect.depth_px
        if defect.kind == "scratch":
            relief = scratch(defect.size_px, defect.width_px, along, across)
        else:
            relief = bump(defect.size_px, along, across)
        p, q = _rotated(relief.along, relief.across, angle_deg)
        return replace(
            piece,
            height=piece.height + np.float32(height_px * magnification * relief.value),
            p=piece.p + np.float32(height_px * p),
            q=piece.q + np.float32(height_px * q),
        )

    def _filling(
        self, defect: Defect, along: Image, across: Image, window: _Window, view: View
    ) -> SurfacePatch:
        """The mean plane of the replaced texture, with the relief of the foreign one."""
        height, p, q, albedo = _means_around(self.surface, defect, (defect.x_px, defect.y_px))
        p_along, q_across = _rotated(p, q, -defect.angle_deg)
        angle_deg = view.rotate_deg + defect.angle_deg
        if defect.surface is not None:
            shift = _rotated(
                view.shift_px[0] - defect.x_px, view.shift_px[1] - defect.y_px, -defect.angle_deg
            )
            other = self.foreign[defect.surface]
            patch = _cut(other.patch(replace(view, rotate_deg=angle_deg, shift_px=shift)), window)
            # The plane replaces that of the foreign texture.
            other_height, other_p, other_q, _ = _means_around(other, defect, (0.0, 0.0))
            height, p_along, q_across = height - other_height, p_along - other_p, q_across - other_q
        else:
            flat = np.zeros(along.shape, np.float32)
            patch = SurfacePatch(flat, flat, flat, np.full_like(flat, albedo))
        plane = view.magnification * (height + p_along * along + q_across * across)
        p, q = _rotated(p_along, q_across, angle_deg)
        return replace(
            patch,
            height=patch.height + np.float32(plane),
            p=patch.p + np.float32(p),
            q=patch.q + np.float32(q),
        )


def _cut(patch: SurfacePatch, window: _Window) -> SurfacePatch:
    return replace(patch, **{name: getattr(patch, name)[window] for name in _MAPS})


def _means_around(
    surface: Surface, defect: Defect, middle_px: tuple[float, float]
) -> tuple[float, float, float, float]:
    """Means of height, p, q and albedo under a defect of which a part may be outside the frame."""
    side_px = math.ceil(defect.size_px)
    patch = surface.patch(View(side_px, shift_px=middle_px))
    weight = bump(defect.size_px, *View(side_px).part_coordinates()).value
    weight /= weight.sum()
    height, p, q, albedo = (
        float((weight * plane).sum()) for plane in (patch.height, patch.p, patch.q, patch.albedo)
    )
    return height, p, q, albedo


def _blended(
    patch: SurfacePatch,
    other: SurfacePatch,
    weight: Shape,
    angle_deg: float,
    magnification: float,
) -> SurfacePatch:
    """(1 - w) patch + w other; the gradients are those of the blended height."""
    w = np.float32(weight.value)
    height_step = (other.height - patch.height) / magnification
    edge_p, edge_q = _rotated(weight.along, weight.across, angle_deg)
    return replace(
        patch,
        height=patch.height + w * (other.height - patch.height),
        p=patch.p + w * (other.p - patch.p) + height_step * np.float32(edge_p),
        q=patch.q + w * (other.q - patch.q) + height_step * np.float32(edge_q),
        albedo=patch.albedo + w * (other.albedo - patch.albedo),
    )


def _window(defect: Defect, x: Image, y: Image) -> _Window:
    """Rows and columns of the pixels that a defect can change; empty if it is outside."""
    reach_px = 0.5 * (defect.size_px + _GROOVE_REACH * defect.width_px)
    in_reach = (abs(x - defect.x_px) <= reach_px) & (abs(y - defect.y_px) <= reach_px)
    rows, cols = (np.flatnonzero(in_reach.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return slice(0, 0), slice(0, 0)
    return slice(rows[0], rows[-1] + 1), slice(cols[0], cols[-1] + 1)


def _from_defect(defect: Defect, x: Image, y: Image) -> tuple[Image, Image]:
    """Coordinates from the middle of the defect, along its angle and across it."""
    cos, sin = _cos_sin(defect.angle_deg)
    right, up = x - defect.x_px, y - defect.y_px
    return cos * right + sin * up, cos * up - sin * right


def _rotated(x: _Number, y: _Number, angle_deg: float) -> tuple[_Number, _Number]:
    cos, sin = _cos_sin(angle_deg)
    return cos * x - sin * y, sin * x + cos * y


def _cos_sin(angle_deg: float) -> tuple[float, float]:
    angle = math.radians(angle_deg)
    return math.cos(angle), math.sin(angle)
