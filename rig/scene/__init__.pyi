from .material_folder import bundled_materials, load_material
from .render import SceneImages, render_frame, render_scene
from .surfaces import FloatImage, PeriodicSurface, SurfacePatch
from .synthetic import (
    EQUAL_SPECTRUM_TWINS,
    SYNTHETIC_30,
    SYNTHETIC_NAMES,
    SYNTHETIC_TEXTURES,
    synthetic_surface,
    tile_side_px,
)

__all__ = [
    "EQUAL_SPECTRUM_TWINS",
    "SYNTHETIC_30",
    "SYNTHETIC_NAMES",
    "SYNTHETIC_TEXTURES",
    "FloatImage",
    "PeriodicSurface",
    "SceneImages",
    "SurfacePatch",
    "bundled_materials",
    "load_material",
    "render_frame",
    "render_scene",
    "synthetic_surface",
    "tile_side_px",
]
