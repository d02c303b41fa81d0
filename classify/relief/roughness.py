"""Areal roughness parameters of ISO 25178-2 from gradients and relative height."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from classify.base.arrays import BoolArray, FloatMap
from classify.base.errors import InputError
from classify.surface.estimate import SurfaceEstimate

from .height import integrate_gradients


@dataclass(frozen=True)
class Roughness:
    """ISO 25178-2 parameters over the valid pixels of a surface.

    Attributes
    ----------
    sdq
        Root mean square gradient, dimensionless. From the gradients alone.
    sdr_percent
        Developed interfacial area ratio: how much larger the surface is than its projection, in
        percent. From the gradients alone.
    sa_px, sq_px
        Arithmetical mean height and root mean square height in pixels, of the relative height
        without its mean plane. Errors of the gradients add up over the frame, so compare these
        only between frames of one size.
    valid_pixels
        Number of valid pixels.
    """

    sdq: float
    sdr_percent: float
    sa_px: float
    sq_px: float
    valid_pixels: int


def root_mean_square_slope(surface: SurfaceEstimate) -> float:
    """Sdq of ISO 25178-2 over the valid pixels; NaN if there are none."""
    count = int(np.count_nonzero(surface.valid))
    if count == 0:
        return float("nan")
    mask = surface.valid.view(np.uint8)
    squares = (cv2.norm(plane, cv2.NORM_L2SQR, mask) for plane in (surface.p, surface.q))
    return math.sqrt(sum(squares) / count)


def surface_roughness(surface: SurfaceEstimate, height: FloatMap | None = None) -> Roughness:
    """Compute Sdq and Sdr from the gradients, Sa and Sq from the relative height.

    Parameters
    ----------
    surface
        Its p, q and valid are used.
    height
        (H, W) relative height; None to integrate it from p and q.

    Raises
    ------
    InputError
        If no pixel is valid, a value is not finite, or the height has another shape.

    Notes
    -----
    After ISO 25178-2:2021, means over the valid pixels:

        Sdq = sqrt(mean(p^2 + q^2))         Sdr = 100 % mean(sqrt(1 + p^2 + q^2) - 1)
        Sa = mean(|z|)                      Sq = sqrt(mean(z^2))

    with z the height without its least-squares plane (the F-operation). Gradients are not levelled:
    a tilted part has a larger Sdq. All four grow with the noise of the images. Slopes are those at
    the scale of a pixel: a coarser image of the same part has a smaller Sdq.
    """
    valid = surface.valid
    count = int(np.count_nonzero(valid))
    if count == 0:
        raise InputError("no pixel of this surface is valid; check exposure and lights")
    if height is None:
        height = integrate_gradients(surface.p, surface.q)
    if height.shape != surface.shape:
        raise InputError(f"the height is {height.shape}, the surface {surface.shape}")
    zero = np.float32(0.0)
    p, q, z = (np.where(valid, values, zero) for values in (surface.p, surface.q, height))
    if not all(np.isfinite(values).all() for values in (p, q, z)):
        raise InputError(
            "gradients or height contain NaN or infinity; mark such pixels as not valid"
        )
    steepness = p * p + q * q
    # sqrt(1 + s) - 1, written without loss of digits on a flat surface.
    developed = steepness / (np.sqrt(1.0 + steepness) + 1.0)
    levelled = _levelled(z, valid)
    return Roughness(
        sdq=float(np.sqrt(steepness.sum(dtype=np.float64) / count)),
        sdr_percent=100.0 * float(developed.sum(dtype=np.float64) / count),
        sa_px=float(np.abs(levelled).sum(dtype=np.float64) / count),
        sq_px=float(np.sqrt(np.square(levelled).sum(dtype=np.float64) / count)),
        valid_pixels=count,
    )


def _levelled(height: FloatMap, valid: BoolArray) -> FloatMap:
    """Subtract the least-squares plane of the valid pixels; 0 elsewhere."""
    rows, columns = valid.shape
    # Coordinates within [-1, 1] keep the normal equations well conditioned in any frame.
    y, x = np.linspace(1.0, -1.0, rows), np.linspace(-1.0, 1.0, columns)
    of_row, of_column = (valid.sum(axis=axis, dtype=np.float64) for axis in (1, 0))
    height_of_row, height_of_column = (height.sum(axis=axis, dtype=np.float64) for axis in (1, 0))
    n, s_x, s_y, s_xy = of_row.sum(), of_column @ x, of_row @ y, y @ (valid @ x)
    products = [[n, s_x, s_y], [s_x, of_column @ x**2, s_xy], [s_y, s_xy, of_row @ y**2]]
    moments = [height_of_row.sum(), height_of_column @ x, height_of_row @ y]
    # Of least norm, because one pixel or one row does not determine a plane.
    level, along_x, along_y = np.linalg.lstsq(products, moments, rcond=1e-9)[0]
    plane = (level + along_y * y).astype(np.float32)[:, None] + (along_x * x).astype(np.float32)
    levelled: FloatMap = (height - plane) * valid
    return levelled
