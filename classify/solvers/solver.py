"""`photometric_stereo`: images under known lights to a `SurfaceEstimate`."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from classify.errors import InputError
from classify.images.noise import SensorNoise, noise_of_images, noise_of_sensor
from classify.images.stack import Images, checked_ambient, checked_stack
from classify.lighting import Lighting
from classify.lights.algebra import (
    drop_one_constants,
    drop_two_inverses,
    least_squares_weights,
    three_of_ring,
)
from classify.lights.balance import light_balance
from classify.methods import METHODS, Method
from classify.shadow_rule import NO_DROPPED_LIGHT
from classify.surface.estimate import SurfaceEstimate

from . import robust
from .drbohlav import drbohlav, gates
from .in_fill import in_fill
from .linear import linear
from .ps4 import drop_darkest
from .rushmeier import rushmeier

__all__ = ["photometric_stereo"]

# A slope known no better than this is not worth having: most surfaces are flatter.
_MAX_SLOPE_ERROR = 0.5


def photometric_stereo(
    images: Images,
    lighting: Lighting,
    method: Method | None = None,
    *,
    ambient: npt.NDArray[Any] | None = None,
    full_scale: float | None = None,
    noise: SensorNoise | None = None,
) -> SurfaceEstimate:
    """Gradients and albedo of a Lambertian surface from images under known distant lights.

    Parameters
    ----------
    images
        (N, H, W) uint8, uint16 or float32, linear in light, in the order of `lighting`.
    lighting
        The N lights.
    method
        ``ps4_robust``, the default for four lights, uses all four at a pixel where they agree
        within the noise, leaves out the one in shadow or in a highlight where they do not, and
        fills in what two lights leave open from the pixels around. ``ps4`` leaves out the darkest
        of four everywhere; ``ps3a`` to ``ps3d`` use three lights of a ring (all but 270, 0, 90
        and 180 degrees). ``least_squares``, the default for more than four, uses all N,
        ``rushmeier`` all but the lowest and the highest of five or more, and ``drbohlav`` all of
        four or more less those whose values are inconsistent with the rest.
    ambient
        (H, W) image with all lights out, of the same dtype, subtracted from each image.
    full_scale
        Pixel value at which the sensor saturates. Pixels that reach it are marked, and the albedo
        is given as a fraction of it; without it nothing is marked and albedo is in pixel values.
    noise
        Of the sensor that took the images; without it the noise is estimated from them.

    Raises
    ------
    InputError
        For another shape, dtype or count of images, NaN or infinity in a float image, or lights
        from which the method cannot solve.

    Notes
    -----
    i = rho n . l, so b = rho n solves L b = i; p = -b_x / b_z, q = -b_y / b_z, rho = |b|. PS4 is
    after J. Wu, thesis chapter 9; the sources of the other methods are in the kernels' docstrings.

    Examples
    --------
    >>> import numpy as np
    >>> lighting = Lighting.ring(slant_deg=45.0)
    >>> tilted = np.array([-0.2, 0.1, 1.0]) / np.sqrt(1.05)
    >>> values = (100 * lighting.directions @ tilted).astype(np.float32)
    >>> surface = photometric_stereo(np.tile(values[:, None, None], (1, 2, 2)), lighting)
    >>> round(float(surface.p[0, 0]), 3), round(float(surface.q[0, 0]), 3)
    (0.2, -0.1)
    """
    chosen = method or ("least_squares" if len(lighting) > 4 else "ps4_robust")
    if chosen not in METHODS:
        raise InputError(f"unknown method {chosen!r}; choose one of {', '.join(METHODS)}")
    stack = checked_stack(images, len(lighting))
    dark = None if ambient is None else checked_ambient(ambient, stack)
    scale = 1.0 if full_scale is None else float(full_scale)
    if not 0.0 < scale < np.inf:
        raise InputError(f"full_scale is {full_scale}; it must be a positive pixel value")
    saturation = np.float32(np.inf if full_scale is None else scale)
    gains = (1.0 / (scale * lighting.intensities)).astype(np.float32)
    directions = lighting.directions.astype(np.float32)

    shape = stack.shape[1:]
    p, q, albedo = (np.empty(shape, np.float32) for _ in range(3))
    valid = np.empty(shape, np.bool_)
    maps = (p, q, albedo, valid)
    given = (stack, dark, gains, saturation)
    # What the solution does not say by itself.
    dropped: npt.NDArray[np.uint8] | None = None
    specular: npt.NDArray[np.bool_] | None = None
    # A map without a pixel, which takes no memory.
    repaired = nowhere = np.broadcast_to(np.False_, shape)

    def sigma() -> float:
        if noise is None:
            return noise_of_images(stack, dark, gains, lighting)
        return noise_of_sensor(noise, dark, gains)

    def variance() -> npt.NDArray[np.float32]:
        """A, b and black of the variance a + b (v - black) of a pixel value."""
        if noise is not None:
            return noise.coefficients()
        a = sigma() ** 2 / np.mean(gains.astype(np.float64) ** 2)
        return np.array([a, 0.0, 0.0], dtype=np.float32)

    if chosen == "ps4_robust":
        pinv, null = drop_one_constants(lighting, chosen)
        of_pixel = variance()
        balance = light_balance(stack, dark, gains, float(saturation), of_pixel, null)
        lighting = Lighting(lighting.directions, lighting.intensities / balance)
        given = (stack, dark, gains * balance, saturation)
        unlit, row_counts = np.empty(shape, np.uint8), np.empty(shape[0], np.int64)
        dropped, specular = np.empty(shape, np.uint8), np.empty(shape, np.bool_)
        repaired = np.zeros(shape, np.bool_)
        robust.gated(
            *given, of_pixel, _slope_noise(pinv), pinv.astype(np.float32),
            (pinv / null).astype(np.float32), null.astype(np.float32),
            *maps, dropped, specular, unlit, row_counts,
        )  # fmt: skip
        in_fill(*given, lighting, unlit, row_counts, *maps, dropped, repaired)
    elif chosen == "ps4":
        pinv, null = drop_one_constants(lighting, chosen)
        floor = np.float32(sigma()) * _slope_noise(pinv)
        of_three = np.linalg.inv(lighting.directions[:3]).astype(np.float32)
        same = np.ptp(gains) == 0.0
        gain = gains[0] if same else np.float32(1.0)
        drop_darkest(
            stack, dark, None if same else gains, gain, saturation,
            floor / gain, of_three, null.astype(np.float32), *maps,
        )  # fmt: skip
        # What the three brightest give is taken for the surface.
        specular = nowhere
    elif chosen == "rushmeier":
        inverses = drop_two_inverses(lighting)
        weights = least_squares_weights(lighting, chosen)
        floor = np.float32(sigma()) * _slope_noise(weights)
        dropped = np.empty(shape, np.uint8)
        rushmeier(*given, floor, inverses, directions, *maps, dropped)
    elif chosen == "drbohlav":
        weights = least_squares_weights(lighting, chosen)
        dropped, specular = np.empty(shape, np.uint8), np.empty(shape, np.bool_)
        drbohlav(
            *given, variance(), _slope_noise(weights), gates(len(lighting)),
            weights, directions, *maps, dropped, specular,
        )  # fmt: skip
    else:
        used = np.ones(len(lighting), dtype=bool)
        unused = NO_DROPPED_LIGHT
        if chosen == "least_squares":
            weights = least_squares_weights(lighting, chosen)
        else:
            weights, unused = three_of_ring(lighting, chosen)
            used[unused] = False
        floor = np.float32(sigma()) * _slope_noise(weights)
        linear(*given, floor, weights, directions, used, *maps)
        dropped = np.broadcast_to(np.uint8(unused), shape)
    return SurfaceEstimate(
        p=p,
        q=q,
        albedo=albedo,
        valid=valid,
        method=chosen,
        images=stack,
        ambient=dark,
        full_scale=full_scale,
        lighting=lighting,
        left_out=dropped,
        highlights=specular,
        repaired=repaired,
    )


def _slope_noise(weights: npt.NDArray[Any]) -> np.float32:
    """C of the rule b_z^2 >= c sigma rho, below which the slopes are mostly noise.

    From p = -b_x / b_z the standard error of a slope is about sigma |weights| rho / b_z^2.
    """
    return np.float32(np.linalg.norm(weights, axis=1).max() / _MAX_SLOPE_ERROR)
