"""The noise of a linear camera, measured by photon transfer."""

from dataclasses import dataclass

from classify.errors import InputError
from classify.images.noise import SensorNoise


@dataclass(frozen=True)
class Noise:
    """Shot and read noise of a camera.

    Attributes
    ----------
    sensor
        The noise in the camera's own pixel values.
    error
        rms error of the fitted variance, as a share of it.

    Raises
    ------
    InputError
        If the error is negative or not finite.
    """

    sensor: SensorNoise
    error: float

    def __post_init__(self) -> None:
        if not 0.0 <= self.error < float("inf"):
            raise InputError(f"the noise has an error of {self.error:g}; give a share of 0 or more")
