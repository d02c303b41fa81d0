"""The response of a camera: linear light as a function of its pixel value."""

from dataclasses import dataclass

import numpy as np

from classify.base.arrays import Array, FloatMap, Floats
from classify.base.errors import InputError

STEPS = 256


@dataclass(frozen=True, eq=False)
class Response:
    """Linear light for each pixel value of a camera."""

    curve: Floats  # (257,) light, 0 to 1, at k/256 of full scale; never falls
    error: float  # rms error of `curve`, as a share of full scale
    linear: bool  # whether pixel values count as linear, and `curve` is not applied

    def __post_init__(self) -> None:
        curve = self.curve
        if curve.shape != (STEPS + 1,) or curve.dtype != np.float64:
            raise InputError(
                f"the response is {curve.shape} {curve.dtype}; give ({STEPS + 1},) float64"
            )
        if not (np.diff(curve) >= 0.0).all() or not 0.0 <= curve[0] < curve[-1] == 1.0:
            raise InputError(
                f"the response goes from {curve[0]:g} to {curve[-1]:g}; give values that start at "
                "0 or above, never fall and end at 1"
            )
        if not 0.0 <= self.error < np.inf:
            raise InputError(f"the response has an error of {self.error:g}; give a share of 0 to 1")

    def linearise(self, image: Array, full_scale: float) -> FloatMap:
        """Pixel values of any shape as linear light with the same full scale, by `curve`."""
        levels = np.linspace(0.0, full_scale, STEPS + 1)
        if image.dtype.kind == "u":
            # By a table for all values of the type, a tenth of the time of interpolation.
            values = np.arange(np.iinfo(image.dtype).max + 1)
            table = np.interp(values, levels, full_scale * self.curve).astype(np.float32)
            return table.take(image)
        return np.asarray(np.interp(image, levels, full_scale * self.curve), np.float32)
