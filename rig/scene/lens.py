"""The effects of a lens on ideal images: blur out of focus, and vignetting."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from .render import SceneImages
from .surfaces import FloatImage


@dataclass(frozen=True)
class Lens:
    """A lens with faults; the default has none."""

    blur_px: float = 0.0  # standard deviation of the Gaussian
    # share missing in the corners; it grows with the squared distance from the centre
    vignetting: float = 0.0

    def images(self, scene: SceneImages) -> SceneImages:
        """The images of a scene through this lens; slopes, albedo and shadow stay the true ones."""
        lights = np.stack([self._image(light) for light in scene.lights])
        return replace(scene, lights=lights, ambient=self._image(scene.ambient))

    def _image(self, ideal: FloatImage) -> FloatImage:
        image = ideal
        if self.blur_px > 0.0:
            blurred = cv2.GaussianBlur(ideal, (0, 0), self.blur_px)
            image = np.asarray(blurred, np.float32)
        sides = np.array(ideal.shape, np.float64) - 1.0
        # Coordinates whose squared length is 2 in the corners.
        scales = (sides / np.sqrt(np.mean(sides**2))).astype(np.float32)
        rows, cols = (
            scale * np.linspace(-1.0, 1.0, side, dtype=np.float32)
            for side, scale in zip(ideal.shape, scales, strict=True)
        )
        darker = np.float32(0.5 * self.vignetting) * (rows[:, None] ** 2 + cols**2)
        return np.asarray(image * (1.0 - darker), np.float32)
