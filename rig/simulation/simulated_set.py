"""One image set of a rendered scene, without timing: for studies and tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from classify import Lighting, Method, SensorNoise, SurfaceEstimate, photometric_stereo
from classify.base.arrays import Array
from rig.scene.render import SceneImages

from .sensor import SensorModel

EXPOSURE_MS = 20.0
"""Exposure at which a white surface facing an LED fills 85 % of the default sensor's well."""


@dataclass(frozen=True, eq=False)
class SimulatedSet:
    """The light images and ambient image of a scene, with the data for a solver."""

    images: Array  # (N, H, W) pixel values
    ambient: Array | None  # (H, W)
    lighting: Lighting  # assumed by the solver
    full_scale: float  # highest pixel value of the sensor
    noise: SensorNoise | None  # None if exposed with `shadows=False`

    @classmethod
    def expose(
        cls,
        scene: SceneImages,
        lighting: Lighting,
        sensor: SensorModel,
        seed: int,
        *,
        exposure_ms: float = EXPOSURE_MS,
        led_levels: npt.ArrayLike | None = None,
        shadows: bool = True,
    ) -> SimulatedSet:
        """Expose one image under each light, then the ambient image.

        Without `shadows`, there is no noise and no saturation either.
        """
        rng = np.random.default_rng(seed)
        expose = sensor.expose if shadows else sensor.expose_unclipped
        lit_scene = scene if shadows else scene.without_shadow(lighting)
        levels = np.ones(len(lighting)) if led_levels is None else np.asarray(led_levels)
        time_ms = np.float32(exposure_ms)
        images = [
            expose((light * np.float32(level) + scene.ambient) * time_ms, rng)
            for light, level in zip(lit_scene.lights, levels, strict=True)
        ]
        ambient = expose(scene.ambient * time_ms, rng)
        noise = SensorNoise(sensor.gain_e_per_dn, sensor.read_noise_dn, sensor.black_level_dn)
        return cls(
            np.stack(images),
            ambient,
            lighting,
            float(sensor.full_scale_dn),
            noise if shadows else None,
        )

    def solve(self, method: Method | None = None, *, planar: bool = False) -> SurfaceEstimate:
        """Gradients and albedo, as `CapturedSet.solve` computes them."""
        return photometric_stereo(
            self.images,
            self.lighting,
            method,
            ambient=self.ambient,
            full_scale=self.full_scale,
            noise=self.noise,
            planar=planar,
        )
