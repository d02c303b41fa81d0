"""How well a surface agrees with a reference at each orientation."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .orientation import refined_minima


@dataclass(frozen=True, eq=False)
class OrientationProfile:
    """Agreement of a surface with a reference, by orientation.

    It has one peak for most directional textures, two equal ones for a weave that looks the same
    after a quarter turn, and many low ones for a texture without direction.

    Attributes
    ----------
    agreement
        (180,) float64 for orientations of 0 to 179 degrees, anticlockwise: 1 where both are equal,
        0 as for unrelated surfaces.
    """

    agreement: npt.NDArray[np.float64]

    def best(self, near_deg: float = 0.0, within_deg: float = 90.0) -> tuple[float, float]:
        """Return the best orientation in degrees, [0, 180), and its agreement.

        Only orientations within `within_deg` of `near_deg` count.
        """
        distance_deg = np.abs((np.arange(180) - near_deg + 90.0) % 180.0 - 90.0)
        allowed = np.where(distance_deg <= within_deg, self.agreement, -np.inf)
        index = int(np.argmax(allowed))
        # A parabola through a peak; the end of a slope is not refined.
        around = self.agreement[[index - 1, index, (index + 1) % 180]]
        if around.argmax() != 1:
            return float(index), float(around[1])
        offset, least = refined_minima(-around[None, :], np.zeros(1))
        return float((index - 1 + offset[0]) % 180.0), float(-least[0])
