"""The noise of a linear camera, measured by photon transfer."""

from dataclasses import dataclass

from classify.base.errors import InputError
from classify.images.noise import SensorNoise


@dataclass(frozen=True)
class Noise:
    """Shot and read noise of a camera, in its own pixel values."""

    sensor: SensorNoise
    error: float  # rms error of the fitted variance, as a share of it

    def __post_init__(self) -> None:
        if not 0.0 <= self.error < float("inf"):
            raise InputError(f"the noise has an error of {self.error:g}; give a share of 0 or more")
