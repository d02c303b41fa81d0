"""What is measured on: the synthetic textures as the simulated rig's camera takes them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from classify import Lighting, Method, SurfaceEstimate, photometric_stereo
from classify.images.noise import SensorNoise
from rig import synthetic_surface
from rig.scene.render import SceneImages, render_frame, render_scene
from rig.scene.surfaces import SurfacePatch
from rig.scene.synthetic import SYNTHETIC_NAMES
from rig.simulation.sensor import SensorModel

__all__ = ["SLANT_DEG", "Shot", "mosaic", "patch", "turned_patch"]

SLANT_DEG = 50.0
"""Steep enough for shadows: of sand, 7 % of the pixels under each light."""

_EXPOSURE_MS = np.float32(20.0)
_TILE_PX = 512


@dataclass(frozen=True, eq=False)
class Shot:
    """Four images and perhaps an ambient frame, as a captured set hands them to the solver."""

    images: npt.NDArray[np.generic]
    ambient: npt.NDArray[np.generic] | None
    lighting: Lighting
    full_scale: float
    noise: SensorNoise

    def solve(self, method: Method = "ps4_robust") -> SurfaceEstimate:
        """As `CapturedSet.solve`."""
        return photometric_stereo(
            self.images,
            self.lighting,
            method,
            ambient=self.ambient,
            full_scale=self.full_scale,
            noise=self.noise,
        )


def patch(texture: str, seed: int, size_px: int) -> Shot:
    """A whole tile of a texture, 16 bit."""
    return _exposed(_tile(texture, seed, size_px), SensorModel(bit_depth=16), seed)


def turned_patch(texture: str, seed: int, size_px: int, rotate_deg: float) -> Shot:
    """A texture turned anticlockwise, 16 bit."""
    surface = synthetic_surface(texture, seed, 2 * size_px)
    scene = render_frame(surface, Lighting.ring(SLANT_DEG), size_px, rotate_deg)
    return _exposed(scene, SensorModel(bit_depth=16), seed)


def mosaic(shape: tuple[int, int], bits: int) -> Shot:
    """The four surfaces of the thesis side by side, again and again over a large frame.

    Without ambient light and its frame: the solver reads four planes.
    """
    sensor = SensorModel(bit_depth=bits, black_level_fraction=0.0)
    shots = []
    for texture in SYNTHETIC_NAMES:
        scene = _tile(texture, 0, _TILE_PX)
        dark = replace(scene, ambient=np.zeros_like(scene.ambient))
        shots.append(_exposed(dark, sensor, seed=0))
    block = np.concatenate([shot.images for shot in shots], axis=2)
    repeats = [-(-side // length) for side, length in zip(shape, block.shape[1:], strict=True)]
    images = np.tile(block, (1, *repeats))[:, : shape[0], : shape[1]]
    return replace(shots[0], images=np.ascontiguousarray(images), ambient=None)


def _tile(texture: str, seed: int, size_px: int) -> SceneImages:
    surface = synthetic_surface(texture, seed, size_px)
    tile = SurfacePatch(surface.height, surface.p, surface.q, surface.albedo)
    return render_scene(tile, Lighting.ring(SLANT_DEG))


def _exposed(scene: SceneImages, sensor: SensorModel, seed: int) -> Shot:
    expose = partial(sensor.expose, rng=np.random.default_rng(seed))
    return Shot(
        np.stack([expose((light + scene.ambient) * _EXPOSURE_MS) for light in scene.lights]),
        expose(scene.ambient * _EXPOSURE_MS),
        Lighting.ring(SLANT_DEG),
        float(sensor.full_scale_dn),
        SensorNoise(sensor.gain_e_per_dn, sensor.read_noise_dn, sensor.black_level_dn),
    )
