"""Geometry of a sphere in a picture: normals, views and points of its surface.

Coordinates are pixels of the image at the plane of the part, from the middle of the frame: x right,
y up, z towards the camera. The sphere lies on that plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from classify.base.arrays import Floats, Indices
from classify.base.errors import CalibrationRejected

from .sphere_outline import Outline


@dataclass(frozen=True, eq=False)
class Sphere:
    """A sphere at rest on the plane of the part."""

    centre: Floats  # (3,)
    radius_px: float
    error_px: float  # standard error of the centre in the picture
    focal_px: float | None  # distance of the camera from the plane; None for an orthographic view
    frame: tuple[int, int]  # rows and columns

    @classmethod
    def of_outline(
        cls, outline: Outline, frame: tuple[int, int], focal_px: float | None = None
    ) -> Sphere:
        """Fit the cone of rays to the outline.

        Its rays d obey d . (c / cos g) = 1, with sin g = radius / distance of the sphere.
        """
        rows, columns = frame
        if focal_px is None:
            x, y = (
                outline.circle.column - 0.5 * (columns - 1),
                0.5 * (rows - 1) - outline.circle.row,
            )
            radius = outline.circle.radius
            return cls(np.array([x, y, radius]), radius, outline.error_px, None, frame)
        rays = _rays(outline.rim[:, 0], outline.rim[:, 1], frame, focal_px)
        axis = np.linalg.lstsq(rays, np.ones(len(rays)), rcond=None)[0]
        length = float(np.linalg.norm(axis))
        if length <= 1.0:
            raise CalibrationRejected(
                "the outline is not that of a sphere in perspective; calibrate the scale again"
            )
        # Distance of the centre in radii; the lowest point of the sphere is on the plane z = 0.
        distance = 1.0 / np.sqrt(1.0 - 1.0 / length**2)
        towards = axis / length
        radius = focal_px / (1.0 - distance * towards[2])
        centre = np.array([0.0, 0.0, focal_px]) + distance * radius * towards
        return cls(centre, float(radius), outline.error_px, focal_px, frame)

    def surface_at(self, columns: npt.ArrayLike, rows: npt.ArrayLike) -> tuple[Floats, Floats]:
        """(n, 3) unit normals, and unit vectors to the camera, at pixels of the sphere."""
        at_column, at_row = np.asarray(columns, np.float64), np.asarray(rows, np.float64)
        if self.focal_px is None:
            height, width = self.frame
            x = (at_column - 0.5 * (width - 1) - self.centre[0]) / self.radius_px
            y = (0.5 * (height - 1) - at_row - self.centre[1]) / self.radius_px
            beyond = np.maximum(np.hypot(x, y), 1.0)
            x, y = x / beyond, y / beyond
            normals = np.stack([x, y, np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))], axis=-1)
            return normals, np.broadcast_to([0.0, 0.0, 1.0], normals.shape)
        rays = _rays(at_column, at_row, self.frame, self.focal_px)
        centre = self.centre - (0.0, 0.0, self.focal_px)
        along = rays @ centre
        inside = along**2 - centre @ centre + self.radius_px**2
        points = rays * (along - np.sqrt(np.maximum(inside, 0.0)))[..., None]
        normals = points - centre
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        return normals, -rays

    def pixels(self, share: float = 1.0) -> tuple[Indices, Indices]:
        """Rows and columns of the pixels within this share of the outline's radius."""
        height, width = self.frame
        # Distance of the centre from the camera, relative to that of the plane.
        relative_distance = 1.0 if self.focal_px is None else 1.0 - self.centre[2] / self.focal_px
        x, y = self.centre[0] / relative_distance, self.centre[1] / relative_distance
        radius = share * self.radius_px / relative_distance
        column, row = x + 0.5 * (width - 1), 0.5 * (height - 1) - y
        rows = np.arange(max(int(row - radius), 0), min(int(row + radius) + 2, height))
        columns = np.arange(max(int(column - radius), 0), min(int(column + radius) + 2, width))
        inside = (rows[:, None] - row) ** 2 + (columns - column) ** 2 < radius**2
        row_indices, column_indices = np.nonzero(inside)
        return rows[row_indices], columns[column_indices]


def _rays(columns: Floats, rows: Floats, frame: tuple[int, int], focal_px: float) -> Floats:
    """Unit vectors from the camera through pixels."""
    height, width = frame
    x, y = columns - 0.5 * (width - 1), 0.5 * (height - 1) - rows
    rays = np.stack([x, y, np.full_like(x, -focal_px)], axis=-1)
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))
