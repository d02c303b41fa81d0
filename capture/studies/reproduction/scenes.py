"""Images of a texture, turned and lit, as the simulated rig's camera would take them."""

from __future__ import annotations

import zlib
from collections.abc import Hashable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from classify import Lighting, Method, SurfaceEstimate, photometric_stereo
from classify.classifiers import Observation, classifier_named
from classify.images.noise import SensorNoise
from rig import synthetic_surface
from rig.scene.material_folder import load_material
from rig.scene.render import SceneImages, render_frame
from rig.scene.surfaces import PeriodicSurface
from rig.simulation.sensor import SensorModel

__all__ = ["Conditions", "Patch", "Place", "Shot", "Texture", "expose", "render", "solve"]

EXPOSURE_MS = 20.0
_OF_THE_THESIS = ("ps3a", "ps3b", "ps3c", "ps3d", "ps4")
WEAK_LED = 1
"""Of the four, the one whose light `Conditions.weak_led` scales."""


@dataclass(frozen=True)
class Texture:
    """A synthetic texture by its name, or a scanned material in its folder."""

    name: str
    folder: Path | None = None


@dataclass(frozen=True)
class Place:
    """Where the camera looks, and how the part lies.

    Attributes
    ----------
    seed
        Realisation of a synthetic texture.
    elsewhere
        Of a material, which is one tile: whether the patch lies half a tile away.
    rotate_deg
        How far the part is turned, anticlockwise.
    """

    texture: Texture
    seed: int
    elsewhere: bool
    rotate_deg: float


@dataclass(frozen=True)
class Conditions:
    """How a patch is lit and taken.

    Attributes
    ----------
    size_px
        Side of the frame; smaller frames are the middle of larger ones.
    shadows
        Without, light passes through the relief and reaches what faces away from it too, as
        negative light: no shadow of either kind. No camera can take that.
    exposure
        Relative to the 20 ms that fill 85 % of the well for white.
    weak_led
        Output of the second LED; the solver is not told.
    """

    slant_deg: float
    size_px: int
    bits: int = 12
    shadows: bool = True
    exposure: float = 1.0
    weak_led: float = 1.0


@dataclass(frozen=True, eq=False)
class Shot:
    """What a solver gets of a patch: pixel values, and the lights as it believes them to be."""

    images: npt.NDArray[np.generic]
    ambient: npt.NDArray[np.generic]
    lighting: Lighting
    full_scale: float
    noise: SensorNoise | None


@lru_cache(maxsize=2)
def surface_of(texture: Texture, seed: int, tile_px: int) -> PeriodicSurface:
    """The surface that patches are cut from."""
    if texture.folder is not None:
        return load_material(texture.folder)
    return synthetic_surface(texture.name, seed, tile_px)


def render(place: Place, slant_deg: float, size_px: int) -> SceneImages:
    """The ideal images of a patch of `size_px` under the ring of four lights."""
    surface = surface_of(place.texture, place.seed, 2 * size_px)
    rows, columns = surface.height.shape
    shift_px = (columns / 2.0, rows / 2.0) if place.elsewhere else (0.0, 0.0)
    return render_frame(
        surface, Lighting.ring(slant_deg), size_px, place.rotate_deg, shift_px=shift_px
    )


def expose(scene: SceneImages, conditions: Conditions, seed: int) -> Shot:
    """The pixel values of a scene, with shot and read noise of the rig's sensor model."""
    sensor = SensorModel(bit_depth=conditions.bits)
    lighting = Lighting.ring(conditions.slant_deg)
    lights = scene.lights if conditions.shadows else _unshadowed(scene, lighting)
    outputs = np.ones(len(lighting), np.float32)
    outputs[WEAK_LED] = conditions.weak_led
    exposure_ms = np.float32(EXPOSURE_MS * conditions.exposure)
    take = sensor.expose if conditions.shadows else partial(_unclipped, sensor)
    rng = np.random.default_rng(seed)
    ambient = take(scene.ambient * exposure_ms, rng)
    images = [
        take((light * output + scene.ambient) * exposure_ms, rng)
        for light, output in zip(lights, outputs, strict=True)
    ]
    noise = SensorNoise(sensor.gain_e_per_dn, sensor.read_noise_dn, sensor.black_level_dn)
    return Shot(
        np.stack(images),
        ambient,
        lighting,
        float(sensor.full_scale_dn),
        noise if conditions.shadows else None,
    )


