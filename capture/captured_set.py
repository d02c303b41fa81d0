"""One captured set: the images of a surface under each light, and all that is known about them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from classify import Lighting, Method, SurfaceEstimate, photometric_stereo
from classify.errors import InputError

from . import set_file
from .set_metadata import SetMetadata

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

        Without a method it is PS4, or least squares where there are more than its four lights.
        """
        if method is None:
            method = "least_squares" if len(self.images) > 4 else "ps4"
        return photometric_stereo(
            self.images,
            self.lighting,
            method,
            ambient=self.ambient,
            full_scale=self.metadata.full_scale,
        )

    def save(self, path: str | Path) -> None:
        """Write one ``.ome.tif``; whole or not at all."""
        set_file.write(Path(path), self.images, self.ambient, self.metadata)

    @staticmethod
    def load(path: str | Path) -> CapturedSet:
        """Read an ``.ome.tif``.

        Raises
        ------
        InputError
            If it is missing, truncated, changed since it was written, no captured set, or of a
            later version.
        """
        return CapturedSet(*set_file.read(Path(path)))
