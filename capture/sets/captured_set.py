"""One captured set: the images of a surface under each light, and all that is known about them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from classify import Lighting, Method, SensorNoise, SurfaceEstimate, photometric_stereo
from classify.errors import InputError

from . import ome_tiff
from .metadata import SetMetadata, image_noise

__all__ = ["CapturedSet"]


@dataclass(frozen=True, eq=False)
class CapturedSet:
    """The images of one surface under each light, with their ambient image and metadata.

    Attributes
    ----------
    images
        (N, H, W) uint16 in the order of the lighting, as they came from the camera.
    ambient
        (H, W) uint16 with all lights out, or None.
    metadata
        `SetMetadata`.
    """

    images: npt.NDArray[np.uint16]
    ambient: npt.NDArray[np.uint16] | None
    metadata: SetMetadata

    def __post_init__(self) -> None:
        lights = len(self.metadata.lighting.directions)
        if self.images.ndim != 3 or self.images.dtype != np.uint16 or len(self.images) != lights:
            raise InputError(
                f"a set of {lights} lights needs ({lights}, rows, columns) uint16 images, "
                f"not {self.images.shape} {self.images.dtype}"
            )
        if self.ambient is not None and (
            self.ambient.shape != self.images.shape[1:] or self.ambient.dtype != np.uint16
        ):
            raise InputError(
                f"the ambient image is {self.ambient.shape} {self.ambient.dtype}, the light "
                f"images are {self.images.shape[1:]} uint16"
            )

    @property
    def label(self) -> str | None:
        """The class of the part, where it is known."""
        return self.metadata.label

    @property
    def lighting(self) -> Lighting:
        """The lights of the images."""
        return self.metadata.lighting.to_lighting()

    def solve(self, method: Method | None = None) -> SurfaceEstimate:
        """Gradients and albedo, ambient light subtracted; see `classify.photometric_stereo`.

        Without a method it is ps4_robust, or least_squares where there are more than four lights.
        """
        return photometric_stereo(
            self.images,
            self.lighting,
            method,
            ambient=self.ambient,
            full_scale=self.metadata.full_scale,
            noise=self.noise,
        )

    @property
    def noise(self) -> SensorNoise | None:
        """Noise of the images, from the camera's gain, read noise and black level; else None."""
        camera = self.metadata.camera
        if camera is None:
            return None
        frames = max((len(image.frames) for image in self.metadata.images), default=1) or 1
        return image_noise(camera, self.metadata.bit_depth, self.metadata.full_scale, frames)

    def save(self, path: str | Path) -> None:
        """Write one ``.ome.tif``; whole or not at all."""
        ome_tiff.write(Path(path), self.images, self.ambient, self.metadata)

    @staticmethod
    def load(path: str | Path) -> CapturedSet:
        """Read an ``.ome.tif``.

        Raises
        ------
        InputError
            If it is missing, truncated, changed since it was written, no captured set, or of a
            later version.
        """
        return CapturedSet(*ome_tiff.read(Path(path)))
