"""`photometric_stereo`: images under known lights to a `SurfaceEstimate`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from . import kernels
from .errors import InputError
from .lighting import Lighting
from .noise import noise_of_images
from .surface import SurfaceEstimate

__all__ = ["METHODS", "Method", "photometric_stereo"]

Method = Literal["ps3a", "ps3b", "ps3c", "ps3d", "ps4", "least_squares"]
METHODS: tuple[Method, ...] = get_args(Method)

# Tilt of the light each version of PS3 does without (thesis section 9.3).
_PS3_UNUSED_TILT_DEG: dict[str, float] = {"ps3a": 270.0, "ps3b": 0.0, "ps3c": 90.0, "ps3d": 180.0}
_DTYPES = (np.dtype(np.uint8), np.dtype(np.uint16), np.dtype(np.float32))
# Three lights whose directions span less than this volume leave a slope undetermined.
_MIN_VOLUME = 1e-3
# A slope known no better than this is not worth having: most surfaces are flatter.
_MAX_SLOPE_ERROR = 0.5

Images = npt.NDArray[Any] | Sequence[npt.NDArray[Any]]


def photometric_stereo(
    images: Images,
    lighting: Lighting,
    method: Method = "ps4",
    *,
    ambient: npt.NDArray[Any] | None = None,
    full_scale: float | None = None,
) -> SurfaceEstimate:
    """Gradients and albedo of a Lambertian surface from images under known distant lights.

    Parameters
    ----------
    images
        (N, H, W) uint8, uint16 or float32, linear in light, in the order of `lighting`.
    lighting
        The N lights.
    method
        ``ps3a`` to ``ps3d`` use three lights of a ring (all but 270, 0, 90 and 180 degrees),
        ``ps4`` leaves out the darkest of four at each pixel, ``least_squares`` uses all N.
    ambient
        (H, W) image with all lights out, of the same dtype, subtracted from each image.
    full_scale
        Pixel value at which the sensor saturates. Pixels that reach it are marked, and the albedo
        is given as a fraction of it; without it nothing is marked and albedo is in pixel values.

    Raises
    ------
    InputError
        For another shape, dtype or count of images, NaN or infinity in a float image, or lights
        from which the method cannot solve.

    Notes
    -----
    i = rho n . l, so b = rho n solves L b = i; p = -b_x / b_z, q = -b_y / b_z, rho = |b|. PS4 is
    after J. Wu, thesis chapter 9; the closed forms are in the kernels' docstrings.

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
    stack = _checked_stack(images, lighting)
    dark = None if ambient is None else _checked_ambient(ambient, stack)
    scale = 1.0 if full_scale is None else float(full_scale)
    if not 0.0 < scale < np.inf:
        raise InputError(f"full_scale is {full_scale}; it must be a positive pixel value")
    saturation = np.float32(np.inf if full_scale is None else scale)
    gains = (1.0 / (scale * lighting.intensities)).astype(np.float32)
    directions = lighting.directions.astype(np.float32)

    noise = noise_of_images(stack, dark, gains, lighting)

    shape = stack.shape[1:]
    p, q, albedo, residual = (np.empty(shape, np.float32) for _ in range(4))
    dropped, shadow_count, flags = (np.empty(shape, np.uint8) for _ in range(3))
    if method == "ps4":
        pinv, corrections, null = _drop_one_constants(lighting)
        kernels.drop_darkest(
            stack, dark, gains, saturation, _noise_floor(noise, pinv),
            pinv, corrections, null, directions,
            p, q, albedo, residual, dropped, shadow_count, flags,
        )  # fmt: skip
    else:
        weights, unused = _linear_weights(lighting, method)
        kernels.linear(
            stack, dark, gains, saturation, _noise_floor(noise, weights), weights, directions,
            p, q, albedo, residual, shadow_count, flags,
        )  # fmt: skip
        dropped.fill(unused)
    return SurfaceEstimate(
        p=p,
        q=q,
        albedo=albedo,
        residual=residual,
        dropped=dropped,
        shadow_count=shadow_count,
        saturated=(flags & 2) != 0,
        valid=flags == 0,
        method=method,
        images=stack,
        lighting=lighting,
    )


