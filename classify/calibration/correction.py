"""The steps of `Calibration.corrected`."""

import cv2
import numpy as np
import numpy.typing as npt

from classify.base.arrays import Array, BoolArray, FloatMap
from classify.images.stack import ImageStack

from .dark import Dark
from .response import Response
from .scale import Scale

_NEIGHBOURS = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1) if row or column]


def without_hot_pixels(images: Array, hot_pixels: npt.NDArray[np.int32]) -> Array:
    """Copy of (..., H, W) images with the median of good neighbours in each hot pixel."""
    rows, columns = images.shape[-2:]
    is_good = np.ones((rows, columns), np.bool_)
    row, column = hot_pixels.T
    is_good[row, column] = False
    # (8, n) neighbours, clipped to the frame; those outside do not count.
    near_row, near_column = hot_pixels.T[:, None] + np.array(_NEIGHBOURS).T[:, :, None]
    inside = (near_row >= 0) & (near_row < rows) & (near_column >= 0) & (near_column < columns)
    near_row, near_column = near_row.clip(0, rows - 1), near_column.clip(0, columns - 1)
    good = inside & is_good[near_row, near_column]
    repaired = good.any(axis=0)
    values = images[..., near_row[:, repaired], near_column[:, repaired]].astype(np.float32)
    medians = np.nanmedian(np.where(good[:, repaired], values, np.float32(np.nan)), axis=-2)
    if images.dtype.kind == "u":
        medians = np.rint(medians)
    corrected = images.copy()
    corrected[..., row[repaired], column[repaired]] = medians.astype(images.dtype)
    return corrected


def linear(stack: ImageStack, response: Response, full_scale: float) -> ImageStack:
    """The images and the ambient image in units of light; full scale stays full scale."""
    ambient = None if stack.ambient is None else response.linearise(stack.ambient, full_scale)
    return ImageStack(response.linearise(stack.images, full_scale), ambient)


def without_offset(images: Array, offset: float, full_scale: float) -> FloatMap:
    """Subtract `offset` from images; saturated pixels stay saturated."""
    raw = images.astype(np.float32)
    return np.where(raw < full_scale, raw - np.float32(offset), raw)


def offset_in_light(dark: Dark, response: Response | None, full_scale: float) -> float:
    """Linear offset of a camera, in units of images that saturate at `full_scale`."""
    offset = np.array([dark.offset * full_scale / dark.full_scale])
    if response is not None:
        return float(response.linearise(offset, full_scale)[0])
    return float(offset[0])


def undistorted(stack: ImageStack, scale: Scale, full_scale: float) -> ImageStack:
    """The images of a lens without distortion, by bilinear interpolation."""
    maps = _source_of_pixels(scale, stack.shape)

    def remap(image: Array) -> Array:
        moved = cv2.remap(image, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        # Not of bytes, in which a small weight would be rounded to 0.
        saturated = (image >= full_scale).astype(np.float32)
        if saturated.any():
            moved[cv2.remap(saturated, *maps, cv2.INTER_LINEAR) > 0.0] = image.max()
        return np.asarray(moved, image.dtype)

    ambient = None if stack.ambient is None else remap(stack.ambient)
    return ImageStack(np.stack([remap(image) for image in stack.images]), ambient)


def undistorted_mask(mask: BoolArray, scale: Scale) -> BoolArray:
    """The (H, W) mask moved like the images; false beyond the frame."""
    rows, columns = mask.shape
    maps = _source_of_pixels(scale, (rows, columns))
    moved = cv2.remap(mask.astype(np.uint8), *maps, cv2.INTER_NEAREST)
    return np.asarray(moved, np.bool_)


def _source_of_pixels(scale: Scale, shape: tuple[int, int]) -> tuple[Array, Array]:
    """Columns and rows of the distorted image from which each pixel comes."""
    rows, columns = shape
    matrix = scale.camera_matrix
    maps = cv2.initUndistortRectifyMap(
        matrix, scale.distortion, None, matrix, (columns, rows), cv2.CV_32FC1
    )
    return maps[0], maps[1]
