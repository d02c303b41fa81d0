"""Image sets to measure on: synthetic textures under the simulated camera."""

from dataclasses import replace

import numpy as np

from classify import Lighting
from classify.lights.near_light import coordinates_px, sheet_of
from rig import synthetic_surface
from rig.scene.render import SceneImages, render_frame, render_scene
from rig.scene.surfaces import SurfacePatch
from rig.scene.synthetic import SYNTHETIC_NAMES
from rig.simulation.sensor import SensorModel
from rig.simulation.simulated_set import SimulatedSet

SLANT_DEG = 50.0
"""Low enough for shadow: 7 % of the pixels of sand under each light."""

_LIGHTING = Lighting.ring(SLANT_DEG)
_TILE_PX = 512


def texture_tile(texture: str, seed: int, size_px: int) -> SimulatedSet:
    """A whole tile of a texture, 16 bit."""
    scene = _render_tile(texture, seed, size_px)
    return SimulatedSet.expose(scene, _LIGHTING, SensorModel(bit_depth=16), seed)


def rotated_patch(texture: str, seed: int, size_px: int, rotate_deg: float) -> SimulatedSet:
    """A patch of a texture, rotated anticlockwise, 16 bit."""
    surface = synthetic_surface(texture, seed, 2 * size_px)
    scene = render_frame(surface, _LIGHTING, size_px, rotate_deg)
    return SimulatedSet.expose(scene, _LIGHTING, SensorModel(bit_depth=16), seed)


def mosaic(shape: tuple[int, int], bits: int) -> SimulatedSet:
    """The four surfaces of the thesis side by side, repeated over a large frame.

    It has no ambient light and no ambient image, so that the solver reads only four images.
    """
    sensor = SensorModel(bit_depth=bits, black_level_fraction=0.0)
    tiles = []
    for texture in SYNTHETIC_NAMES:
        scene = _render_tile(texture, 0, _TILE_PX)
        dark = replace(scene, ambient=np.zeros_like(scene.ambient))
        tiles.append(SimulatedSet.expose(dark, _LIGHTING, sensor, seed=0))
    block = np.concatenate([tile.images for tile in tiles], axis=2)
    repeats = [-(-side // length) for side, length in zip(shape, block.shape[1:], strict=True)]
    images = np.tile(block, (1, *repeats))[:, : shape[0], : shape[1]]
    return replace(tiles[0], images=np.ascontiguousarray(images), ambient=None)


def under_near_lights(image_set: SimulatedSet, fields_of_view: float) -> SimulatedSet:
    """The same surface under lights at this distance; what was in shadow stays in shadow."""
    directions, (height, width) = image_set.lighting.directions, image_set.images.shape[1:]
    distance = fields_of_view * width
    lighting = Lighting.near(distance * directions)
    rows, columns = np.arange(height), np.arange(width)
    strengths = (
        sheet_of(lighting, (height, width))
        .without_cosines(lighting)
        .strengths(rows, columns, (height, width))
    )
    values = image_set.images.astype(np.float32)
    b = np.tensordot(np.linalg.pinv(directions).astype(np.float32), values, 1)
    x, y = coordinates_px((height, width))
    inner = b[0] * x + b[1] * y[:, None]
    near = np.where(values > 0.0, (values - inner / distance) * strengths, 0.0)
    images = np.clip(near, 0.0, image_set.full_scale).astype(image_set.images.dtype)
    return replace(image_set, images=images, lighting=lighting)


def _render_tile(texture: str, seed: int, size_px: int) -> SceneImages:
    surface = synthetic_surface(texture, seed, size_px)
    tile = SurfacePatch(surface.height, surface.p, surface.q, surface.albedo)
    return render_scene(tile, _LIGHTING)
