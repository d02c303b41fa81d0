"""How well a surface agrees with a reference at each orientation."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .orientation import refined_minima

# Agreement below which a texture determines no orientation; its rates on 52 textures are in
# tests/capture/session/test_orientation_flags.py.
LEAST_SHARPNESS = 0.45


@dataclass(frozen=True, eq=False)
class OrientationProfile:
    """Agreement of a surface with a reference, by orientation."""

    agreement: npt.NDArray[np.float64]  # (180,) at 0 to 179 degrees; 1 equal, 0 unrelated

    def best(self, near_deg: float = 0.0, within_deg: float = 90.0) -> tuple[float, float]:
        """Return the best orientation near `near_deg`, in [0, 180), and its agreement."""
        distance_deg = np.abs((np.arange(180) - near_deg + 90.0) % 180.0 - 90.0)
        allowed = np.where(distance_deg <= within_deg, self.agreement, -np.inf)
        index = int(np.argmax(allowed))
        # A parabola through a peak; the end of a slope is not refined.
        around = self.agreement[[index - 1, index, (index + 1) % 180]]
        if around.argmax() != 1:
            return float(index), float(around[1])
        offset, least = refined_minima(-around[None, :], np.zeros(1))
        return float((index - 1 + offset[0]) % 180.0), float(-least[0])
