"""One captured set: the images of a surface under each light, and their metadata."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from classify import Lighting, Method, SensorNoise, SurfaceEstimate, photometric_stereo
from classify.calibration.calibration import Calibration
from classify.errors import InputError
from classify.images.stack import ImageStack

from . import ome_tiff
from .metadata import SetMetadata, image_noise


@dataclass(frozen=True, eq=False)
class CapturedSet:
    """The images of one surface under each light, with their ambient image and metadata.

    Attributes
    ----------
    images
        (N, H, W) uint16 light images in the order of the lighting; pixel values of the camera.
    ambient
        (H, W) uint16 image with all LEDs off, or None.
    mask
        (H, W) bool, false outside the part, where no pixel is valid; None for the whole frame.

    Raises
    ------
    InputError
        If shapes or dtypes differ from these.
    """

    images: npt.NDArray[np.uint16]
    ambient: npt.NDArray[np.uint16] | None
    metadata: SetMetadata
    mask: npt.NDArray[np.bool_] | None = None

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
        if self.mask is not None and (
            self.mask.shape != self.images.shape[1:] or self.mask.dtype != np.bool_
        ):
            raise InputError(
                f"the mask is {self.mask.shape} {self.mask.dtype}, the light images are "
                f"{self.images.shape[1:]}; give bool of that shape"
            )
        if (self.mask is None) != (self.metadata.mask_file is None):
            has = "no mask" if self.mask is None else "a mask"
            raise InputError(
                f"the set has {has}, but mask_file in its metadata is {self.metadata.mask_file!r}"
            )

    @property
    def label(self) -> str | None:
        """Class of the part, None if unknown."""
        return self.metadata.label

    @property
    def lighting(self) -> Lighting:
        """The lights of the images."""
        return self.metadata.lighting.to_lighting()

    def solve(
        self,
        method: Method | None = None,
        *,
        planar: bool = False,
        calibration: Calibration | None = None,
        on_progress: Callable[[float], None] | None = None,
    ) -> SurfaceEstimate:
        """Solve for gradients and albedo, with ambient light subtracted.

        See `classify.photometric_stereo`. The default method is ps4_robust for four lights, else
        least_squares. No pixel outside the mask is valid. With a calibration of this rig,
        the images are corrected and divided by its flat field, and its lights and noise are used.
        """
        known, full_scale = calibration or Calibration(), self.metadata.full_scale
        stack = known.corrected(ImageStack(self.images, self.ambient), full_scale)
        return photometric_stereo(
            stack.images, known.lighting_of(self.lighting), method, ambient=stack.ambient,
            full_scale=full_scale, noise=self.noise_with(known), planar=planar,
            mask=None if self.mask is None else known.corrected_mask(self.mask),
            flat_field=known.flat_field, on_progress=on_progress,
            lobe_exponent=None if known.lights is None else known.lights.lobe_exponent,
        )  # fmt: skip

    @property
    def noise(self) -> SensorNoise | None:
        """Noise of the images; None if the camera's gain or read noise is unknown."""
        return self.noise_with(Calibration())

    def noise_with(self, calibration: Calibration) -> SensorNoise | None:
        """Noise of the images as a calibration corrects them; None if it is unknown."""
        metadata = self.metadata
        sensor = None if metadata.camera is None else metadata.camera.noise
        if calibration.noise is not None:
            sensor = calibration.noise.sensor
        frames = max((len(image.frames) for image in metadata.images), default=1) or 1
        noise = image_noise(sensor, metadata.bit_depth, metadata.full_scale, frames)
        return calibration.noise_of(noise, has_ambient=self.ambient is not None)

    def save(self, path: str | Path, *, home: Path | None = None) -> None:
        """Write an ``.ome.tif``, whole or not at all; an existing file is replaced.

        `home` is another folder of the same file system for the temporary file; see `durable_file`.

        Raises
        ------
        InputError
            If the name does not end in ``.ome.tif``, or the file cannot be written.
        """
        ome_tiff.write(Path(path), self.images, self.ambient, self.metadata, self.mask, home)

    @staticmethod
    def load(path: str | Path) -> CapturedSet:
        """Read an ``.ome.tif``.

        Raises
        ------
        InputError
            If the file is missing, truncated, changed since it was written, not a captured set, or
            of a later version.
        """
        return CapturedSet(*ome_tiff.read(Path(path)))
