from .curvature import CURVATURE_SCALE_PX, Curvature, surface_curvature
from .height import integrate_gradients
from .local_height import default_cutoff_px, local_relief
from .relighting import relight
from .roughness import Roughness, surface_roughness
from .shadows import cast_shadow

__all__ = [
    "CURVATURE_SCALE_PX",
    "Curvature",
    "Roughness",
    "cast_shadow",
    "default_cutoff_px",
    "integrate_gradients",
    "local_relief",
    "relight",
    "surface_curvature",
    "surface_roughness",
]
