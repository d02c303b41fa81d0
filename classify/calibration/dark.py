"""The camera without light: offset, hot pixels, noise of one frame."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from classify.errors import InputError


@dataclass(frozen=True, eq=False)
class Dark:
    """Offset, noise and hot pixels of a camera at one exposure and gain.

    All are in the pixel values of the camera.

    Attributes
    ----------
    offset
        Pixel value without light.
    noise
        Temporal standard deviation of a pixel in one frame.
    hot_pixels
        (n, 2) int32 row and column of pixels that do not follow the light.
    ambient
        Pixel value of the ambient light with all LEDs off, less `offset`; None if not measured.
    full_scale
        Pixel value of saturation to which the values above belong.

    Raises
    ------
    InputError
        For hot pixels of another shape or type, or a value out of range.
    """

    offset: float
    noise: float
    hot_pixels: npt.NDArray[np.int32]
    ambient: float | None
    full_scale: float

    def __post_init__(self) -> None:
        if not (0.0 < self.full_scale < np.inf and 0.0 <= self.offset < self.full_scale):
            raise InputError(
                f"dark offset {self.offset:g} of full scale {self.full_scale:g}; give "
                "an offset from 0 to below full scale"
            )
        if not 0.0 <= self.noise <= self.full_scale:
            raise InputError(
                f"dark noise {self.noise:g} of full scale {self.full_scale:g}; give 0 to full scale"
            )
        if self.ambient is not None and not abs(self.ambient) <= self.full_scale:
            raise InputError(
                f"ambient light {self.ambient:g} of full scale {self.full_scale:g}; give a value "
                "within full scale"
            )
        pixels = self.hot_pixels
        if pixels.ndim != 2 or pixels.shape[1] != 2 or pixels.dtype != np.int32:
            raise InputError(
                f"hot pixels are {pixels.shape} {pixels.dtype}; give (n, 2) int32 rows and columns"
            )
        if pixels.size and pixels.min() < 0:
            raise InputError(f"a hot pixel has the row or column {pixels.min()}")
