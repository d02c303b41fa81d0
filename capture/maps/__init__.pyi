from .files import write_maps
from .page import map_page
from .surface_maps import SurfaceMaps
from .views import map_views

__all__ = [
    "SurfaceMaps",
    "map_page",
    "map_views",
    "write_maps",
]
