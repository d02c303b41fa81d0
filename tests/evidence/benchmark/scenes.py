"""Image sets to measure on: synthetic textures under the simulated camera."""

from classify import Lighting
from rig import synthetic_surface
from rig.scene.render import render_frame, render_scene
from rig.scene.surfaces import SurfacePatch
from rig.simulation.sensor import SensorModel
from rig.simulation.simulated_set import SimulatedSet

SLANT_DEG = 50.0
"""Low enough for shadow: 7 % of the pixels of sand under each light."""

_LIGHTING = Lighting.ring(SLANT_DEG)


def texture_tile(texture: str, seed: int, size_px: int) -> SimulatedSet:
    """A whole tile of a texture, 16 bit."""
    surface = synthetic_surface(texture, seed, size_px)
    tile = SurfacePatch(surface.height, surface.p, surface.q, surface.albedo)
    scene = render_scene(tile, _LIGHTING)
    return SimulatedSet.expose(scene, _LIGHTING, SensorModel(bit_depth=16), seed)


def rotated_patch(texture: str, seed: int, size_px: int, rotate_deg: float) -> SimulatedSet:
    """A patch of a texture, rotated anticlockwise, 16 bit."""
    surface = synthetic_surface(texture, seed, 2 * size_px)
    scene = render_frame(surface, _LIGHTING, size_px, rotate_deg)
    return SimulatedSet.expose(scene, _LIGHTING, SensorModel(bit_depth=16), seed)
