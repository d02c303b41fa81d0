"""A height map as a mesh of triangles: binary ``.ply`` and ``.stl``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from capture.sets.captured_set import LoadedSet
from classify import SurfaceEstimate
from classify.base.arrays import Array, FloatMap
from classify.base.durable_file import durable_file

from .height_files import solved_height


def scaled_height(loaded: LoadedSet) -> tuple[SurfaceEstimate, FloatMap, float, str]:
    """Solve a set; return surface, height, length of a pixel, and the unit of both lengths."""
    surface, height = solved_height(loaded)
    if loaded.mm_per_px is None:
        return surface, height, 1.0, "px, relative"
    height *= loaded.mm_per_px
    return surface, height, loaded.mm_per_px, "mm"


def write_ply(path: Path, height: FloatMap, albedo: FloatMap, per_px: float, unit: str) -> None:
    """Write a mesh with grey vertices and holes at NaN (Stanford PLY 1.0, little-endian).

    `height`, and `per_px`, the length of a pixel, are in `unit`.
    """
    is_finite = np.isfinite(height)
    white = float(np.percentile(albedo[is_finite], 99.5)) or 1.0
    positions, corners = _triangles(height, per_px)
    vertices = np.empty(len(positions), [("position", "<f4", 3), ("grey", "u1", 3)])
    vertices["position"] = positions
    grey = np.clip(255.0 / white * albedo[is_finite] + 0.5, 0.0, 255.0).astype(np.uint8)
    vertices["grey"] = grey[:, None]
    faces = np.empty(len(corners), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, corners
    header = "\n".join(
        [
            "ply", "format binary_little_endian 1.0", f"comment lengths in {unit}",
            f"element vertex {len(vertices)}",
            *(f"property float {name}" for name in "xyz"),
            *(f"property uchar {name}" for name in ("red", "green", "blue")),
            f"element face {len(faces)}", "property list uchar int vertex_indices",
            "end_header", "",
        ]
    )  # fmt: skip
    with durable_file(path) as temporary, temporary.open("wb") as file:
        file.write(header.encode("ascii"))
        file.write(vertices.tobytes())
        file.write(faces.tobytes())


def write_stl(path: Path, height: FloatMap, per_px: float, unit: str) -> None:
    """Write a mesh without colours (binary STL); its header names the unit. See `write_ply`."""
    positions, corners = _triangles(height, per_px)
    triangles = positions[corners]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    rows = np.zeros(len(triangles), [("vectors", "<f4", (4, 3)), ("attribute", "<u2")])
    rows["vectors"][:, 0], rows["vectors"][:, 1:] = normals, triangles
    with durable_file(path) as temporary, temporary.open("wb") as file:
        file.write(f"ps4rig height, lengths in {unit}".encode("ascii").ljust(80))
        file.write(np.uint32(len(rows)).astype("<u4").tobytes())
        file.write(rows.tobytes())


def _triangles(height: FloatMap, per_px: float) -> tuple[FloatMap, Array]:
    """(V, 3) positions of vertices from the middle of the frame, and (T, 3) indices of them."""
    rows, columns = height.shape
    positions = np.empty((rows, columns, 3), np.float32)
    positions[..., 0] = per_px * (np.arange(columns) - 0.5 * (columns - 1))
    positions[..., 1] = per_px * (0.5 * (rows - 1) - np.arange(rows))[:, None]
    positions[..., 2] = height
    is_finite = np.isfinite(height).ravel()
    corners = _corners(height.shape)
    vertex_of_pixel = np.cumsum(is_finite, dtype=np.int32) - 1
    corners = corners[is_finite[corners].all(axis=1)]
    return positions.reshape(-1, 3)[is_finite], vertex_of_pixel[corners]


def _corners(shape: tuple[int, ...]) -> Array:
    """(2 (H - 1)(W - 1), 3) pixels of the triangles, anticlockwise as seen by the camera."""
    rows, columns = shape
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    upper_left, upper_right = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    lower_left, lower_right = index[1:, :-1].ravel(), index[1:, 1:].ravel()
    lower = np.stack([lower_left, lower_right, upper_left], axis=1)
    upper = np.stack([upper_left, lower_right, upper_right], axis=1)
    return np.concatenate([lower, upper])
