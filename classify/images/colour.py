"""From display colours to linear light."""

import numpy as np
import numpy.typing as npt

_BT709_WEIGHTS = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)


def linear_from_srgb(values: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Linear light, float32 from 0 to 1, of sRGB values from 0 to 1 (IEC 61966-2-1)."""
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    return linear.astype(np.float32)


def luminance(rgb: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """(H, W) luminance of linear red, green, blue (H, W, 3) float32 (ITU-R BT.709)."""
    return np.asarray(rgb @ _BT709_WEIGHTS, np.float32)