def solve(shot: Shot, method: Method) -> SurfaceEstimate:
    """What a solver makes of it, told all that a captured set tells.

    PS3 and PS4 are those of the thesis: every pixel counts, also where a shadow shows that its
    slope cannot be known. Our engine would leave such pixels out.
    """
    surface = photometric_stereo(
        shot.images,
        shot.lighting,
        method,
        ambient=shot.ambient,
        full_scale=shot.full_scale,
        noise=shot.noise,
    )
    if method in _OF_THE_THESIS:
        return replace(surface, valid=~surface.saturated)
    return surface


def _unshadowed(scene: SceneImages, lighting: Lighting) -> npt.NDArray[np.float32]:
    """Lambert's law without its clamp at zero: i = rho n . l, whatever its sign."""
    scaled = scene.albedo / np.sqrt(1.0 + scene.p**2 + scene.q**2)
    x, y, z = lighting.directions.astype(np.float32).T[:, :, None, None]
    images: npt.NDArray[np.float32] = scaled * (z - x * scene.p - y * scene.q)
    return images


def _unclipped(
    sensor: SensorModel, light_ms: npt.NDArray[np.float32], rng: np.random.Generator
) -> npt.NDArray[np.float32]:
    """The sensor's noise and units on light of either sign; nothing is clipped or rounded."""
    signal = light_ms * np.float32(sensor.white_e_per_ms)
    noise = rng.standard_normal(signal.shape, dtype=np.float32)
    noise *= np.sqrt(np.abs(signal) + np.float32(sensor.read_noise_e**2))
    return (signal + noise) * np.float32(1.0 / sensor.gain_e_per_dn)


class Patch:
    """One place under any conditions; each scene, solution and observation is made once.

    `frame_px` is the side of the largest frame that will be asked for.
    """

    def __init__(self, place: Place, frame_px: int) -> None:
        self.place = place
        self._frame_px = frame_px
        self._scenes: dict[float, SceneImages] = {}
        self._estimates: dict[tuple[Conditions, Method], SurfaceEstimate] = {}
        self._observations: dict[Hashable, Observation] = {}

    def estimate(self, conditions: Conditions, method: Method) -> SurfaceEstimate:
        """The surface as a solver finds it."""
        key = (conditions, method)
        if key not in self._estimates:
            self._estimates[key] = solve(self.shot(conditions), method)
        return self._estimates[key]

    def observation(
        self, conditions: Conditions, method: Method, classifier: str, segment_px: int, train: bool
    ) -> Observation:
        """What a classifier keeps of it; those that look at the same share one."""
        how = classifier_named(classifier)
        observe = how.observe_training if train else how.observe
        key = (conditions, method, observe, segment_px)
        if key not in self._observations:
            self._observations[key] = observe(self.estimate(conditions, method), segment_px)
        return self._observations[key]

    def shot(self, conditions: Conditions) -> Shot:
        """Its images. The noise depends on the place and the conditions alone."""
        slant_deg = conditions.slant_deg
        if slant_deg not in self._scenes:
            self._scenes[slant_deg] = render(self.place, slant_deg, self._frame_px)
        scene = self._scenes[slant_deg].cropped(conditions.size_px, conditions.size_px)
        place = replace(self.place, texture=Texture(self.place.texture.name))
        return expose(scene, conditions, zlib.crc32(f"{place} {conditions}".encode()))
