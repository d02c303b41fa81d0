"""How noisy a set of images is, from the images alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from .lighting import Lighting

__all__ = ["noise_of_images"]

_MAX_SAMPLES = 16_384
_GROUPS = 4
# Fewer have a median that is itself mostly chance.
_GROUP_SAMPLES = 256
# rms of rounding to whole numbers
_ROUNDING = 1.0 / np.sqrt(12.0)


def noise_of_images(
    images: npt.NDArray[Any],
    ambient: npt.NDArray[Any] | None,
    gains: npt.NDArray[np.float32],
    lighting: Lighting,
) -> float:
    """Standard deviation of a pixel, in units of images times gains.

    N lights leave N - 3 combinations in which a Lambertian surface without shadow cancels out,
    whatever its shape and albedo. What is left there is noise, but also shadow, gloss and lights
    of unequal strength. The first is everywhere, the others here and there or in proportion to
    brightness: so pixels are put into groups by brightness, the median of a group takes no notice
    of its smaller part, and the group with the least is taken. Three lights have no such
    combination: then only the rounding of the pixel values is known.

    Parameters
    ----------
    images
        (N, H, W) uint8, uint16 or float32.
    ambient
        (H, W), subtracted, or None.
    gains
        (N,) factors of the images.
    """
    rounding = 0.0 if images.dtype.kind == "f" else float(gains.max()) * _ROUNDING
    freedom = len(lighting) - 3
    if freedom < 1:
        return rounding
    step = max(1, int(np.ceil(np.sqrt(images[0].size / _MAX_SAMPLES))))
    grid = np.s_[::step, ::step]
    values = images[(slice(None), *grid)].astype(np.float32)
    if ambient is not None:
        values -= ambient[grid].astype(np.float32)
    values *= gains[:, None, None]
    # The left null space of L: rows of orthonormal combinations that cancel.
    cancelling = np.linalg.svd(lighting.directions.T)[2][3:].astype(np.float32)
    left_over = np.tensordot(cancelling, values, axes=1)
    energies = np.square(left_over).sum(axis=0).ravel()
    by_brightness = energies[np.argsort(values.sum(axis=0), axis=None)]
    groups = np.array_split(by_brightness, min(_GROUPS, max(1, energies.size // _GROUP_SAMPLES)))
    energy = min(float(np.median(group)) for group in groups)
    # Median of chi-squared (Wilson and Hilferty), within 4 % from one degree of freedom on.
    median = freedom * (1.0 - 2.0 / (9.0 * freedom)) ** 3
    return max(rounding, float(np.sqrt(energy / median)))
