"""Images of a solved surface under other lights."""

import numpy as np

from classify.base.arrays import FloatMap
from classify.lighting import Lighting
from classify.surface.estimate import SurfaceEstimate


def relight(surface: SurfaceEstimate, lighting: Lighting) -> FloatMap:
    """Images of the surface under any distant lights, without cast shadows.

    Lambert's law, i = intensity rho max(0, n . l): the forward model that `photometric_stereo`
    inverts (Wu's thesis, chapter 9). Pixels that face away from a light are black. There are no
    cast shadows and no highlights.

    Parameters
    ----------
    surface
        Its p, q and albedo are used. Pixels without a slope have p = q = 0 and are shown flat.
    lighting
        One light or more.

    Returns
    -------
    (N, H, W) float32 in the units of the albedo, in the order of the lights.

    Examples
    --------
    >>> from classify import photometric_stereo
    >>> lighting = Lighting.ring(slant_deg=45.0)
    >>> flat = (100 * lighting.directions[:, 2]).astype(np.float32)
    >>> surface = photometric_stereo(np.tile(flat[:, None, None], (1, 2, 2)), lighting)
    >>> above = relight(surface, Lighting.from_angles([0.0], 0.0))
    >>> above.shape, round(float(above[0, 0, 0]), 3)
    ((1, 2, 2), 100.0)
    """
    p, q = surface.p, surface.q
    scaled = surface.albedo / np.sqrt(1.0 + p * p + q * q)
    images = np.empty((len(lighting), *surface.shape), dtype=np.float32)
    for image, (x, y, z), intensity in zip(
        images, lighting.directions.tolist(), lighting.intensities.tolist(), strict=True
    ):
        np.maximum(z - x * p - y * q, 0.0, out=image)
        image *= scaled
        image *= intensity
    return images
