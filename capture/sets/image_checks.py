"""`LightImages`: images of a set, with the values that checks of captures and imports use."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import cv2
import numpy as np
import numpy.typing as npt

from classify import Lighting
from classify.base.arrays import Array
from classify.base.errors import InputError
from classify.calibration.calibration import Calibration
from classify.images import ImageStack, SensorNoise
from classify.lights.agreement import LightAgreement, light_agreement

# Columns that are compared before all of a row are.
_PROBED_COLUMNS = 8


@dataclass(frozen=True, eq=False)
class LightImages:
    """The images of one set, in the order of the lights, uint16 or `calibrated` float32."""

    images: Array
    ambient: Array
    later_ambient: Array | None  # taken between the lights
    lighting: Lighting
    names: Sequence[str]
    full_scale: float
    noise: SensorNoise | None

    @cached_property
    def ambient_mean(self) -> float:
        """Mean of the ambient image."""
        return _mean(self.ambient)

    @cached_property
    def signals(self) -> npt.NDArray[np.float64]:
        """(N,) mean of each light image above the ambient one."""
        return np.array([_mean(image) for image in self.images]) - self.ambient_mean

    def calibrated(self, calibration: Calibration) -> LightImages:
        """Return these images as under lights of equal strength over the whole frame."""
        stack = calibration.corrected(ImageStack(self.images, self.ambient), self.full_scale)
        lighting, full_scale = calibration.lighting_of(self.lighting), self.full_scale
        noise = calibration.noise_of(self.noise, has_ambient=True)
        if calibration.flat_field is not None:
            divisor = calibration.flat_field.facing(lighting)
            stack = divisor.divide(stack, full_scale)
            full_scale = float(divisor.saturation(full_scale))
            lighting = replace(lighting, intensities=np.ones(len(lighting)))
            noise = None  # it differs from place to place now, and is estimated from the images
        assert stack.ambient is not None
        return replace(
            self,
            images=stack.images,
            ambient=stack.ambient,
            later_ambient=None,
            lighting=lighting,
            full_scale=full_scale,
            noise=noise,
        )

    def saturated_shares(self) -> list[float]:
        """Share of saturated pixels in each light image."""
        return [np.count_nonzero(image >= self.full_scale) / image.size for image in self.images]

    def agreement(self) -> LightAgreement | None:
        """Agreement of the images; None without four lights in general position."""
        try:
            return light_agreement(
                self.images, self.lighting, self.ambient, self.full_scale, self.noise
            )
        except InputError:  # not four lights, or three of them in one plane
            return None

    def equal_rows(self) -> Iterator[tuple[str, str, int, int]]:
        """Pairs of light images with their numbers of equal and of comparable rows."""
        textured = [np.ptp(image, axis=1) > 1 for image in self.images]
        step = max(1, self.images.shape[2] // _PROBED_COLUMNS)
        for first, second in combinations(range(len(self.images)), 2):
            a, b = self.images[first], self.images[second]
            rows = np.flatnonzero(textured[second] & (a[:, ::step] == b[:, ::step]).all(axis=1))
            equal = int(np.count_nonzero((a[rows] == b[rows]).all(axis=1)))
            if equal:
                comparable = int(np.count_nonzero(textured[second]))
                yield self.names[first], self.names[second], equal, comparable


def _mean(image: Array) -> float:
    """``image.mean()``, in an eighth of its time."""
    return cv2.sumElems(image)[0] / image.size
