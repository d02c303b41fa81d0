"""What a window of a part looks like: energies and directions of its octaves."""

import cv2
import numpy as np

from classify.base.compiling import Array
from classify.surface.estimate import FloatMap

from .moments import MOMENTS, OCTAVES, PRODUCTS

FEATURES = 2 + 6 * OCTAVES + 2
"""Number of features of a window, see `window_features`."""
DIRECTIONS = tuple(2 + 6 * octave + k for octave in range(OCTAVES) for k in (1, 2, 3, 4))
"""The features that depend on the orientation of the texture."""

# Columns of energies of slopes, and of log albedo, in the moments.
_SLOPES = (0, *(2 + PRODUCTS * octave for octave in range(OCTAVES)))
_ALBEDOS = (1, *(7 + PRODUCTS * octave for octave in range(OCTAVES)))
# Floor of the energies, as a share of their mean in good parts, so that the log energy of a window
# without texture does not depend on its noise.
_FLOOR_SHARE = 0.005
_LEAST_ENERGY = 1e-6


def energy_columns() -> list[int]:
    """Columns of the moments with energies: of slopes in each octave, then of log albedo."""
    return [*_SLOPES, *_ALBEDOS]


def energy_floors(mean_moments: FloatMap) -> FloatMap:
    """(MOMENTS,) floors that are added to energies, from the mean moments of good parts."""
    floors = np.zeros(MOMENTS, np.float32)
    energies = energy_columns()
    floors[energies] = _FLOOR_SHARE * mean_moments[energies] + _LEAST_ENERGY
    return floors


def coarser(moments: FloatMap) -> FloatMap:
    """Means over 2 x 2 cells."""
    means: Array = cv2.blur(moments, (2, 2), anchor=(0, 0))
    return np.ascontiguousarray(means[::2, ::2], np.float32)


def window_moments(moments: FloatMap, cells: int) -> FloatMap:
    """(h, w, MOMENTS) means over windows of that many cells, which half overlap if they can.

    A part that is no multiple of half a window keeps a margin without windows at its far sides.
    """
    means = cv2.blur(moments, (cells, cells), anchor=(0, 0), borderType=cv2.BORDER_REPLICATE)
    rows, columns = (side - cells + 1 for side in moments.shape[:2])
    step = max(cells // 2, 1)
    return np.ascontiguousarray(means[:rows:step, :columns:step])


def window_features(moments: FloatMap, floors: FloatMap, orientation_deg: float) -> FloatMap:
    """(n, FEATURES) float32 features of (..., MOMENTS) moments, in the frame of the texture.

    Logarithms of the root mean square of slopes and log albedo in the finest octave; for each other
    octave that of the slopes, their second and fourth harmonics over their direction, and that of
    the log albedo; the mean of the log albedo, and the mean slope.
    """
    flat = np.moveaxis(moments.reshape(-1, MOMENTS) + floors, -1, 0)
    half = np.float32(0.5)
    features = [half * np.log(np.maximum(flat[k], _LEAST_ENERGY)) for k in (0, 1)]
    turns = [np.exp(-1j * n * np.radians(orientation_deg)).astype(np.complex64) for n in (2, 4)]
    for octave in range(OCTAVES):
        energy, *parts, albedo, _, _ = flat[2 + PRODUCTS * octave :][:PRODUCTS]
        features.append(half * np.log(energy))
        for turn, (even, odd) in zip(turns, (parts[:2], parts[2:]), strict=True):
            features += [
                (turn.real * even - turn.imag * odd) / energy,
                (turn.real * odd + turn.imag * even) / energy,
            ]
        features.append(half * np.log(albedo))
    p, q, level = flat[-3:]
    features += [level, np.hypot(p, q)]
    return np.stack(features, axis=-1)
