"""The images of one set as values of the checks that captures and imports share."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt

from classify import Lighting
from classify.images.noise import SensorNoise

Images = npt.NDArray[np.uint16]

# Columns that are compared before all of a row are.
_PROBED_COLUMNS = 8


@dataclass(frozen=True, eq=False)
class LightImages:
    """The images of one set, in the order of the lights.

    Attributes
    ----------
    images
        (N, H, W).
    ambient, later_ambient
        (H, W) with all LEDs off, before the lights and between them; the later one may be None.
    lighting, names
        The lights, and their names in messages.
    full_scale, noise
        Pixel value of saturation; noise model of the images, None if unknown.
    """

    images: Images
    ambient: Images
    later_ambient: Images | None
    lighting: Lighting
    names: Sequence[str]
    full_scale: int
    noise: SensorNoise | None

    def signals(self) -> npt.NDArray[np.float64]:
        """(N,) mean of each light image above the ambient one."""
        signals: npt.NDArray[np.float64] = self.images.mean(axis=(1, 2)) - self.ambient.mean()
        return signals

    def saturated_shares(self) -> list[float]:
        """Share of saturated pixels in each light image."""
        return [float(np.mean(image >= self.full_scale)) for image in self.images]

    def equal_rows(self) -> Iterator[tuple[str, str, int, int]]:
        """Names of two light images with equal rows, the number of these and of comparable rows.

        Noise differs from frame to frame, so that a row that is equal in two images is from one
        frame. Rows of one value cannot be compared.
        """
        textured = [np.ptp(image, axis=1) > 1 for image in self.images]
        step = max(1, self.images.shape[2] // _PROBED_COLUMNS)
        for first, second in combinations(range(len(self.images)), 2):
            a, b = self.images[first], self.images[second]
            rows = np.flatnonzero(textured[second] & (a[:, ::step] == b[:, ::step]).all(axis=1))
            equal = int(np.count_nonzero((a[rows] == b[rows]).all(axis=1)))
            if equal:
                comparable = int(np.count_nonzero(textured[second]))
                yield self.names[first], self.names[second], equal, comparable