def _checked_stack(images: Images, lighting: Lighting) -> npt.NDArray[Any]:
    if not isinstance(images, np.ndarray):
        if len(images) == 0:
            raise InputError("no images are given; give one for each light")
        shapes = {np.shape(image) for image in images}
        if len(shapes) > 1:
            sizes = ", ".join(" x ".join(map(str, shape)) for shape in sorted(shapes))
            raise InputError(f"the images differ in size ({sizes}); all must show the same frame")
        # Stacked, they would all take the widest type, and 255 of 8 bits pass for 255 of 65535.
        dtypes = {str(np.asarray(image).dtype) for image in images}
        if len(dtypes) > 1:
            raise InputError(
                f"the images differ in type ({', '.join(sorted(dtypes))}); all must have the same"
            )
        images = np.stack(images)
    if images.ndim != 3 or 0 in images.shape:
        raise InputError(f"images have shape {images.shape}; give (lights, rows, columns)")
    if images.dtype not in _DTYPES:
        raise InputError(f"images are {images.dtype}; give uint8, uint16 or float32")
    if len(images) != len(lighting):
        raise InputError(f"{len(images)} images for {len(lighting)} lights; give one image each")
    if len(images) > 255:
        raise InputError(f"{len(images)} lights; at most 255 are handled")
    if images.dtype == np.float32:
        for index, image in enumerate(images):
            if not np.isfinite(image).all():
                raise InputError(f"image {index} holds NaN or infinity; mask or replace them")
    return np.ascontiguousarray(images)


def _checked_ambient(ambient: npt.NDArray[Any], stack: npt.NDArray[Any]) -> npt.NDArray[Any]:
    if ambient.shape != stack.shape[1:] or ambient.dtype != stack.dtype:
        raise InputError(
            f"the ambient image is {ambient.shape} {ambient.dtype}, the light images are "
            f"{stack.shape[1:]} {stack.dtype}; they must agree"
        )
    if ambient.dtype == np.float32 and not np.isfinite(ambient).all():
        raise InputError("the ambient image holds NaN or infinity; mask or replace them")
    return np.ascontiguousarray(ambient)


def _noise_floor(noise: float, weights: npt.NDArray[np.float32]) -> np.float32:
    """C of the rule b_z^2 >= c rho, below which the slopes are mostly noise.

    From p = -b_x / b_z the standard error of a slope is about sigma |weights| rho / b_z^2.
    """
    gain = float(np.linalg.norm(weights, axis=1).max())
    return np.float32(noise * gain / _MAX_SLOPE_ERROR)


def _volume(directions: npt.NDArray[np.float64]) -> float:
    """Smallest singular value: how well three or more lights determine a normal."""
    return float(np.linalg.svd(directions, compute_uv=False)[-1])


def _drop_one_constants(
    lighting: Lighting,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """pinv(L) (3, 4), pinv(L) / nul (3, 4) and nul (4,) for four lights in general position."""
    L = lighting.directions
    if len(L) != 4:
        raise InputError(
            f"method ps4 needs exactly 4 lights, this set has {len(L)}; "
            "use least_squares for 3 or for 5 and more"
        )
    for k in range(4):
        if _volume(np.delete(L, k, axis=0)) < _MIN_VOLUME:
            raise InputError(
                f"without light {k} the other three lie in one plane; PS4 needs any three of the "
                "four to determine the normal"
            )
    pinv = np.linalg.pinv(L)
    null = np.linalg.svd(L.T)[2][3]
    return (
        pinv.astype(np.float32),
        (pinv / null).astype(np.float32),
        null.astype(np.float32),
    )


def _linear_weights(lighting: Lighting, method: str) -> tuple[npt.NDArray[np.float32], int]:
    """(3, N) weights with b = weights i, and the index of the light left out."""
    used = np.ones(len(lighting), dtype=bool)
    unused = kernels.NO_DROPPED_LIGHT
    if method in _PS3_UNUSED_TILT_DEG:
        if len(lighting) != 4:
            raise InputError(f"method {method} chooses 3 of 4 lights, this set has {len(lighting)}")
        unused = lighting.light_nearest_tilt(_PS3_UNUSED_TILT_DEG[method])
        used[unused] = False
    elif method != "least_squares":
        raise InputError(f"unknown method {method!r}; choose one of {', '.join(METHODS)}")
    directions = lighting.directions[used]
    if len(directions) < 3 or _volume(directions) < _MIN_VOLUME:
        raise InputError(
            f"{method} cannot solve from {len(directions)} lights that do not span three "
            "dimensions; at least three are needed, not all in one plane"
        )
    weights = np.zeros((3, len(lighting)), dtype=np.float32)
    weights[:, used] = np.linalg.pinv(directions)
    return weights, unused
